"""Mirror paths against geometry by hand: a sensor at the origin looking along x, a target, and an upright plane."""

import numpy as np
import pytest

from data_gen.assets.shapes.mesh import Asset
from data_gen.scene.scene import NOTHING
from data_gen.sensors.radar.detection import DOUBLE_BOUNCE, SINGLE_BOUNCE
from data_gen.sensors.radar.mirrors import MIRROR_PROBABILITY
from data_gen.sensors.radar.radar import STATIONARY
from tests.fixtures.box_world import ORIGIN, at, box, path, reflectors
from tests.fixtures.mirror_world import BOUNCE, IMAGE, RADAR, SCANS, TARGET, WALL, wall_world
from tests.fixtures.radar_world import point_actor, scan_of, seen_at


def causes(world, scans=60):
    """How many detections of each cause."""
    return np.bincount(np.concatenate([scan_of(world, RADAR, key=k).cause for k in range(scans)]), minlength=7)


def test_one_bounce_shows_the_mean_range_on_either_side_and_two_show_the_mirror_image():
    world = wall_world()
    direct, mirrored = np.linalg.norm(TARGET - (0, 0, 0.8)), np.linalg.norm(IMAGE - (0, 0, 0.8))
    bearing = [np.arctan2(*p[1::-1]) for p in (TARGET, IMAGE)]
    single, double = (seen_at(world, RADAR, scans=SCANS, cause=c) for c in (SINGLE_BOUNCE, DOUBLE_BOUNCE))
    assert np.median(single["range"]) == pytest.approx((direct + mirrored) / 2, abs=0.02)
    left = single["azimuth"] > 0.15
    assert np.mean(left) == pytest.approx(0.5, abs=0.15)
    assert np.mean(single["azimuth"][left]) == pytest.approx(bearing[1], abs=0.006)
    assert np.mean(single["azimuth"][~left]) == pytest.approx(bearing[0], abs=0.006)
    assert np.median(double["range"]) == pytest.approx(mirrored, abs=0.02)
    assert np.mean(double["azimuth"]) == pytest.approx(bearing[1], abs=0.006)
    assert len(double["range"]) / SCANS == pytest.approx(MIRROR_PROBABILITY, abs=3 * np.sqrt(0.3 * 0.7 / SCANS))
    assert set(single["body"]) | set(double["body"]) == {NOTHING}


def test_one_bounce_costs_six_to_ten_decibels_and_two_ten_to_fifteen():
    """Seen through the cross-section that the receiver infers from power and range, in the mean over fluctuation."""

    def mean_rcs(**which):
        return 10 * np.log10(np.mean(10 ** (seen_at(wall_world(), RADAR, scans=SCANS, **which)["rcs"] / 10)))

    assert mean_rcs(body=0) == pytest.approx(20, abs=0.7)  # three standard errors of 400 exponential variables
    assert 20 - 10 < mean_rcs(cause=SINGLE_BOUNCE) < 20 - 6
    assert 20 - 15 < mean_rcs(cause=DOUBLE_BOUNCE) < 20 - 10


def test_the_mirrored_path_has_the_mirrored_velocity():
    """v' = v - 2 (v . n) n; the path that bounces once lengthens at the mean of both rates."""
    velocity, own = np.array([9.0, -3.0, 0.0]), np.array([14.0, 0.0, 0.0])
    ego = path(ORIGIN - 0.5 * own, velocity=own)
    world = wall_world(velocity=velocity, ego=ego)
    rays = [(p - (0, 0, 0.8)) / np.linalg.norm(p - (0, 0, 0.8)) for p in (TARGET, IMAGE)]
    direct, mirrored = rays[0] @ (velocity - own), rays[1] @ (velocity * (1, -1, 1) - own)
    single, double = (seen_at(world, RADAR, scans=200, cause=c) for c in (SINGLE_BOUNCE, DOUBLE_BOUNCE))
    assert np.median(single["doppler"]) == pytest.approx((direct + mirrored) / 2, abs=0.01)
    assert np.median(double["doppler"]) == pytest.approx(mirrored, abs=0.01)


