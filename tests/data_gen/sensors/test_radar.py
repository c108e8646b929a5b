from dataclasses import replace
from math import erf

import numpy as np
import pytest

from data_gen.assets.shapes.mesh import Asset
from data_gen.rig.mounts import Radar
from data_gen.scene.scene import NOTHING, WORLD
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.radar.detection import DIRECT, UNDERBODY, link_budget_db
from data_gen.sensors.radar.echoes import (
    OBLIQUE_DB,
    UNDERBODY_GAIN,
    UNDERBODY_PROBABILITY,
    sensor_velocity,
    visible_echoes,
)
from data_gen.sensors.radar.flags import AMBIGUOUS, MAYBE_STATIONARY, UNAMBIGUOUS
from data_gen.sensors.radar.radar import MOVING, ONCOMING, STATIONARY, STATIONARY_SPEED
from fusion_net.common.geometry import from_rpy
from fusion_net.common.random import stream
from tests.fixtures.box_world import ORIGIN, at, box, car, path, reflectors, scene
from tests.fixtures.radar_world import CORNER, RADAR, point_actor, scan_of, seen_at, sigma


def test_what_recedes_has_positive_doppler_and_a_standing_sensor_needs_no_compensation():
    for vx, code in ((12.0, MOVING), (-12.0, ONCOMING), (0.0, STATIONARY)):
        world = scene(actors=[(point_actor(), path(at(40 - vx / 2, 0.3, 0), velocity=(vx, 0, 0)))])
        seen = seen_at(world, scans=200, body=0)
        count = len(seen["doppler"])
        assert count > 150
        errors = 3 * np.sqrt(np.mean(sigma(10 ** (seen["snr_db"] / 10)) ** 2, axis=0) / count)  # of a mean
        assert np.mean(seen["doppler"]) == pytest.approx(vx, abs=errors[2] + 1e-3)  # 1e-3: the ray rises by 0.5 degrees
        assert set(seen["dyn_prop"]) == {code}
        azimuth = seen["azimuth"].mean()
        assert azimuth == pytest.approx(-np.radians(2), abs=errors[1])  # the boresight is turned to the left
        assert seen["vx_comp"].mean() == pytest.approx(vx * np.cos(azimuth), abs=0.02)
        assert seen["vy_comp"].mean() == pytest.approx(vx * np.sin(azimuth), abs=0.02)


def test_doppler_is_the_relative_velocity_along_the_ray_with_the_lever_arm_of_a_turning_ego():
    """v_r = u . (v_target - v_ego - omega x lever), by hand."""
    rate, speed = 0.5, 15.0
    ego = path(ORIGIN, velocity=(speed, 0, 0), yaw_rate=rate)
    target_velocity = np.array([4.0, -6.0, 0.0])
    t = 0.5
    pose = ego.pose(t)
    sensor = pose @ CORNER.ego_T_sensor
    place = sensor[:3, 3] + sensor[:3, :3] @ [30.0, -8.0, 0.1]
    place[2] = 0.0
    world = scene(ego=ego, actors=[(point_actor(), path(place - t * target_velocity, velocity=target_velocity))])
    seen = seen_at(world, CORNER, t, body=0)
    lever = sensor[:3, 3] - pose[:3, 3]
    own = ego.at(t)[2] + np.cross([0, 0, rate], lever)
    ray = np.add(place, [0, 0, 0.8]) - sensor[:3, 3]
    ray /= np.linalg.norm(ray)
    np.testing.assert_allclose(sensor_velocity(world, CORNER.ego_T_sensor, t), sensor[:3, :3].T @ own, atol=1e-3)
    assert seen["doppler"].mean() == pytest.approx(ray @ (target_velocity - own), abs=0.01)
    ground = np.hypot(seen["vx_comp"], seen["vy_comp"])
    assert ground.mean() == pytest.approx(abs(ray @ target_velocity), abs=0.06)


@pytest.mark.parametrize("yaw_rate", [0.0, -0.4])
@pytest.mark.parametrize("radar", [RADAR, CORNER], ids=["front", "corner"])
def test_what_stands_still_has_no_compensated_velocity_but_for_the_error_of_azimuth(radar, yaw_rate):
    """Compensation adds u(azimuth) . v: an error d of the azimuth leaves d v_perpendicular, with d = sigma / cos(azimuth)."""
    ego = path(ORIGIN, velocity=(20, 0, 0), yaw_rate=yaw_rate)
    posts = [at(x, y, 0.6) for x in (25, 40, 55) for y in (-20, -8, 2, 9)]
    world = scene(ego=ego, scatterers=reflectors(posts, 20.0))
    seen = seen_at(world, radar, body=WORLD, scans=100)
    count = len(seen["doppler"])
    assert count > 250
    assert seen["doppler"].mean() < -10
    own = sensor_velocity(world, radar.ego_T_sensor, 0.5)
    azimuth = seen["azimuth"].astype(float)
    _, sine, speed = sigma(10 ** (seen["snr_db"].astype(float) / 10)).T
    across = own[1] * np.cos(azimuth) - own[0] * np.sin(azimuth)
    expected = np.hypot(speed, across * sine / np.cos(azimuth))
    ground = seen["vx_comp"] * np.cos(azimuth) + seen["vy_comp"] * np.sin(azimuth)
    assert np.abs(ground / expected).max() < 4.5
    assert np.std(ground / expected) == pytest.approx(1, abs=4 / np.sqrt(2 * count))
    called_still = np.mean([erf(STATIONARY_SPEED / (s * 2**0.5)) for s in expected])
    assert called_still > 0.9
    margin = 3 * np.sqrt(max(called_still * (1 - called_still), 1e-3) / count)
    assert np.mean(seen["dyn_prop"] == STATIONARY) == pytest.approx(called_still, abs=margin)


