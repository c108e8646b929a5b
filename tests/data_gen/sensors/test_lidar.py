from dataclasses import replace

import numpy as np
import pytest

from data_gen.rig.mounts import Lidar
from data_gen.scene.conditions import Condition
from data_gen.scene.scene import WORLD
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.lidar.lidar import firing_pattern, sense
from data_gen.sensors.lidar.power import range_sigma
from fusion_net.common.geometry import from_rpy, invert, transform
from fusion_net.common.random import stream
from tests.fixtures.box_world import ORIGIN, at, box, car, path, scene
from tests.fixtures.lidar_models import HDL32E

FRONT = Lidar(
    model=HDL32E,
    translation=[0.94, 0.1, 1.84],
    rotation_deg=[-0.4, 0.6, 0.3],
    columns=1085,
    sector_deg=[-40.0, 30.0],
    rate=10.0,
)
FULL = Lidar(model=HDL32E, translation=[0.94, 0.1, 1.84], rotation_deg=[-0.4, 0.6, 0.3], columns=720, rate=10.0)


def sweep_of(world, lidar=FRONT, t_end=0.4, key=0, **more):
    return sense(world, CaptureEvent.nominal(lidar, t_end, stream(5, key), **more))


def in_global(world, sweep, lidar=FRONT, t_end=0.4):
    return transform(world.ego.pose(t_end) @ lidar.ego_T_sensor, sweep.points)


def wall_ahead(distance, reflectivity=0.5, height=30.0):
    """A wall across the road whose near face is ``distance`` m ahead of the ego's origin."""
    return box((1.0, 120.0, height), at(distance + 0.5, 0, 0), reflectivity)


def test_the_beams_are_the_hdl_32s():
    directions, beam, dt = firing_pattern(FULL)
    assert len(directions) == 32 * 720
    np.testing.assert_allclose(np.degrees(np.arcsin(directions[:, 2])), np.array(HDL32E.elevation_deg)[beam], atol=1e-9)
    np.testing.assert_allclose(np.diff(FULL.elevations_deg), 1.33, atol=0.011)
    assert dt[0] == pytest.approx(-0.1)
    assert np.all(np.diff(dt) > 0)
    assert dt[31] - dt[0] == pytest.approx(31 * HDL32E.firing_interval)
    assert dt[32] - dt[0] == pytest.approx(0.1 / 720)


def test_the_head_turns_clockwise_from_105_degrees_and_leans_within_a_column():
    directions, _, dt = firing_pattern(FULL)
    azimuth = np.degrees(np.arctan2(-directions[:, 0], directions[:, 1]))  # x right, y forward
    expected = 105 - 3600 * (dt + 0.1)
    np.testing.assert_allclose((azimuth - expected + 180) % 360 - 180, 0, atol=1e-6)
    assert azimuth[0] - azimuth[31] == pytest.approx(360 * 10 * 31 * HDL32E.firing_interval)
    ahead = np.argmin(np.abs(azimuth))
    assert dt[ahead] + 0.1 == pytest.approx(105 / 360 * 0.1, abs=2e-4)  # 29.2 ms, the front camera's phase


def test_the_sector_keeps_left_and_right_apart():
    directions, _, _ = firing_pattern(FRONT)
    azimuth = np.degrees(np.arctan2(-directions[:, 0], directions[:, 1]))
    assert azimuth.min() == pytest.approx(-40, abs=0.4)
    assert azimuth.max() == pytest.approx(30, abs=0.4)
    assert len(directions) == pytest.approx(1085 * 70 / 360 * 32, rel=0.01)


def test_a_wall_is_measured_within_the_noise():
    world = scene(walls=[wall_ahead(25.0)], with_ground=False)
    sweep = sweep_of(world)
    points = in_global(world, sweep)
    assert len(points) > 3000
    slant = np.linalg.norm(sweep.points, axis=1)
    sigma = range_sigma(0.5 * (100 / 25) ** 2 / 0.9, noise=HDL32E.range_noise)
    error = (points[:, 0] - ORIGIN[0] - 25.0) * slant / 24.06  # along the ray, from along the road
    assert abs(np.median(error)) < 2e-3
    assert np.std(error) == pytest.approx(sigma, rel=0.35)
    np.testing.assert_allclose(slant / 0.002, np.round(slant / 0.002), atol=0.02)


