import numpy as np
import pytest
from box_world import ORIGIN, at, box, car, path, reflectors, scene

from data_gen.conditions import Condition
from data_gen.mesh import Asset, Mesh
from data_gen.random import stream
from data_gen.rig import Radar
from data_gen.scene import NOTHING, WORLD
from data_gen.sensors.radar import MOVING, ONCOMING, STATIONARY, detect_radar, sensor_velocity
from data_gen.sensors.radar_detection import Echoes, detect, link_budget_db
from fusion_net.geometry import from_rpy

RADAR = Radar(translation=[3.41, 0.3, 0.5], rotation_deg=[0.0, 0.0, 2.0], rate=20.0, fov_deg=60.0)
CORNER = Radar(translation=[2.4, -0.8, 0.7], rotation_deg=[0.0, 0.0, -31.0], rate=20.0, fov_deg=60.0)
STATIC = np.int32(WORLD)


def scan_of(world, radar=RADAR, t=0.5, key=0, **more):
    return detect_radar(world, radar, t=t, rng=stream(11, key), **more)


def of_body(scan, body):
    return scan.body == body


def seen_at(world, radar, body, t=0.5, scans=40):
    """Mean of each column over the detections of one body in many scans."""
    found = [scan_of(world, radar, t, key) for key in range(scans)]
    keep = [of_body(scan, body) for scan in found]
    names = ("range", "azimuth", "doppler", "vx_comp", "vy_comp", "rcs", "snr_db", "dyn_prop")
    return {n: np.concatenate([getattr(s, n)[k] for s, k in zip(found, keep, strict=True)]) for n in names}


def point_actor(rcs=15.0, height=0.8):
    """A body that only radar sees: a reflector over a mesh too small to hit."""
    asset = car(reflectors([0, 0, height], rcs))
    return Asset("point", "vehicle.car", asset.size, _tiny(asset.mesh), asset.scatterers)


def _tiny(mesh):
    return Mesh(mesh.vertices * np.float32(1e-3), mesh.faces, mesh.surface)


def echoes(range_=50.0, azimuth_deg=0.0, doppler=0.0, snr=1e4):
    values = np.broadcast_arrays(range_, np.radians(azimuth_deg), doppler, np.asarray(snr, float))
    columns = [np.atleast_1d(np.array(v, float)) for v in values]
    return Echoes(*columns, np.arange(len(columns[0]), dtype=np.int32))


def detections(reflections, radar=RADAR, trials=300):
    """Number of detections in each of many scans of the same reflections."""
    return np.array([len(detect(reflections, radar, stream(2, k)).range) for k in range(trials)])


def test_detection_probability_is_nine_tenths_at_ten_dbsm_and_falls_with_the_fourth_power_of_range():
    def share(rcs, distance):
        snr = 10 ** ((rcs + link_budget_db(distance, 0.0, RADAR)) / 10)
        one = echoes(distance, 0.0, 0.0, np.array([snr]))
        return detections(one, trials=1000).mean()

    assert share(10, 100) == pytest.approx(0.9, abs=0.03)
    assert share(-8, 58) == pytest.approx(0.5, abs=0.05)
    assert share(2, 102) == pytest.approx(0.5, abs=0.05)
    assert share(10, 162) == pytest.approx(0.5, abs=0.05)
    assert link_budget_db(40.0, 0.0, RADAR) - link_budget_db(80.0, 0.0, RADAR) == pytest.approx(12.04, abs=0.01)
    assert link_budget_db(40.0, np.radians(60), RADAR) == pytest.approx(link_budget_db(40.0, 0.0, RADAR) - 6)


def test_two_targets_one_degree_apart_are_one_detection_unless_their_speed_or_range_differs():
    strong = {"snr": 1e5}
    assert detections(echoes(50.0, [10.0, 11.0], **strong)).mean() == pytest.approx(1.0, abs=0.02)
    assert detections(echoes(50.0, [10.0, 15.0], **strong)).mean() == pytest.approx(2.0, abs=0.02)
    assert detections(echoes(50.0, [10.0, 11.0], [0.0, 3.0], **strong)).mean() == pytest.approx(2.0, abs=0.02)
    assert detections(echoes([50.0, 52.0], 10.0, **strong)).mean() == pytest.approx(2.0, abs=0.02)
    # One array resolves worse towards its sides: 5 degrees are apart ahead and together at 58.
    assert detections(echoes(50.0, [53.0, 58.0], **strong)).mean() == pytest.approx(1.0, abs=0.02)


def test_a_cell_sums_power_and_lies_between_its_reflections():
    pair = echoes(50.0, [-1.0, 1.0], snr=np.array([3e4, 1e4]))
    found = [detect(pair, RADAR, stream(4, k)) for k in range(800)]
    snr = np.concatenate([f.snr for f in found])
    assert snr.mean() == pytest.approx(4e4, rel=0.1)
    azimuth = np.degrees(np.concatenate([f.azimuth for f in found]))
    assert -0.7 < azimuth.mean() < -0.1


