"""The lesson's table of the three sensors, row by row, as facts of the data: what each measures and where each fails."""

from dataclasses import replace

import numpy as np
import pytest

from data_gen.rig.mounts import Camera, Lidar, Radar
from data_gen.scene.conditions import Condition
from data_gen.scene.scene import NOTHING
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.radar.detection import DOUBLE_BOUNCE
from data_gen.sensors.sense import sense
from fusion_net.common.random import stream
from tests.fixtures.box_world import at, box, car, path, reflectors, scene
from tests.fixtures.lidar_models import HDL32E

CAMERA = Camera(translation=[0.0, 0.0, 1.5], width=320, height=96, hfov_deg=50.0, rate=30.0)
LIDAR = Lidar(model=HDL32E, translation=[0.0, 0.0, 1.8], columns=2170, sector_deg=[-25.0, 25.0], rate=10.0)
RADAR = Radar(translation=[0.0, 0.0, 0.5], rate=20.0, max_range=160.0, fov_deg=45.0)

DAY = Condition(illuminance=60_000.0, sun_azimuth=120.0, sun_elevation=45.0)
NIGHT = Condition("night", illuminance=2.0, sun_elevation=-30.0)
GLARE = Condition("glare", illuminance=6_000.0, sun_azimuth=0.0, sun_elevation=4.0)
RAIN = Condition("rain", illuminance=6_000.0, rain_rate=50.0, visibility=300.0, water_film=1.0)
FOG = Condition("fog", illuminance=6_000.0, visibility=50.0)
SPRAY = Condition("spray", illuminance=6_000.0, visibility=3_000.0, water_film=1.2, spray=True)


def target(distance, *, y=0.0, velocity=(0.0, 0.0, 0.0), size=(4.5, 1.9, 1.5), rcs=10.0, reflectivity=0.5):
    """A car ahead of the ego, with one reflector in the middle of its rear, above the wheels."""
    body = car(reflectors([(-size[0] / 2, 0.0, 0.8)], rcs), size, reflectivity)
    return body, path(at(distance + size[0] / 2, y, 0.0), velocity)


def picture(world, *words):
    return sense(world, CaptureEvent.nominal(CAMERA, 0.0, stream(5, *words)))


def cloud(world):
    return sense(world, CaptureEvent.nominal(LIDAR, 0.0, stream(6)))


def echoes(world, scans=12):
    """Detections of the first actor in several scans: range, compensated radial speed."""
    found = [sense(world, CaptureEvent.nominal(RADAR, 0.0, stream(7, k))) for k in range(scans)]
    return [(s.range[s.body == 0], s.doppler[s.body == 0]) for s in found]


def detectability(condition, *, distance=35.0):
    """How far the target's pixels are from what they show without it, in standard deviations of the sensor's noise."""
    actor = target(distance)
    there, gone = scene(actors=[actor], condition=condition), scene(condition=condition)
    first, again = picture(there, 1), picture(there, 2)
    mask = first.body == 0
    with_it, repeated, without = (x.image[mask].astype(float).mean(axis=1) for x in (first, again, picture(gone, 3)))
    noise = np.std(with_it - repeated) / np.sqrt(2)
    return abs(with_it.mean() - without.mean()) / max(noise, 0.5)


def test_outputs_dense_image_sparse_cloud_short_list():
    world = scene(actors=[target(20.0)])
    frame, sweep, scan = picture(world), cloud(world), sense(world, CaptureEvent.nominal(RADAR, 0.0, stream(7)))
    assert frame.image.shape == (96, 320, 3)
    assert len(sweep.points) == len(sweep.intensity) < frame.body.size
    assert len(scan.range) == len(scan.azimuth) == len(scan.doppler) == len(scan.rcs) < 0.02 * len(sweep.points)


def test_semantics_only_the_camera_sees_a_colour():
    first, second = (target(15.0) for _ in range(2))
    second[0].mesh.surface.albedo[:] = (0.6, 0.05, 0.05)
    plain, red = (scene(actors=[actor]) for actor in (first, second))
    change = picture(red).image.astype(int) - picture(plain).image
    assert abs(change[picture(plain).body == 0]).mean() > 20
    np.testing.assert_array_equal(cloud(red).points, cloud(plain).points)
    np.testing.assert_array_equal(cloud(red).intensity, cloud(plain).intensity)
    np.testing.assert_array_equal(echoes(red)[0], echoes(plain)[0])


