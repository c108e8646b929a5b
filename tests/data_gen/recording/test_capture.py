"""When sensors fire, and which of their firings are written."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hypothesis import assume, given
from hypothesis import strategies as st

from data_gen.recording.schedule import event_time, events_due, keyframe_times, last_event
from data_gen.rig.mounts import Camera, Lidar, Mount, Radar
from data_gen.rig.rig import Rig
from data_gen.rig.rig_checks import MAX_JITTER
from fusion_net.common.cli.command import CONFIGS, build
from tests.fixtures.lidar_models import HDL32E

FRONT = {"channel": "RADAR_FRONT", "seed": 3}
TOP = {"channel": "LIDAR_TOP", "seed": 3}
KEYFRAMES = 8


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
        lidars={"LIDAR_TOP": Lidar(model=HDL32E, translation=[0.9, 0.0, 1.8], rate=10.0, columns=180)},
        radars={"RADAR_FRONT": Radar(translation=[3.4, 0.0, 0.5], rate=20.0, phase=0.013)},
    )


def test_keyframes_are_ends_of_lidar_turns_half_a_second_apart_with_room_for_the_sweeps_before(rig):
    times = keyframe_times(rig, 4)
    assert times - times[0] == pytest.approx([0.0, 0.5, 1.0, 1.5])
    assert times * 10 == pytest.approx((times * 10).round())
    assert all(numbers[0] >= 0 for numbers in next(events_due(rig, 4, seed=0)).values())


def test_a_sensor_gives_its_latest_firing_at_or_before_the_keyframe(rig):
    camera = rig.cameras["CAM_FRONT"]
    latest = event_time(camera, last_event(camera, 0.3, **FRONT), **FRONT)
    assert 0.3 - 1 / 30 < latest <= 0.3
    assert (latest - camera.phase) * 30 == pytest.approx(round((latest - camera.phase) * 30))


def test_a_firing_exactly_at_the_keyframe_counts(rig):
    assert last_event(rig.radars["RADAR_FRONT"], 0.013 + 7 / 20, **FRONT) == 7
    assert last_event(rig.lidars["LIDAR_TOP"], 0.3, **FRONT) == 3


def event_times(mount, count, *, channel="RADAR_FRONT", seed=3):
    return np.array([event_time(mount, number, channel=channel, seed=seed) for number in range(count)])


def test_jitter_varies_the_firings_about_their_beat_and_never_their_order():
    radar = Radar(translation=[3.4, 0.0, 0.5], rate=20.0, phase=0.013, jitter=0.002)
    late = event_times(radar, 1900) - (0.013 + np.arange(1900) / 20)
    assert late.std() == pytest.approx(0.002, rel=0.1)
    assert abs(late.mean()) < 2e-4
    wildest = replace(radar, jitter=0.1 / radar.rate)
    assert (np.diff(event_times(wildest, 1900)) > 0.009).all()


def test_a_jittered_firing_differs_between_sensors_and_scenes():
    radar = Radar(translation=[3.4, 0.0, 0.5], rate=20.0, jitter=0.002)
    times = event_times(radar, 5)
    assert (times == event_times(radar, 5)).all()
    assert (times != event_times(radar, 5, channel="RADAR_LEFT")).all()
    assert (times != event_times(radar, 5, seed=4)).all()


def test_keyframes_are_the_ends_of_turns_as_they_truly_come(rig):
    lidar = replace(rig.lidars["LIDAR_TOP"], jitter=0.001)
    jittered = replace(rig, lidars={"LIDAR_TOP": lidar})
    times, nominal = keyframe_times(jittered, 5, seed=3), keyframe_times(rig, 5)
    assert 0 < np.abs(times - nominal).max() < 0.005
    for t in times:
        assert event_time(lidar, last_event(lidar, t, **TOP), **TOP) == t


@pytest.mark.parametrize(("jitter", "nearest"), [(-0.001, 0.0), (0.02, 0.005)])
def test_a_jitter_that_cannot_be_names_the_nearest(rig, jitter, nearest):
    radars = {"RADAR_FRONT": replace(rig.radars["RADAR_FRONT"], jitter=jitter)}
    with pytest.raises(ValueError, match=rf"jitter={jitter} .* rig.radars.RADAR_FRONT.jitter={nearest}"):
        replace(rig, radars=radars)


@st.composite
def clocks(draw):
    """Clocks of any kind for a LiDAR and a radar, and the number or ``all`` of the radar's past scans."""
    keyframe_rate = draw(st.sampled_from([1.0, 2.0, 2.5, 4.0]))

    def clock(rate):
        phase = draw(st.just(0.0) | st.floats(0.0, 0.999 / rate))
        return {"rate": rate, "phase": phase, "jitter": draw(st.just(0.0) | st.floats(1e-5, 0.1 / rate))}

    lidar = clock(keyframe_rate * draw(st.integers(1, 5)))
    rates = st.integers(2, 20).map(lambda n: n * keyframe_rate) | st.floats(keyframe_rate, 40.0)
    radar = clock(draw(rates))
    sweeps = draw(st.just("all") | st.integers(0, 12))
    return {"keyframe_rate": keyframe_rate, "sweeps": {"radar": sweeps}, "lidar": lidar, "radar": radar}