def test_a_mis_mounted_sensor_compensates_wrongly():
    posts = reflectors([at(40, y, 0.5) for y in (-20, 20)], 20.0)
    world = scene(ego=path(ORIGIN, velocity=(20, 0, 0)), scatterers=posts)
    off = RADAR.ego_T_sensor @ from_rpy(0, 0, np.radians(3.0))
    scan = scan_of(world, ego_T_sensor=off)
    wall = scan.body == WORLD
    assert np.abs(np.hypot(scan.vx_comp, scan.vy_comp)[wall]).min() > 0.25


def test_doppler_folds_at_the_limit():
    radar = Radar(translation=[3.4, 0.0, 0.5], rate=20.0, max_doppler=15.0)
    world = scene(actors=[(point_actor(), path(at(20, 0, 0), velocity=(18.0, 0, 0)))])
    assert seen_at(world, radar, body=0)["doppler"].mean() == pytest.approx(18.0 - 30.0, abs=0.05)


@pytest.mark.parametrize(
    ("limit", "velocity", "measured", "compensated", "state"),
    [
        (111.0, -30.0, -60.0, -30.0, UNAMBIGUOUS),
        (25.0, 0.0, 20.0, 0.0, UNAMBIGUOUS),  # the next fold is 50 m/s over ground: nobody drives as fast
        (25.0, -30.0, -10.0, 20.0, AMBIGUOUS),  # 20 away or 30 towards: the car takes the lesser, and errs
        (25.0, 10.0, -20.0, 10.0, AMBIGUOUS),
        (15.0, 0.0, 0.0, 0.0, MAYBE_STATIONARY),
    ],
)
def test_a_car_takes_the_least_speed_over_ground_that_folds_into_the_measured_doppler(
    limit, velocity, measured, compensated, state
):
    """The ego drives at 30 m/s; the target ahead at ``velocity``. Ground speed = Doppler + 30 + 2 k limit."""
    radar = Radar(translation=[3.4, 0.0, 0.8], rate=20.0, max_doppler=limit)
    ego = path(ORIGIN, velocity=(30.0, 0, 0))
    world = scene(ego=ego, actors=[(point_actor(), path(at(55 - velocity / 2, 0, 0), velocity=(velocity, 0, 0)))])
    seen = seen_at(world, radar, body=0)
    assert np.median(seen["doppler"]) == pytest.approx(measured, abs=0.05)
    assert np.median(seen["vx_comp"]) == pytest.approx(compensated, abs=0.05)
    assert set(seen["ambig_state"]) == {state}


def test_wheels_spread_and_bodies_do_not():
    def spread(height):
        world = scene(actors=[(point_actor(height=height), path(at(30, 0, 0), velocity=(10.0, 0, 0)))])
        return np.std(seen_at(world, scans=150, body=0)["doppler"])

    assert spread(0.8) < 0.02
    assert spread(0.3) == pytest.approx(0.3, rel=0.2)  # three standard errors


def test_a_reflector_shows_from_the_side_that_it_faces():
    for normal, seen in (((-1.0, 0, 0), True), ((1.0, 0, 0), False), ((0.0, 0, 0), True)):
        asset = point_actor(20.0)
        asset = Asset("p", "", asset.size, asset.mesh, reflectors([0, 0, 0.8], 20.0, normal))
        world = scene(actors=[(asset, path(at(30, 0, 0), yaw=0.3))])
        assert np.any([np.any(scan_of(world, key=k).body == 0) for k in range(10)]) == seen


@pytest.mark.parametrize(("turn_deg", "loss"), [(0, 0.0), (44, 0.0), (60, -3.0), (70, -6.3), (89, OBLIQUE_DB)])
def test_a_flat_reflector_sends_obliquely_most_of_the_wave_elsewhere(turn_deg, loss):
    """(cos / cos 45)^2 beyond 45 degrees (Lambert), down to what its edges return."""
    turn = np.radians(turn_deg)
    flat = reflectors(at(43.41, 0.3, 0.5), 10.0, (-np.cos(turn), np.sin(turn), 0.0))
    (seen,) = visible_echoes(scene(scatterers=flat), [CaptureEvent.nominal(RADAR, 0.0, stream(1))])
    level = 10 * np.log10(seen.snr) - 10.0 - link_budget_db(seen.range, seen.azimuth, RADAR)
    assert level == pytest.approx(loss, abs=0.1)


