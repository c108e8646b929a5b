"""When the sensors of a rig measure, and which of their measurements are written with which keyframe."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from data_gen.rig.mounts import Mount
from data_gen.rig.rig import Rig
from data_gen.rig.rig_checks import MAX_JITTER
from fusion_net.common.nuscenes_format import REFERENCE
from fusion_net.common.random import stream


def keyframe_times(rig: Rig, count: int, *, seed: int = 0) -> NDArray[np.float64]:
    """Seconds (count,) of the keyframes: ends of LIDAR_TOP's turns, with room for the sweeps before the first."""
    return np.array([keyframe_time(rig, index, seed=seed) for index in range(count)])


def keyframe_time(rig: Rig, index: int, *, seed: int) -> float:
    """That of keyframe ``index``; -1 would come before the first."""
    clock, lead = rig.lidars[REFERENCE], 0.0
    for channel, mount in rig.sensors.items():
        past = rig.past_events(channel)
        seconds = past / mount.rate if isinstance(past, int) else 1 / rig.keyframe_rate
        early = 0.0 if mount is clock else MAX_JITTER * clock.jitter
        lead = max(lead, seconds + 1 / mount.rate + mount.phase + early)
    first = math.ceil((lead - clock.phase) * clock.rate - 1e-9)
    turns = round(clock.rate / rig.keyframe_rate)
    return event_time(clock, first + index * turns, channel=REFERENCE, seed=seed)


def event_time(mount: Mount, number: int, *, channel: str, seed: int) -> float:
    """When a sensor measures for the ``number``-th time by its own clock, jitter included."""
    nominal = mount.phase + number / mount.rate
    if not mount.jitter:
        return nominal
    late = stream(seed, channel, number, "jitter").normal(0.0, mount.jitter)
    return nominal + float(np.clip(late, -MAX_JITTER * mount.jitter, MAX_JITTER * mount.jitter))


def last_event(mount: Mount, t: float, *, channel: str, seed: int) -> int:
    """The number of a sensor's last measurement at or before ``t``."""
    limit = t + 1e-9  # one at t counts, however its time was rounded
    number = math.floor((limit - mount.phase) * mount.rate) + (mount.jitter > 0)
    while event_time(mount, number, channel=channel, seed=seed) > limit:
        number -= 1
    return number


def events_due(rig: Rig, keyframes: int, *, seed: int) -> Iterator[dict[str, range]]:
    """For each keyframe, by channel, the numbers of the measurements that are written with it; the last is the keyframe's own.

    Measurements are counted, not timed, so that no jitter loses one or gives it to two keyframes.
    """
    before = keyframe_time(rig, -1, seed=seed)
    written: dict[str, int] = {}
    for t in keyframe_times(rig, keyframes, seed=seed).tolist():
        due = {}
        for channel, mount in rig.sensors.items():
            last = last_event(mount, t, channel=channel, seed=seed)
            past = rig.past_events(channel)
            oldest = last - past if isinstance(past, int) else last_event(mount, before, channel=channel, seed=seed) + 1
            due[channel] = range(max(oldest, written.get(channel, -1) + 1), last + 1)
            written[channel] = last
        yield due
