import numpy as np
import pytest

from data_gen.actors.traffic import populate
from data_gen.assets.shapes.mesh import Asset
from data_gen.road.layout import record_layout
from data_gen.scene.conditions import Condition
from data_gen.scene.noise import noise3
from data_gen.scene.spray import CONTRAST, PATCH, Plumes, optical_depth, penetrate, plumes_at
from tests.fixtures.box_world import ORIGIN, at, car, path, scene
from tests.fixtures.scenarios import MIXED

SPRAY = Condition("spray", spray=True, water_film=1.0)


def truck(size=(9.0, 2.5, 3.5)):
    body = car(size=size)
    return Asset("truck", "vehicle.truck", size, body.mesh, body.scatterers)


def behind_a_truck(*, speed=25.0, condition=SPRAY, yaw=0.0):
    velocity = (speed * np.cos(yaw), speed * np.sin(yaw), 0.0)
    return scene(actors=[(truck(), path(at(25, 1, 0), velocity, yaw))], condition=condition)


def rays(count, seed=0):
    """Origins and directions of rays from the ego's place towards what is ahead."""
    rng = np.random.default_rng(seed)
    direction = np.array([1.0, 0.05, -0.05]) + rng.normal(size=(count, 3)) * [0.0, 0.1, 0.05]
    return at(0, 0, 1.8) + rng.normal(size=(count, 3)) * 0.3, direction / np.linalg.norm(direction, axis=1)[:, None]


def extinction(plumes: Plumes, points):
    """Sum over the plumes of the extinction at points (..., 3), by the definition."""
    total = np.zeros(points.shape[:-1])
    patch = np.vectorize(lambda x, y, z: max(1.0 + CONTRAST * noise3(x, y, z, 71), 0.0))
    for origin, axis, length, half, height, thick, _ in zip(*plumes, strict=True):
        x, y, z = np.moveaxis(points - origin, -1, 0)
        u, y = (x * axis[0] + y * axis[1]) / length, y * axis[0] - x * axis[1]
        a, b = y / (half[0] + u * (half[1] - half[0])), z / (height[0] + u * (height[1] - height[0]))
        inside = (u > 0) & (u < 1) & (abs(a) < 1) & (b > 0) & (b < 1)
        near = points[inside] / PATCH
        smooth = thick * np.exp(-2 * u) * (1 - u**4) * (1 - a**2) * (1 - b**2)
        total[inside] += smooth[inside] * (patch(*near.T) if len(near) else 0.0)
    return total


def test_a_dry_road_a_slow_vehicle_and_a_parked_one_throw_nothing():
    assert len(plumes_at(behind_a_truck(), 0.0).length) == 1
    assert not len(plumes_at(behind_a_truck(condition=Condition(water_film=1.0)), 0.0).length)
    assert not len(plumes_at(behind_a_truck(condition=Condition(spray=True, water_film=0.2)), 0.0).length)
    assert not len(plumes_at(behind_a_truck(speed=7.0), 0.0).length)
    assert not len(plumes_at(behind_a_truck(speed=0.0), 0.0).length)
    assert plumes_at(scene(), 0.0).origin.shape == (0, 3)


def test_a_plume_trails_its_vehicle_and_grows_with_speed_and_water():
    plume = plumes_at(behind_a_truck(yaw=0.3), 0.2)
    back = -np.array([np.cos(0.3), np.sin(0.3)])
    np.testing.assert_allclose(plume.axis[0], back, atol=1e-6)
    np.testing.assert_allclose(plume.origin[0, :2], at(25, 1, 0)[:2] - back * (25 * 0.2 - 3.0), atol=1e-6)
    assert plume.length[0] == pytest.approx(10.0)
    assert plume.extinction[0] == pytest.approx(0.6)  # twice a car's
    faster = plumes_at(behind_a_truck(speed=50.0, condition=Condition(spray=True, water_film=0.5)), 0.0)
    assert faster.length[0] == 15.0
    assert faster.extinction[0] == pytest.approx(0.6 * 0.5 * 4)