def written_and_fired(rig: Rig, channel: str, seed: int):
    """Written times by keyframe, each with the time of its keyframe, and all times at which the sensor fires."""
    mount: Mount = rig.sensors[channel]
    times = keyframe_times(rig, KEYFRAMES, seed=seed)
    due = [numbers[channel] for numbers in events_due(rig, KEYFRAMES, seed=seed)]
    assert due[0][0] >= 0
    fired = event_times(mount, int((times[-1] + 1) * mount.rate) + 3, channel=channel, seed=seed)
    return [(t, [fired[number] for number in numbers]) for t, numbers in zip(times, due, strict=True)], fired


def after(fired, start, end):
    """The firings in (start, end], up to how times are rounded."""
    return fired[(fired > start + 1e-9) & (fired <= end + 1e-9)].tolist()


@given(clocks(), st.integers(0, 1000))
def test_no_firing_is_lost_or_written_twice(clocks, seed):
    lidars = {"LIDAR_TOP": Lidar(model=HDL32E, translation=[0.9, 0.0, 1.8], columns=180, **clocks.pop("lidar"))}
    radars = {"RADAR_FRONT": Radar(translation=[3.4, 0.0, 0.5], **clocks.pop("radar"))}
    try:
        rig = Rig(name="any", cameras={}, lidars=lidars, radars=radars, **clocks)
    except ValueError:  # too many sweeps, or so irregular that a keyframe may have no reading
        assume(False)
    for channel, past in (("RADAR_FRONT", rig.sweeps["radar"]), ("LIDAR_TOP", 0)):
        keyframes, fired = written_and_fired(rig, channel, seed)
        mount, clock = rig.sensors[channel], rig.lidars["LIDAR_TOP"]
        everything = [t for _, times in keyframes for t in times]
        assert everything[0] >= mount.phase - MAX_JITTER * mount.jitter
        assert everything == sorted(set(everything))
        for t, times in keyframes:
            assert t - (1 / mount.rate + 2 * MAX_JITTER * mount.jitter) - 1e-9 < times[-1] <= t + 1e-9
            assert after(fired, times[-1], t) == []
        for (before, _), (t, times) in pairwise(keyframes):
            between = after(fired, before, t)
            assert times == (between if past == "all" else between[-past - 1 :])
        first, times = keyframes[0]
        if past == "all":
            slack = MAX_JITTER * clock.jitter + 1e-9
            most, least = (after(fired, first - 1 / rig.keyframe_rate + s, first) for s in (-2 * slack, 2 * slack))
            assert set(least) <= set(times) <= set(most)
        else:
            assert len(times) == past + 1


def test_every_scan_and_turn_of_surround_is_written_and_none_races_the_keyframe():
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        rig = build(compose("data_gen", overrides=["data=surround"]).rig, "rig")
    for channel in (*rig.lidars, *rig.radars):
        for seed in range(20):
            keyframes, fired = written_and_fired(rig, channel, seed)
            written = [t for _, times in keyframes for t in times]
            assert written == after(fired, written[0] - 0.01, keyframes[-1][0])
            ages = [t - times[-1] for t, times in keyframes]
            assert max(ages) - min(ages) < 2 * MAX_JITTER * 0.00105
