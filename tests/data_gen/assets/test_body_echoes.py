"""Bodies as a radar sees them: echoes of the right strength, from where the body is."""

import numpy as np
import pytest

from data_gen.assets.catalogue import VARIANTS, build_asset
from fusion_net.common.nuscenes_format import CLASSES
from tests.fixtures.bodies import every_body

# total mean RCS in dBsm, seen end on and broadside, as ranges over all variants
ECHOES = {
    "car": ((8, 12), (14, 20)),
    "truck": ((15, 25), (18, 25)),
    "bus": ((15, 25), (18, 25)),
    "trailer": ((16, 25), (18, 26)),
    "construction_vehicle": ((14, 22), (18, 25)),
    "pedestrian": ((-8, 0), (-8, 0)),
    "motorcycle": ((1, 6), (3, 7)),
    "bicycle": ((-5, 3), (-5, 3)),
    "traffic_cone": ((-15, -10), (-15, -10)),
    "barrier": ((-5, 11), (-5, 11)),
}


def total_rcs(asset, direction):
    """Power sum in dBsm of what faces a radar that lies in ``direction`` (3,)."""
    points = asset.scatterers
    faces = (points.normal @ direction > 0.2) | (np.abs(points.normal).sum(axis=1) == 0)
    return 10 * np.log10(np.sum(10 ** (points.rcs[faces] / 10)))


@pytest.mark.parametrize("kind", CLASSES)
def test_radar_cross_sections_match_the_class(kind):
    (end_low, end_high), (side_low, side_high) = ECHOES[kind]
    for variant in range(VARIANTS[kind]):
        asset = build_asset(kind, variant)
        for direction in ((1, 0, 0), (-1, 0, 0)):
            assert end_low <= total_rcs(asset, np.array(direction)) <= end_high
        for direction in ((0, 1, 0), (0, -1, 0)):
            assert side_low <= total_rcs(asset, np.array(direction)) <= side_high


@every_body
def test_scatterers_lie_on_the_body_and_face_outwards(kind, variant):
    asset = build_asset(kind, variant)
    points = asset.scatterers
    assert len(points.rcs) > 0
    assert np.all(np.abs(points.position[:, :2]) <= np.array(asset.size[:2]) / 2 + 0.02)
    assert points.position[:, 2].min() >= 0
    assert points.position[:, 2].max() <= asset.size[2] + 0.02
    length = np.linalg.norm(points.normal, axis=1)
    assert np.all((length == 0) | (np.abs(length - 1) < 1e-5))
    assert np.all(np.einsum("ij,ij->i", points.normal, points.position * (1, 1, 0)) >= 0)


def test_long_vehicles_reflect_along_their_sides():
    points = build_asset("bus", 0).scatterers
    left = np.sort(points.position[points.normal[:, 1] > 0.5, 0])
    assert np.diff(left).max() <= 2.0