def test_optical_depth_is_the_integral_of_the_extinction():
    beside = (car(size=(4.5, 1.9, 1.5)), path(at(32, -2, 0), (20, 0, 0)))
    world = scene(actors=[(truck(), path(at(25, 1, 0), (25, 0, 0))), beside], condition=SPRAY)
    plumes = plumes_at(world, 0.0)
    origins, directions = rays(60)
    far = np.where(np.arange(60) % 3 == 0, 18.0, 40.0)
    step = 0.02
    s = np.arange(step / 2, 40.0, step)
    points = origins[:, None] + s[:, None] * directions[:, None]
    expected = (extinction(plumes, points) * (s < far[:, None])).sum(axis=1) * step
    tau = optical_depth(plumes, origins, directions, far)
    assert np.mean(expected > 0.1) > 0.3
    np.testing.assert_allclose(tau, expected, rtol=0.1, atol=0.02)
    assert np.all(tau[expected == 0] == 0)


def test_plumes_add_up_and_a_mean_over_directions_is_free_of_patches():
    two = plumes_at(scene(actors=[(truck(), path(at(x, 0, 0), (25, 0, 0))) for x in (25, 29)], condition=SPRAY), 0.0)
    origins, directions = rays(500)
    whole = optical_depth(two, origins, directions, 60.0)
    parts = [optical_depth(Plumes(*(f[[k]] for f in two)), origins, directions, 60.0) for k in (0, 1)]
    np.testing.assert_allclose(whole, parts[0] + parts[1], rtol=1e-9)
    # Across the plume at its start, low: 2/3 of the width times the extinction.
    z = np.random.default_rng(1).uniform(0, 1.75, 4000)
    start = np.stack([np.full(4000, two.origin[0, 0] - 0.01), np.full(4000, ORIGIN[1] - 5), z], axis=1)
    start[:, 0] -= np.random.default_rng(2).uniform(0, 0.5, 4000)
    across = optical_depth(Plumes(*(f[[0]] for f in two)), start, np.tile([0.0, 1.0, 0.0], (4000, 1)), 10.0)
    assert across.mean() == pytest.approx(0.6 * 2 / 3 * 2.5 * 2 / 3 * np.exp(-0.05), rel=0.15)


def test_the_draw_stops_where_the_depth_is_reached():
    plumes = plumes_at(behind_a_truck(), 0.0)
    origins, directions = rays(20_000)
    budget = np.random.default_rng(3).exponential(size=20_000)
    tau, stop = penetrate(plumes, origins, directions, 60.0, budget)
    np.testing.assert_array_equal(np.isfinite(stop), budget <= tau)
    assert np.isfinite(stop).mean() == pytest.approx(np.mean(1 - np.exp(-tau)), abs=0.01)
    some = np.isfinite(stop)
    reached = optical_depth(plumes, origins[some], directions[some], stop[some])
    np.testing.assert_allclose(reached, budget[some], rtol=0.1, atol=0.02)
    assert np.all(optical_depth(plumes, origins, directions, 5.0) == 0)


def test_a_ray_of_a_later_time_meets_the_plume_where_it_is_then():
    world = behind_a_truck()
    origins, directions = rays(500)
    moved = optical_depth(plumes_at(world, 0.0), origins, directions, 60.0, np.full(500, 0.1))
    np.testing.assert_allclose(moved, optical_depth(plumes_at(world, 0.1), origins, directions, 60.0), rtol=1e-4)
    assert abs(moved - optical_depth(plumes_at(world, 0.0), origins, directions, 60.0)).max() > 0.05


def test_the_spray_condition_gets_a_truck_ahead():
    for seed in (1, 3):
        layout = record_layout("highway", seed=seed, duration=2.0, traffic=MIXED.traffic)
        position, yaw, _ = layout.ego.at(1.0)
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        found = []
        for actor in populate(layout, seed=seed, truck_ahead=True, traffic=MIXED.traffic, roadside=MIXED.roadside):
            there, _, velocity = actor.track.at(1.0)
            fast = velocity[:2] @ ahead > 8 and 5 < (there - position)[:2] @ ahead < 50
            found += [fast and actor.asset.category.split(".")[1:2] in (["truck"], ["bus"])]
        assert any(found)
