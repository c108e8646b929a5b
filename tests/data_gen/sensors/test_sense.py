"""All sensors answer to one call, and their data say of themselves what the recording needs to know."""

from dataclasses import fields, replace

import numpy as np
import pytest

from data_gen.rig.mounts import Camera, Lidar
from data_gen.scene.conditions import Condition
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.radar import radar
from data_gen.sensors.sense import sense, sense_each
from fusion_net.common.fault_effects import MUD, BlockedLens, FewerBeams, LostPoints
from fusion_net.common.faults import SensorFaults
from fusion_net.common.geometry import rigid
from fusion_net.common.random import stream
from tests.fixtures.box_world import ORIGIN, at, box, path, reflectors, scene
from tests.fixtures.lidar_models import HDL32E
from tests.fixtures.radar_world import CORNER, RADAR, point_actor

CAMERA = Camera(translation=[1.0, 0.0, 1.6], rate=10.0, width=64, height=32, hfov_deg=60.0)
LIDAR = Lidar(translation=[0.9, 0.0, 1.8], rate=10.0, columns=180, model=HDL32E)
WET = Condition("spray", rain_rate=20.0, water_film=1.0, spray=True)


@pytest.fixture(scope="module")
def street():
    """A car ahead that throws up spray, one that stands in a corner, and a rail to the left that mirrors both."""
    rail = reflectors([at(x, 6.0, 0.8) for x in range(1, 60)], 5.0, (0.0, -1.0, 0.0))
    wall = box((60.0, 0.2, 3.0), at(30.0, 6.1, 1.5))
    moving, standing = path(at(20, 1, 0), velocity=(14.0, 0, 0)), path(at(15, -6, 0))
    ego = path(ORIGIN, velocity=(10.0, 0, 0))
    actors = [(point_actor(20.0), moving), (point_actor(25.0), standing)]
    return scene(actors=actors, walls=[wall], scatterers=rail, ego=ego, condition=WET)


def event(mount, key=0, *, time=0.5, **others):
    return CaptureEvent.nominal(mount, time, stream(3, mount.modality, key), **others)


def radar_events():
    """Different radars at different times, one of them not where its mount says."""
    knocked = rigid(np.eye(3), [0.1, 0.0, 0.0]) @ RADAR.ego_T_sensor
    return [event(RADAR, 0), event(CORNER, 1, time=0.7), event(RADAR, 2, time=0.9, ego_T_sensor=knocked)]


def assert_equal(a, b):
    assert type(a) is type(b)
    for field in fields(a):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


def test_radars_that_are_cast_together_measure_what_each_does_alone(street):
    together = radar.sense_batch(street, radar_events())
    for one, alone in zip(together, (radar.sense(street, each) for each in radar_events()), strict=True):
        assert len(one.x) > 5
        assert_equal(one, alone)


def test_events_of_all_kinds_come_back_in_the_order_in_which_they_were_asked(street):
    def events():
        first, second, third = radar_events()
        return [first, event(CAMERA), second, event(LIDAR), third]

    for data, alone in zip(sense_each(street, events()), events(), strict=True):
        assert_equal(data, sense(street, alone))


def test_a_camera_has_rays_and_no_points_a_radar_points_and_no_rays_a_lidar_both(street):
    frame, sweep, scan = (sense(street, event(mount)) for mount in (CAMERA, LIDAR, RADAR))
    assert [len(data.points_in_sensor_frame) > 0 for data in (frame, sweep, scan)] == [False, True, True]
    assert [len(data.point_bodies) for data in (frame, sweep, scan)] == [0, len(sweep.points), len(scan.x)]
    assert [np.shape(data.ray_counts[0]) for data in (frame, sweep, scan)] == [(2,), (2,), ()]


def with_fault(mount, effect):
    return event(mount, faults=SensorFaults(((effect, (1, "scene", 0)),)))


def test_faults_cover_the_image_and_leave_what_is_true_of_each_pixel(street):
    blocked = with_fault(CAMERA, BlockedLens(fraction=0.5))
    frame = sense(street, blocked)
    left = frame.with_faults(blocked, 0)
    covered = (left.image == MUD).all(axis=-1)
    assert covered.mean() == pytest.approx(0.5, abs=0.02)
    np.testing.assert_array_equal(left.image[~covered], frame.image[~covered])
    assert_equal(replace(left, image=frame.image), frame)


@pytest.mark.parametrize(("mount", "effect"), [(LIDAR, FewerBeams(keep=8)), (RADAR, LostPoints(fraction=0.5))])
def test_faults_take_whole_points_and_no_ray_that_was_counted(street, mount, effect):
    faulty = with_fault(mount, effect)
    data = sense(street, faulty)
    left = data.with_faults(faulty, 0)
    points, kept = data.points_in_sensor_frame, left.points_in_sensor_frame
    assert 0 < len(kept) < len(points)
    assert {tuple(point) for point in kept} < {tuple(point) for point in points}
    np.testing.assert_array_equal(left.ray_counts[0], data.ray_counts[0])