def lorry(velocity):
    """A tall box of 10 by 2.5 m beside the bounce, its right side at the wall's place at 0.5 s."""
    size = (10.0, 2.5, 3.5)
    asset = Asset("lorry", "vehicle.truck", size, box(size, (0, 0, 1.75)), reflectors([0, 0, 3.0], -40.0))
    return asset, path(at(BOUNCE, WALL + size[1] / 2, 0.0) - 0.5 * np.asarray(velocity), velocity=velocity)


def test_the_side_of_a_lorry_mirrors_and_its_own_motion_counts_twice():
    """A mirror that comes nearer at w moves the image by 2 w: v' = v - 2 ((v - w) . n) n."""
    velocity, sideways = np.array([9.0, 0.0, 0.0]), np.array([9.0, -1.0, 0.0])
    world = wall_world(velocity=velocity, walls=[], actors=[lorry(sideways)])
    double = seen_at(world, RADAR, scans=200, cause=DOUBLE_BOUNCE)
    ray = (IMAGE - (0, 0, 0.8)) / np.linalg.norm(IMAGE - (0, 0, 0.8))
    assert len(double["range"]) > 30
    assert np.median(double["range"]) == pytest.approx(np.linalg.norm(IMAGE - (0, 0, 0.8)), abs=0.02)
    assert np.median(double["doppler"]) == pytest.approx(ray @ (9.0, -2.0, 0.0), abs=0.01)


def test_a_ghost_needs_the_mirror_where_the_path_bounces_and_a_free_way_to_and_from_it():
    def wall(start, end):
        return box((end - start, 0.2, 3.0), at((start + end) / 2, WALL + 0.1, 1.5))

    def post(x, y):
        return box((0.3, 0.3, 3.0), at(x, y, 1.5))

    whole = [wall(0, 40)]
    ghosts = {name: causes(wall_world(walls=walls))[[SINGLE_BOUNCE, DOUBLE_BOUNCE]] for name, walls in {
        "whole": whole,
        "no wall": [],
        "gap": [wall(0, BOUNCE - 1), wall(BOUNCE + 1, 40)],
        "low wall": [box((40.0, 0.2, 0.6), at(20.0, WALL + 0.1, 0.3))],
        "set back": [box((40.0, 0.2, 3.0), at(20.0, WALL + 0.6, 1.5))],
        "post before the bounce": [*whole, post(BOUNCE / 2, WALL / 2)],
        "post behind the bounce": [*whole, post((BOUNCE + 30) / 2, 1.0)],
        "post in the direct way": [*whole, post(15.0, -1.0)],
    }.items()}  # fmt: skip
    assert (ghosts["whole"] > 5).all()
    for name in ("no wall", "gap", "low wall", "set back", "post before the bounce", "post behind the bounce"):
        assert not ghosts[name].any(), name
    assert ghosts["post in the direct way"][0] == 0
    assert ghosts["post in the direct way"][1] > 5


def test_what_turns_its_back_to_the_mirror_has_no_ghost():
    target = point_actor()
    for normal, seen in (((-0.6, 0.8, 0.0), True), ((0.6, -0.8, 0.0), False)):
        asset = Asset("p", "", target.size, target.mesh, reflectors([0, 0, 0.8], 20.0, normal))
        assert causes(wall_world(target=asset))[DOUBLE_BOUNCE].astype(bool) == seen


def test_ghosts_of_what_stands_still_stand_still():
    own = np.array([20.0, 0.0, 0.0])
    world = wall_world(ego=path(ORIGIN - 0.5 * own, velocity=own))
    double = seen_at(world, RADAR, scans=100, cause=DOUBLE_BOUNCE)
    assert np.mean(double["dyn_prop"] == STATIONARY) > 0.9