def test_rings_rise_with_elevation():
    world = scene(walls=[wall_ahead(15.0)], with_ground=False)
    sweep = sweep_of(world)
    elevation = np.degrees(np.arcsin(sweep.points[:, 2] / np.linalg.norm(sweep.points, axis=1)))
    np.testing.assert_allclose(elevation, FRONT.elevations_deg[sweep.ring], atol=1e-3)


def test_the_ground_lies_flat_in_spite_of_the_tilted_mount_and_reflects_as_its_material():
    brightness = {}
    for material in ("asphalt", "grass"):
        world = scene(ground=material)
        sweep = sweep_of(world, FULL)
        distance = np.linalg.norm(sweep.points, axis=1)
        assert abs(in_global(world, sweep, FULL)[:, 2]).max() < 0.1
        brightness[material] = np.median(sweep.intensity[distance < 4.5])
        # The grazing law of a rough ground: rho (A cos + B sin^2) / r^2 falls under P_min = 0.9e-4.
        far = np.sqrt(np.array({"asphalt": 0.14, "grass": 0.45}[material]) * 0.36 / 0.9e-4)
        assert np.mean(distance > 0.8 * far) > 0.01
        assert np.mean(distance > 1.4 * far) < 0.005
    assert brightness["grass"] / brightness["asphalt"] == pytest.approx(0.45 / 0.14, rel=0.08)


def test_a_moving_car_is_hit_where_it_is_when_the_ray_leaves():
    """A car crosses at 20 m/s, 50 ms on it is 1 m further: two rays at its rear face are apart by their times."""
    speed = 20.0
    track = path(at(20, 0, 0), velocity=(speed, 0, 0))
    wide = car(size=(4.0, 30.0, 3.0))
    world = scene(actors=[(wide, track)], with_ground=False)
    sweep = sweep_of(world)
    x = in_global(world, sweep)[:, 0]
    rear = ORIGIN[0] + 20 + speed * (0.4 + sweep.time) - 2.0
    assert np.ptp(rear) > 0.2
    assert np.std(x - rear) < 0.03
    later = in_global(world, sweep_of(world, t_end=0.45), t_end=0.45)[:, 0]
    assert np.median(later) - np.median(x) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("yaw_rate", [0.0, 0.4])
def test_a_static_wall_stays_flat_while_the_ego_drives_and_is_smeared_without_compensation(yaw_rate):
    world = scene(walls=[wall_ahead(30.0)], ego=path(ORIGIN, velocity=(20, 0, 0), yaw_rate=yaw_rate), with_ground=False)
    sweep = sweep_of(world)
    x = in_global(world, sweep)[:, 0]
    assert np.mean(x) == pytest.approx(ORIGIN[0] + 30, abs=0.01)
    assert np.std(x) < 0.04
    # Undo the compensation: what the sensor saw, as if the ego had stood at its last pose.
    some = np.arange(0, len(x), 20)
    at_end = world.ego.pose(0.4) @ FRONT.ego_T_sensor
    smeared = []
    for when, point in zip(sweep.time[some], in_global(world, sweep)[some], strict=True):
        at_firing = world.ego.pose(0.4 + float(when)) @ FRONT.ego_T_sensor
        smeared.append(transform(at_end @ invert(at_firing), point[None])[0, 0])
    assert np.std(smeared) > 0.08


def test_times_run_backwards_from_the_end_of_the_turn():
    sweep = sweep_of(scene(walls=[wall_ahead(25.0)]))
    assert -0.1 <= sweep.time.min() < sweep.time.max() <= 0
    front = np.abs(np.degrees(np.arctan2(-sweep.points[:, 0], sweep.points[:, 1]))) < 0.5
    assert np.median(sweep.time[front]) == pytest.approx(-0.1 * (1 - 105 / 360), abs=5e-4)


def share_returned(distance, reflectivity, condition=None, max_range=100.0):
    model = replace(HDL32E, max_range=max_range)
    lidar = Lidar(model=model, translation=[0.0, 0.0, 1.8], columns=1085, sector_deg=[-3.0, 3.0], rate=10.0)
    world = scene(walls=[wall_ahead(distance, reflectivity, height=120.0)], condition=condition, with_ground=False)
    sweep = sweep_of(world, lidar)
    level = np.abs(model.elevation_deg) < 6
    aimed = np.isin(firing_pattern(lidar)[1], np.flatnonzero(level)).sum()
    of_the_wall = sweep.ring[sweep.body == WORLD]
    return np.isin(of_the_wall, model.ring[level]).sum() / aimed