def test_metric_depth_twice_the_size_at_twice_the_distance_is_the_same_pixels():
    """The lesson's 1.5 m at 30 m and 3 m at 60 m. Without ground and walls nothing else gives the scale."""
    near = scene(actors=[(car(reflectors([(-0.3, 0, 0.7)], 5.0), (0.6, 0.6, 1.5)), path(at(30.0, 0.0, 0.75)))])
    far = scene(actors=[(car(reflectors([(-0.6, 0, 1.4)], 5.0), (1.2, 1.2, 3.0)), path(at(60.0, 0.0, 0.0)))])
    masks = [picture(world).body == 0 for world in (near, far)]
    assert (masks[0] & masks[1]).sum() / (masks[0] | masks[1]).sum() > 0.9
    for world, distance in ((near, 29.7), (far, 59.4)):
        sweep = cloud(world)
        assert np.median(sweep.points[sweep.body == 0, 1]) == pytest.approx(distance, abs=0.05)
        ranges = np.concatenate([r for r, _ in echoes(world)])
        assert ranges.mean() == pytest.approx(distance, abs=RADAR.range_resolution / 4)


def test_velocity_only_the_radar_tells_parked_from_driving():
    parked, driving = (scene(actors=[target(25.0, velocity=(v, 0.0, 0.0))]) for v in (0.0, 15.0))
    np.testing.assert_array_equal(picture(parked).image, picture(driving).image)
    gap = np.median(cloud(driving).points[cloud(driving).body == 0, 1])
    gap -= np.median(cloud(parked).points[cloud(parked).body == 0, 1])
    assert abs(gap) < 15.0 * 0.1  # a smear of a sweep's time, which a single sweep cannot tell from a place
    for world, speed in ((parked, 0.0), (driving, 15.0)):
        measured = np.concatenate([v for _, v in echoes(world)])
        assert measured.mean() == pytest.approx(speed, abs=0.1)
        assert measured.std() < 0.3


def test_angular_resolution_two_posts_one_degree_apart():
    y = 40.0 * np.tan(np.radians(0.5))
    posts = [(car(reflectors([(0, 0, 0.8)], 5.0), (0.2, 0.2, 3.0)), path(at(40.0, side * y, 0.0))) for side in (-1, 1)]
    world = scene(actors=posts)
    body = picture(world).body
    columns = [np.unique(np.nonzero(body == k)[1]) for k in (0, 1)]
    assert len(columns[0])
    assert len(columns[1])
    assert columns[0].min() - columns[1].max() > 1  # background between them
    sweep = cloud(world)
    assert all((sweep.body == k).sum() >= 3 for k in (0, 1))
    scans = [sense(world, CaptureEvent.nominal(RADAR, 0.0, stream(7, k))) for k in range(12)]
    near = [(abs(s.range - 40.0) < 2.0).sum() for s in scans]
    assert np.mean(np.array(near) == 1) > 0.9  # merged in one resolution cell


def test_radar_tells_apart_by_speed_what_it_cannot_by_angle():
    """Two motorcycles a metre apart at 40 m: one detection at the same speed, two at speeds 2 m/s apart."""

    def riders(difference):
        shape = car(reflectors([(-1.0, 0, 0.8)], 15.0), (2.0, 0.7, 1.6))
        return scene(actors=[(shape, path(at(41.0, y, 0.0), (10.0 + y * difference, 0.0, 0.0))) for y in (-0.5, 0.5)])

    def count(world):
        scans = [sense(world, CaptureEvent.nominal(RADAR, 0.0, stream(7, k))) for k in range(20)]
        return np.mean([(s.body >= 0).sum() for s in scans])

    assert count(riders(0.0)) == pytest.approx(1.0, abs=0.1)
    assert count(riders(2.0)) == pytest.approx(2.0, abs=0.1)


def test_only_the_radar_sees_the_car_in_front_of_the_leading_car_and_only_sometimes():
    hidden, lead = target(40.0), target(20.0, size=(4.5, 2.4, 1.9))
    world = scene(actors=[hidden, lead])
    assert not (picture(world).body == 0).any()
    assert not (cloud(world).body == 0).any()
    seen = np.mean([len(r) > 0 for r, _ in echoes(world, scans=200)])
    assert seen == pytest.approx(0.2, abs=0.09)  # by its one reflector; three standard deviations of 200 scans


def test_only_the_radar_sees_a_car_twice_in_a_guard_rail():
    """The mirror image stands behind the rail, where camera and LiDAR see that there is nothing."""
    rail = box((60.0, 0.1, 0.8), at(30.0, 4.05, 0.4))
    strip = reflectors([at(x, 4.0, 0.6) for x in range(1, 60)], -30.0, (0.0, -1.0, 0.0))
    world = scene(actors=[target(30.0, y=-1.0, velocity=(12.0, 0.0, 0.0))], walls=[rail], scatterers=strip)
    scans = [sense(world, CaptureEvent.nominal(RADAR, 0.0, stream(7, k))) for k in range(100)]
    ghosts = [s.y[s.cause == DOUBLE_BOUNCE] for s in scans]
    assert 0.1 < np.mean([len(y) > 0 for y in ghosts]) < 0.5
    assert np.mean(np.concatenate(ghosts)) == pytest.approx(9.0, abs=1.0)  # 2 * 4 + 1
    points = cloud(world).points
    assert points[points[:, 0] < -4.6, 2].max() < 0.2 - LIDAR.translation[2]  # x points to the right; only ground there


