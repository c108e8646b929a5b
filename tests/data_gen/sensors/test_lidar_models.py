"""Other LiDARs than the HDL-32E: their beams, their timing and their figures, in the rays and in the data."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_gen.rig.mounts import Lidar
from data_gen.scene.conditions import Condition
from data_gen.scene.scene import NOTHING
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.lidar.lidar import firing_pattern, sense
from fusion_net.common.random import stream
from tests.fixtures.box_world import at, box, scene
from tests.fixtures.lidar_models import HDL32E, HDL64E, VLP16

MODELS = [HDL32E, VLP16, HDL64E]
every_model = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)


def mounted(model, **changes):
    return Lidar(
        **{"model": model, "translation": [0.9, 0.0, 1.8], "rotation_deg": [0.5, 1.0, 2.0], "rate": 10.0} | changes
    )


def sweep_of(world, model, **changes):
    return sense(world, CaptureEvent.nominal(mounted(model, **changes), 0.4, stream(5)))


def wall(distance, reflectivity=0.5):
    return box((1.0, 200.0, 120.0), at(distance + 0.5, 0, 0), reflectivity)


def test_elevations_are_those_of_the_manuals():
    np.testing.assert_allclose(np.sort(VLP16.elevation_deg), np.arange(-15, 16, 2))
    upper, lower = np.sort(HDL64E.elevation_deg)[32:], np.sort(HDL64E.elevation_deg)[:32]
    np.testing.assert_allclose(upper, np.linspace(-8.33, 2.0, 32), atol=0.01)
    np.testing.assert_allclose(lower, np.linspace(-24.33, -8.83, 32), atol=0.01)
    np.testing.assert_allclose(np.sort(HDL32E.elevation_deg), np.linspace(-30.67, 10.67, 32), atol=0.01)


@every_model
def test_points_lie_on_the_beam_that_their_ring_names(model):
    sweep = sweep_of(scene(walls=[wall(12.0)]), model, columns=300)
    elevation = np.degrees(np.arcsin(sweep.points[:, 2] / np.linalg.norm(sweep.points, axis=1)))
    np.testing.assert_allclose(elevation, np.sort(model.elevation_deg)[sweep.ring], atol=2e-3)
    assert set(sweep.ring) == set(range(model.beams))


@every_model
def test_a_turn_has_as_many_rays_as_the_model_fires(model):
    directions, beam, dt = firing_pattern(mounted(model))
    assert len(directions) == model.beams * model.columns_in(0.1)
    assert np.bincount(beam).tolist() == [model.columns_in(0.1)] * model.beams
    rate = {"HDL-32E": 695_000, "VLP-16": 289_352, "HDL-64E": 1_333_333}[
        model.name
    ]  # points per second, of the manuals
    assert len(directions) * 10 == pytest.approx(rate, rel=2e-3)
    column = dt.reshape(-1, model.beams)
    assert np.all(column.max(axis=1)[:-1] < column.min(axis=1)[1:])  # a column ends before the next one begins
    assert dt.max() <= 0


def test_a_lower_and_an_upper_beam_of_the_64_fire_at_once_and_at_one_azimuth():
    directions, beam, dt = firing_pattern(mounted(HDL64E))
    lower, upper = slice(0, None, 2), slice(1, None, 2)
    np.testing.assert_array_equal(dt[lower], dt[upper])
    azimuth = np.arctan2(directions[:, 0], directions[:, 1])
    np.testing.assert_allclose(azimuth[lower], azimuth[upper], atol=1e-12)
    elevation = np.array(HDL64E.elevation_deg)[beam]
    assert elevation[lower].max() < elevation[upper].min()
    assert np.unique(dt[:64]).size == 32
    assert np.ptp(dt[:64]) == pytest.approx(31 * HDL64E.firing_interval)


@given(st.lists(st.integers(-890, 890), min_size=1, max_size=128, unique=True))
def test_rings_count_the_beams_from_the_lowest_up(tenths):
    model = replace(HDL32E, elevation_deg=[angle / 10 for angle in tenths], column_interval=1e-3)
    assert sorted(model.ring) == list(range(len(tenths)))
    assert np.all(np.diff(np.array(tenths)[np.argsort(model.ring)]) > 0)


def fraction_returned(model, distance, reflectivity):
    sweep = sweep_of(scene(walls=[wall(distance, reflectivity)], with_ground=False), model, sector_deg=[-3.0, 3.0])
    return len(sweep.points) / (len(firing_pattern(mounted(model, sector_deg=[-3.0, 3.0]))[0]))


def test_the_range_is_the_models():
    near = replace(HDL64E, max_range=60.0)
    assert fraction_returned(HDL64E, 50.0, 0.5) > 0.9
    assert fraction_returned(near, 50.0, 0.5) < 0.2  # 60 m x sqrt(0.5 / 0.9) = 45 m
    assert fraction_returned(near, 70.0, 0.9) == 0.0


def test_the_range_noise_is_the_models():
    def spread(noise):
        model = replace(VLP16, range_noise=noise)
        sweep = sweep_of(
            scene(walls=[wall(8.0)], with_ground=False), model, sector_deg=[-1.0, 1.0], rotation_deg=[0.0] * 3
        )
        return np.std(sweep.points[np.abs(sweep.points[:, 2]) < 0.5][:, 1])  # along the boresight

    assert spread(0.10) > 4 * spread(0.005)


def test_a_needle_of_a_beam_meets_fewer_drops():
    """The volume that a beam sweeps grows with the square of its width; only of wide ones does a drop fill too little."""
    rain = Condition(visibility=1e9, rain_rate=50.0)

    def in_air(divergence):
        model = replace(HDL32E, divergence=divergence)
        return np.count_nonzero(sweep_of(scene(with_ground=False, condition=rain), model).body == NOTHING)

    assert in_air(1e-3) > 2 * in_air(1e-4) > 0


MISTAKES = [
    ({"elevation_deg": []}, "lidar.elevation_deg=[] is not 1 to 256 angles"),
    ({"elevation_deg": [1.0, 1.0]}, "lidar.elevation_deg=[1.0,1.0] has an angle twice"),
    ({"elevation_deg": [95.0]}, "between -90 and 90 degrees"),
    (
        {"beams_at_once": 3},
        "lidar.beams_at_once=3 does not divide 32 beams; the nearest that works is lidar.beams_at_once=1",
    ),
    (
        {"max_range": -5.0},
        "lidar.max_range=-5.0 is less than 1 or endless; the nearest that works is lidar.max_range=1",
    ),
    ({"divergence": 0.0}, "lidar.divergence=0.0 is less than 1e-06"),
    ({"column_interval": 1e-6}, "lidar.column_interval=1e-06 s is too short for 32 beams"),
]


@pytest.mark.parametrize(("changes", "said"), MISTAKES)
def test_a_model_that_cannot_be_is_refused_in_one_line(changes, said):
    with pytest.raises(ValueError, match="lidar") as error:
        replace(HDL32E, **changes)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