def test_a_ten_per_cent_target_is_lost_at_a_third_of_the_range():
    assert share_returned(28.0, 0.1) > 0.85
    assert share_returned(33.3, 0.1) == pytest.approx(0.5, abs=0.1)
    assert share_returned(40.0, 0.1) < 0.1
    assert share_returned(80.0, 0.9) > 0.9
    assert share_returned(80.0, 0.9, max_range=60.0) == 0.0


def test_fog_shortens_the_range():
    fog = Condition(name="fog", visibility=50.0)
    assert share_returned(25.0, 0.5) > 0.95
    assert share_returned(25.0, 0.5, fog) < 0.4  # e^(-2 alpha r) = 0.05
    assert share_returned(14.5, 0.1, fog) == pytest.approx(0.5, abs=0.2)


def test_night_changes_nothing():
    world = [scene(walls=[wall_ahead(25.0)], condition=Condition(illuminance=lux)) for lux in (2.0, 80_000.0)]
    np.testing.assert_array_equal(sweep_of(world[0]).points, sweep_of(world[1]).points)


def test_the_byte_follows_reflectivity_and_sheeting_exceeds_a_hundred():
    for reflectivity, low, high in ((0.1, 8, 11), (0.6, 54, 62), (0.9, 180, 255)):
        sweep = sweep_of(scene(walls=[wall_ahead(12.0, reflectivity)], with_ground=False))
        ahead = np.abs(np.arctan2(sweep.points[:, 0], sweep.points[:, 1])) < 0.1
        assert low <= np.median(sweep.intensity[ahead & (sweep.ring > 20)]) <= high
        assert np.all(sweep.intensity == np.round(sweep.intensity))


def test_glancing_rays_return_less():
    along = box((100.0, 0.5, 6.0), at(60, 6, 3), 0.3)
    sweep = sweep_of(scene(walls=[along], with_ground=False))
    assert np.linalg.norm(sweep.points, axis=1).max() < 40  # cos(incidence) falls as 1/r: power with r^-3
    assert share_returned(45.0, 0.3) > 0.85


def test_an_empty_world_gives_no_points():
    sweep = sweep_of(scene(with_ground=False))
    assert sweep.points.shape == (0, 3)
    assert sweep.body.shape == sweep.ring.shape == sweep.time.shape == sweep.intensity.shape == (0,)


def test_a_hidden_car_is_aimed_at_but_not_reached():
    wide = car(size=(4.5, 4.0, 3.0))
    actors = [(wide, path(at(12, 0, 0))), (wide, path(at(25, 0, 0))), (wide, path(at(20, 8, 0)))]
    sweep = sweep_of(scene(actors=actors))
    assert sweep.aimed[1] > 30
    assert sweep.reached[1] < 0.1 * sweep.aimed[1]
    assert sweep.reached[2] == sweep.aimed[2] > 100
    assert np.count_nonzero(sweep.body == 2) <= sweep.reached[2]


def test_a_mis_mounted_sensor_turns_the_picture():
    world = scene(walls=[wall_ahead(25.0)], with_ground=False)
    off = FRONT.ego_T_sensor @ from_rpy(0, 0, np.radians(2.0))
    points = in_global(world, sweep_of(world, ego_T_sensor=off))
    slope = np.polyfit(points[:, 1], points[:, 0], 1)[0]
    assert np.degrees(np.arctan(slope)) == pytest.approx(2.0, abs=0.1)


def test_the_same_stream_gives_the_same_bytes():
    world = scene(walls=[wall_ahead(25.0)], actors=[(car(), path(at(14, 2, 0), velocity=(3, 1, 0)))])
    one, two, other = sweep_of(world), sweep_of(world), sweep_of(world, key=1)
    assert one.points.tobytes() == two.points.tobytes()
    assert one.intensity.tobytes() == two.intensity.tobytes()
    assert one.points.tobytes() != other.points.tobytes()