def test_walls_hide_and_one_in_five_passes_under_a_car_at_a_tenth_of_the_power():
    target = (point_actor(40.0, height=0.7), path(at(45, 0.3, 0)))
    wall = scene(actors=[target], walls=[box((0.3, 20.0, 6.0), at(25, 0, 3))])
    assert len(seen_at(wall, scans=60, body=0)["range"]) == 0
    lead = scene(actors=[target, (car(), path(at(25, 0, 0)))])
    under, free = seen_at(lead, scans=400, body=0), seen_at(scene(actors=[target]), scans=400, body=0)
    assert set(under["cause"]) == {UNDERBODY}
    assert set(free["cause"]) == {DIRECT}
    share = len(under["range"]) / 400  # 0.2, with three standard deviations of 400 coins
    assert share == pytest.approx(UNDERBODY_PROBABILITY, abs=3 * np.sqrt(0.2 * 0.8 / 400))
    power = [np.mean(10 ** (seen["rcs"] / 10)) for seen in (under, free)]
    spread = 3 * np.sqrt(1 / len(under["rcs"]) + 1 / len(free["rcs"]))  # of the ratio of two exponential means
    assert power[0] / power[1] == pytest.approx(UNDERBODY_GAIN, rel=spread)


def test_nothing_is_seen_under_what_stands_on_the_ground_nor_high_up_behind_a_car():
    def seen(height, category):
        lead = car()
        lead = Asset("lead", category, lead.size, lead.mesh, lead.scatterers)
        target = (point_actor(40.0, height=height), path(at(35, 0.3, 0)))
        return len(seen_at(scene(actors=[target, (lead, path(at(25, 0, 0)))]), scans=60, body=0)["range"])

    assert seen(0.7, "vehicle.car") > 0
    assert seen(0.7, "movable_object.barrier") == 0
    assert seen(1.2, "vehicle.car") == 0


def test_inferred_cross_section_is_the_true_one_on_average():
    world = scene(actors=[(point_actor(18.0), path(at(40, 5, 0)))])
    rcs = seen_at(world, scans=400, body=0)["rcs"]
    assert 10 * np.log10(np.mean(10 ** (rcs / 10))) == pytest.approx(18.0, abs=0.7)  # 15 %: three standard errors


def test_an_empty_scene_gives_nothing_but_clutter_most_of_it_at_rest():
    ego = path(ORIGIN, velocity=(20, 0, 0))
    scans = [scan_of(scene(ego=ego), key=k) for k in range(200)]
    assert all(np.all(s.body == NOTHING) for s in scans)
    assert np.mean([len(s.x) for s in scans]) == pytest.approx(5, abs=3 * np.sqrt(5 / 200))
    codes = np.concatenate([s.dyn_prop for s in scans])
    assert np.mean(codes == STATIONARY) == pytest.approx(0.71, abs=0.06)
    distance = np.concatenate([s.range for s in scans])
    assert np.mean(distance < 50) == pytest.approx(0.25, abs=0.05)  # evenly over the ground


def test_nothing_outside_the_field_of_view_or_beyond_the_range():
    places = [at(x, y, 0.5) for x in np.linspace(-100, 150, 40) for y in np.linspace(-90, 90, 31)]
    world = scene(scatterers=reflectors(places, 30.0))
    (exact,) = visible_echoes(world, [CaptureEvent.nominal(CORNER, 0.5, stream(1))])
    assert np.abs(np.degrees(exact.azimuth)).max() <= 60
    assert exact.range.max() <= 100
    scan = scan_of(world, replace(CORNER, max_detections=1000))
    found = scan.body == WORLD
    assert found.sum() > 100
    range_, sine, _ = sigma(
        10 ** (scan.snr_db[found] / 10)
    ).T  # beyond the edge by noise alone: four standard deviations
    assert np.all(np.abs(np.sin(scan.azimuth[found])) < np.sin(np.radians(60)) + 4 * sine)
    assert np.all(scan.range[found] < 100 + 4 * range_)
    np.testing.assert_allclose(np.hypot(scan.x, scan.y), scan.range, rtol=1e-5)
    np.testing.assert_allclose(np.arctan2(scan.y, scan.x), scan.azimuth, atol=1e-5)


def test_a_radar_reports_its_strongest_detections():
    places = [at(x, y, 0.5) for x in range(15, 90, 5) for y in range(-30, 31, 6)]
    world = scene(scatterers=reflectors(places, 25.0))
    everything, few = (scan_of(world, replace(RADAR, max_detections=n)) for n in (1000, 20))
    assert len(everything.x) > 100
    assert len(few.x) == 20
    assert set(few.snr_db) == set(np.sort(everything.snr_db)[-20:])


def test_the_same_stream_gives_the_same_bytes():
    world = scene(actors=[(car(reflectors([[-2.2, 0, 0.5], [2.2, 0.9, 0.5]], 10.0)), path(at(30, 2, 0)))])
    one, two, other = scan_of(world), scan_of(world), scan_of(world, key=1)
    assert all(getattr(one, n).tobytes() == getattr(two, n).tobytes() for n in vars(one))
    assert one.x.tobytes() != other.x.tobytes()