def test_noise_follows_the_cell_the_snr_and_the_cosine():
    def spread(azimuth_deg, snr):
        found = [detect(echoes(60.0, azimuth_deg, 5.0, np.array([snr])), RADAR, stream(8, k)) for k in range(800)]
        kept = [f for f in found if len(f.range) and f.snr[0] > snr / 2]
        return [np.std(np.concatenate([getattr(f, n) for f in kept])) for n in ("range", "azimuth", "doppler")]

    strong, weak, side = spread(0.0, 1e5), spread(0.0, 30.0), spread(60.0, 1e5)
    assert strong[0] == pytest.approx(0.05 * 0.4, rel=0.15)
    assert strong[1] == pytest.approx(np.radians(0.3 * 3.2), rel=0.15)
    assert strong[2] == pytest.approx(0.05 * 0.1, rel=0.15)
    assert all(w > 1.3 * s for w, s in zip(weak, strong, strict=True))
    assert side[1] == pytest.approx(2 * strong[1], rel=0.15)


def test_what_recedes_has_positive_doppler_and_a_standing_sensor_needs_no_compensation():
    for vx, code in ((12.0, MOVING), (-12.0, ONCOMING), (0.0, STATIONARY)):
        world = scene(actors=[(point_actor(), path(at(40 - vx / 2, 0.3, 0), velocity=(vx, 0, 0)))])
        seen = seen_at(world, RADAR, 0)
        assert len(seen["doppler"]) > 30
        assert np.mean(seen["doppler"]) == pytest.approx(vx, abs=0.05)
        assert set(seen["dyn_prop"]) == {code}
        azimuth = seen["azimuth"].mean()
        assert azimuth == pytest.approx(-np.radians(2), abs=5e-3)  # the boresight is turned to the left
        assert seen["vx_comp"].mean() == pytest.approx(vx * np.cos(azimuth), abs=0.05)
        assert seen["vy_comp"].mean() == pytest.approx(vx * np.sin(azimuth), abs=0.05)


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
    seen = seen_at(world, CORNER, 0, t)
    lever = sensor[:3, 3] - pose[:3, 3]
    own = ego.at(t)[2] + np.cross([0, 0, rate], lever)
    ray = np.add(place, [0, 0, 0.8]) - sensor[:3, 3]
    ray /= np.linalg.norm(ray)
    np.testing.assert_allclose(sensor_velocity(world, CORNER.ego_T_sensor, t), sensor[:3, :3].T @ own, atol=1e-3)
    assert seen["doppler"].mean() == pytest.approx(ray @ (target_velocity - own), abs=0.02)
    ground = np.hypot(seen["vx_comp"], seen["vy_comp"])
    assert ground.mean() == pytest.approx(abs(ray @ target_velocity), abs=0.06)


@pytest.mark.parametrize("yaw_rate", [0.0, -0.4])
@pytest.mark.parametrize("radar", [RADAR, CORNER], ids=["front", "corner"])
def test_what_stands_still_has_no_compensated_velocity(radar, yaw_rate):
    ego = path(ORIGIN, velocity=(20, 0, 0), yaw_rate=yaw_rate)
    posts = [at(x, y, 0.6) for x in (25, 40, 55) for y in (-20, -8, 2, 9)]
    world = scene(ego=ego, scatterers=reflectors(posts, 20.0))
    seen = seen_at(world, radar, WORLD)
    assert len(seen["doppler"]) > 100
    assert seen["doppler"].mean() < -10
    # The azimuth's error turns some of the own speed into cross-talk: 1 degree of 20 m/s at the side.
    assert abs(seen["vx_comp"]).max() < 1.8
    assert np.median(np.hypot(seen["vx_comp"], seen["vy_comp"])) < 0.18
    assert np.mean(seen["dyn_prop"] == STATIONARY) > 0.93


def test_a_mis_mounted_sensor_compensates_wrongly():
    posts = reflectors([at(40, y, 0.5) for y in (-20, 20)], 20.0)
    world = scene(ego=path(ORIGIN, velocity=(20, 0, 0)), scatterers=posts)
    off = RADAR.ego_T_sensor @ from_rpy(0, 0, np.radians(3.0))
    scan = scan_of(world, ego_T_sensor=off)
    wall = of_body(scan, WORLD)
    assert np.abs(np.hypot(scan.vx_comp, scan.vy_comp)[wall]).min() > 0.25


def test_doppler_folds_at_the_limit():
    radar = Radar(translation=[3.4, 0.0, 0.5], rate=20.0, max_doppler=15.0)
    world = scene(actors=[(point_actor(), path(at(20, 0, 0), velocity=(18.0, 0, 0)))])
    assert seen_at(world, radar, 0)["doppler"].mean() == pytest.approx(18.0 - 30.0, abs=0.05)