def test_range_the_lidar_ends_before_the_radar():
    world = scene(actors=[target(110.0, reflectivity=0.1, size=(8.0, 2.5, 3.0))])
    assert not (cloud(world).body == 0).any()
    assert np.mean([len(r) > 0 for r, _ in echoes(world)]) > 0.6
    assert 5 < (picture(world).body == 0).sum() < 120  # a handful of pixels


def test_night_fails_the_camera_alone():
    assert detectability(NIGHT, distance=60.0) < 0.25 * detectability(DAY, distance=60.0)
    day, night = (scene(actors=[target(40.0)], condition=c) for c in (DAY, NIGHT))
    np.testing.assert_array_equal(cloud(day).points, cloud(night).points)
    np.testing.assert_array_equal(echoes(day)[0], echoes(night)[0])


def test_glare_fails_the_camera_that_faces_the_sun():
    behind = Condition("glare", illuminance=6_000.0, sun_azimuth=180.0, sun_elevation=4.0)
    assert detectability(GLARE) < 0.5 * detectability(behind)
    day, glare = (scene(actors=[target(30.0)], condition=c) for c in (DAY, GLARE))
    counts = [(cloud(world).body == 0).sum() for world in (day, glare)]
    assert counts[1] > 0.9 * counts[0]
    np.testing.assert_array_equal(echoes(day)[0], echoes(glare)[0])


@pytest.mark.parametrize("condition", [RAIN, FOG], ids=["rain", "fog"])
def test_rain_and_fog_degrade_camera_and_lidar_and_leave_the_radar(condition):
    assert detectability(condition, distance=50.0) < 0.6 * detectability(DAY, distance=50.0)
    clear, wet = (scene(actors=[target(50.0, reflectivity=0.3)], condition=c) for c in (DAY, condition))
    returns = [(cloud(world).body == 0).sum() for world in (clear, wet)]
    assert returns[1] < 0.7 * returns[0]
    seen = [np.mean([len(r) > 0 for r, _ in echoes(world)]) for world in (clear, wet)]
    assert seen[1] > seen[0] - 0.1


@pytest.mark.parametrize("condition", [RAIN, FOG, SPRAY], ids=lambda c: c.name)
def test_the_lidar_alone_takes_drops_for_surfaces(condition):
    """Points in the air where no surface is: near the sensor in rain and fog, behind a fast lorry in spray."""
    body, track = target(20.0, velocity=(30.0, 0.0, 0.0), size=(9.0, 2.5, 3.5))
    world = scene(actors=[(replace(body, category="vehicle.truck"), track)], condition=condition)
    sweep = cloud(world)
    false = sweep.body == NOTHING
    rear = np.median(sweep.points[sweep.body == 0, 1]) if (sweep.body == 0).any() else 20.0
    assert false.sum() > 30
    assert np.all(sweep.points[false, 1] < (rear + 3.0 if condition is SPRAY else 12.0))
    assert np.median(sweep.intensity[false]) < 10
    radar = np.concatenate([r for r, _ in echoes(world)])
    assert len(radar) > 8
    assert radar.mean() == pytest.approx(20.0, abs=1.0)


def test_a_wet_road_leaves_the_lidar_without_the_far_ground():
    reach = []
    for film in (0.0, 1.2):
        sweep = cloud(scene(condition=Condition(water_film=film)))
        reach.append(np.quantile(np.linalg.norm(sweep.points, axis=1), 0.99))
    assert reach[1] < 0.75 * reach[0]


@pytest.mark.parametrize("condition", [NIGHT, GLARE, RAIN, FOG], ids=lambda c: c.name)
def test_the_union_covers_the_road(condition):
    """In every bad condition at least one sensor, and outside dense fog two, find the car at 45 m."""
    world = scene(actors=[target(45.0)], condition=condition)
    radar = np.mean([len(r) > 0 for r, _ in echoes(world)]) > 0.8
    lidar = (cloud(world).body == 0).sum() >= 5
    camera = detectability(condition, distance=45.0) > 5
    assert np.sum([radar, lidar, camera]) >= (1 if condition is FOG else 2)
