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
