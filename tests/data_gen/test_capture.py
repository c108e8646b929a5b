from dataclasses import replace

import numpy as np
import pytest

from data_gen.capture import firing_times, keyframe_times
from data_gen.rig import Camera, Lidar, Radar, Rig


@pytest.fixture
def rig():
    return Rig(
        name="out of phase",
        sweeps={"radar": 2, "lidar": 1},
        cameras={
            "CAM_FRONT": Camera(
                translation=[1.7, 0.0, 1.5], rate=30.0, phase=0.0292, width=64, height=32, hfov_deg=70.0
            )
        },
        lidars={"LIDAR_TOP": Lidar(translation=[0.9, 0.0, 1.8], rate=10.0, columns=180)},
        radars={"RADAR_FRONT": Radar(translation=[3.4, 0.0, 0.5], rate=20.0, phase=0.013)},
    )


def test_keyframes_are_ends_of_lidar_turns_half_a_second_apart_with_room_for_the_sweeps_before(rig):
    times = keyframe_times(rig, 4)
    assert times - times[0] == pytest.approx([0.0, 0.5, 1.0, 1.5])
    assert times * 10 == pytest.approx((times * 10).round())
    for mount, sweeps in ((rig.radars["RADAR_FRONT"], 2), (rig.lidars["LIDAR_TOP"], 1)):
        assert firing_times(mount, times[0], sweeps)[0] >= 0


def test_a_sensor_gives_its_latest_firing_at_or_before_the_keyframe(rig):
    camera = rig.cameras["CAM_FRONT"]
    (latest,) = firing_times(camera, 0.3, 0)
    assert 0.3 - 1 / 30 < latest <= 0.3
    assert (latest - camera.phase) * 30 == pytest.approx(round((latest - camera.phase) * 30))
    assert firing_times(rig.lidars["LIDAR_TOP"], 0.3, 2) == pytest.approx([0.1, 0.2, 0.3])


def test_a_firing_exactly_at_the_keyframe_counts(rig):
    radar = rig.radars["RADAR_FRONT"]
    assert firing_times(radar, 0.013 + 7 / 20, 0) == pytest.approx([0.013 + 7 / 20])


def test_jitter_varies_the_firings_about_their_beat_and_never_their_order():
    radar = Radar(translation=[3.4, 0.0, 0.5], rate=20.0, phase=0.013, jitter=0.002)
    times = np.array(firing_times(radar, 100.0, 1900, channel="RADAR_FRONT", seed=3))
    late = times - (0.013 + np.round((times - 0.013) * 20) / 20)
    assert late.std() == pytest.approx(0.002, rel=0.1)
    assert abs(late.mean()) < 2e-4
    assert (np.diff(times) > 0.01).all()
    wild = replace(radar, jitter=1.0)
    assert (np.diff(firing_times(wild, 100.0, 1900, channel="RADAR_FRONT", seed=3)) > 0.009).all()


def test_a_jittered_firing_is_the_same_whoever_asks_and_differs_between_sensors():
    radar = Radar(translation=[3.4, 0.0, 0.5], rate=20.0, jitter=0.002)
    long, short = (firing_times(radar, 5.0, n, channel="RADAR_FRONT", seed=3) for n in (50, 3))
    assert long[-4:] == short
    assert all(t <= 5.0 for t in long)
    assert firing_times(radar, 5.0, 3, channel="RADAR_LEFT", seed=3) != short
    assert firing_times(radar, 5.0, 3, channel="RADAR_FRONT", seed=4) != short


def test_keyframes_are_the_ends_of_turns_as_they_truly_come(rig):
    lidar = replace(rig.lidars["LIDAR_TOP"], jitter=0.001)
    jittered = replace(rig, lidars={"LIDAR_TOP": lidar})
    times, nominal = keyframe_times(jittered, 5, seed=3), keyframe_times(rig, 5)
    assert 0 < np.abs(times - nominal).max() < 0.005
    for t in times:
        assert firing_times(lidar, t, 0, channel="LIDAR_TOP", seed=3) == [t]


@pytest.mark.parametrize(("jitter", "nearest"), [(-0.001, 0.0), (0.02, 0.005)])
def test_a_jitter_that_cannot_be_names_the_nearest(rig, jitter, nearest):
    radars = {"RADAR_FRONT": replace(rig.radars["RADAR_FRONT"], jitter=jitter)}
    with pytest.raises(ValueError, match=rf"jitter={jitter} .* rig.radars.RADAR_FRONT.jitter={nearest}"):
        replace(rig, radars=radars)