def test_wheels_spread_and_bodies_do_not():
    def spread(height):
        world = scene(actors=[(point_actor(height=height), path(at(30, 0, 0), velocity=(10.0, 0, 0)))])
        return np.std(seen_at(world, RADAR, 0, scans=150)["doppler"])

    assert spread(0.8) < 0.02
    assert spread(0.3) == pytest.approx(0.3, rel=0.3)


def test_a_reflector_shows_from_the_side_that_it_faces():
    for normal, seen in (((-1.0, 0, 0), True), ((1.0, 0, 0), False), ((0.0, 0, 0), True)):
        asset = point_actor(20.0)
        asset = Asset("p", "", asset.size, asset.mesh, reflectors([0, 0, 0.8], 20.0, normal))
        world = scene(actors=[(asset, path(at(30, 0, 0), yaw=0.3))])
        assert np.any([np.any(scan_of(world, key=k).body == 0) for k in range(10)]) == seen


def test_walls_hide_and_one_in_twenty_passes_under_a_car_at_a_tenth_of_the_power():
    target = (point_actor(40.0, height=0.7), path(at(45, 0.3, 0)))
    wall = scene(actors=[target], walls=[box((0.3, 20.0, 6.0), at(25, 0, 3))])
    assert len(seen_at(wall, RADAR, 0, scans=60)["range"]) == 0
    lead = scene(actors=[target, (car(), path(at(25, 0, 0)))])
    under = seen_at(lead, RADAR, 0, scans=600)
    free = seen_at(scene(actors=[target]), RADAR, 0, scans=200)
    assert len(under["range"]) / 600 == pytest.approx(0.05, abs=0.03)
    assert np.log10(np.mean(10 ** (free["rcs"] / 10)) / np.mean(10 ** (under["rcs"] / 10))) == pytest.approx(1, abs=0.2)


def test_fog_and_night_leave_it_alone_and_rain_hardly_matters():
    target = (point_actor(), path(at(60, 0, 0)))
    clear, fog, rain = (
        scene(actors=[target], condition=c)
        for c in (Condition(), Condition(visibility=50.0, illuminance=1.0), Condition(rain_rate=25.0))
    )
    np.testing.assert_array_equal(scan_of(clear).x, scan_of(fog).x)
    snr = [np.mean(10 ** (seen_at(w, RADAR, 0, scans=200)["snr_db"] / 10)) for w in (clear, rain)]
    lost = 10 * np.log10(snr[0] / snr[1])  # 11.4 dB/km over 2 x 57 m
    assert lost == pytest.approx(1.3, abs=0.8)
    assert link_budget_db(100.0, 0.0, RADAR) - link_budget_db(100.0, 0.0, RADAR, 25.0) == pytest.approx(2.3, abs=0.1)


def test_inferred_cross_section_is_the_true_one_on_average():
    world = scene(actors=[(point_actor(18.0), path(at(40, 5, 0)))])
    rcs = seen_at(world, RADAR, 0, scans=400)["rcs"]
    assert 10 * np.log10(np.mean(10 ** (rcs / 10))) == pytest.approx(18.0, abs=0.7)


def test_an_empty_scene_gives_nothing_but_clutter_most_of_it_at_rest():
    ego = path(ORIGIN, velocity=(20, 0, 0))
    scans = [scan_of(scene(ego=ego), key=k) for k in range(200)]
    assert all(np.all(s.body == NOTHING) for s in scans)
    assert np.mean([len(s.x) for s in scans]) == pytest.approx(5, abs=0.6)
    codes = np.concatenate([s.dyn_prop for s in scans])
    assert np.mean(codes == STATIONARY) == pytest.approx(0.71, abs=0.06)
    distance = np.concatenate([s.range for s in scans])
    assert np.mean(distance < 50) == pytest.approx(0.25, abs=0.05)  # evenly over the ground


def test_nothing_outside_the_field_of_view_or_beyond_the_range():
    places = [at(x, y, 0.5) for x in np.linspace(-100, 150, 40) for y in np.linspace(-90, 90, 31)]
    scan = scan_of(scene(scatterers=reflectors(places, 30.0)), CORNER)
    found = of_body(scan, WORLD)
    assert found.sum() > 100
    assert np.abs(np.degrees(scan.azimuth[found])).max() < 64.5
    assert scan.range.max() < 100.5
    np.testing.assert_allclose(np.hypot(scan.x, scan.y), scan.range, rtol=1e-5)
    np.testing.assert_allclose(np.arctan2(scan.y, scan.x), scan.azimuth, atol=1e-5)


def test_the_same_stream_gives_the_same_bytes():
    world = scene(actors=[(car(reflectors([[-2.2, 0, 0.5], [2.2, 0.9, 0.5]], 10.0)), path(at(30, 2, 0)))])
    one, two, other = scan_of(world), scan_of(world), scan_of(world, key=1)
    assert all(getattr(one, n).tobytes() == getattr(two, n).tobytes() for n in vars(one))
    assert one.x.tobytes() != other.x.tobytes()
