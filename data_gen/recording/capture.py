"""Fires every sensor of a rig through an episode: when, from where, and in which order, without touching files."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_gen.recording.faults import SceneFaults
from data_gen.rig.mounts import Camera, Lidar, Mount
from data_gen.rig.rig import Rig
from data_gen.rig.rig_checks import MAX_JITTER
from data_gen.scene.scene import Scene
from data_gen.sensors.camera.camera import CameraFrame, render_camera
from data_gen.sensors.lidar.lidar import LidarSweep, scan_lidar
from data_gen.sensors.radar.radar import Look, RadarScan, detect_radars
from fusion_net.common.faults import SensorFaults
from fusion_net.common.nuscenes_format import REFERENCE
from fusion_net.common.random import stream

Data = CameraFrame | LidarSweep | RadarScan


@dataclass(frozen=True)
class Shot:
    """One firing of one sensor to be. ``keyframe`` is the index of the keyframe it belongs to or comes before.

    The sensor fires at ``true_time`` from ``ego_T_sensor`` (4, 4) and reports that it was at ``time``; what it saw, ``faults``
    then spoil. ``noise`` names the draws: ``time``, or that of an earlier firing whose data come stale.
    """

    channel: str
    time: float  # seconds of the episode
    noise: float
    true_time: float
    ego_T_sensor: NDArray[np.float64]
    keyframe: int
    is_keyframe: bool
    faults: SensorFaults


@dataclass(frozen=True)
class Firing(Shot):
    """And what the sensor saw."""

    data: Data


def keyframe_times(rig: Rig, count: int, *, seed: int = 0) -> NDArray[np.float64]:
    """Seconds (count,) of the keyframes: ends of LIDAR_TOP's turns, with room for the sweeps before the first."""
    return np.array([_keyframe_time(rig, index, seed=seed) for index in range(count)])


def _keyframe_time(rig: Rig, index: int, *, seed: int) -> float:
    """That of keyframe ``index``; -1 would come before the first."""
    clock, lead = rig.lidars[REFERENCE], 0.0
    for channel, mount in rig.sensors.items():
        past = rig.past_firings(channel)
        seconds = past / mount.rate if isinstance(past, int) else 1 / rig.keyframe_rate
        early = 0.0 if mount is clock else MAX_JITTER * clock.jitter
        lead = max(lead, seconds + 1 / mount.rate + mount.phase + early)
    first = math.ceil((lead - clock.phase) * clock.rate - 1e-9)
    turns = round(clock.rate / rig.keyframe_rate)
    return firing_time(clock, first + index * turns, channel=REFERENCE, seed=seed)


def firing_time(mount: Mount, number: int, *, channel: str, seed: int) -> float:
    """When a sensor fires for the ``number``-th time by its own clock, jitter included."""
    nominal = mount.phase + number / mount.rate
    if not mount.jitter:
        return nominal
    late = stream(seed, channel, number, "jitter").normal(0.0, mount.jitter)
    return nominal + float(np.clip(late, -MAX_JITTER * mount.jitter, MAX_JITTER * mount.jitter))


def last_firing(mount: Mount, t: float, *, channel: str, seed: int) -> int:
    """The number of a sensor's last firing at or before ``t``."""
    limit = t + 1e-9  # one at t counts, however its time was rounded
    number = math.floor((limit - mount.phase) * mount.rate) + (mount.jitter > 0)
    while firing_time(mount, number, channel=channel, seed=seed) > limit:
        number -= 1
    return number


def firings_due(rig: Rig, keyframes: int, *, seed: int) -> Iterator[dict[str, range]]:
    """For each keyframe, by channel, the numbers of the firings that are written with it; the last is the keyframe's own.

    Firings are counted, not timed, so that no jitter loses one or gives it to two keyframes.
    """
    before = _keyframe_time(rig, -1, seed=seed)
    written: dict[str, int] = {}
    for t in keyframe_times(rig, keyframes, seed=seed).tolist():
        due = {}
        for channel, mount in rig.sensors.items():
            last = last_firing(mount, t, channel=channel, seed=seed)
            past = rig.past_firings(channel)
            oldest = (
                last - past if isinstance(past, int) else last_firing(mount, before, channel=channel, seed=seed) + 1
            )
            due[channel] = range(max(oldest, written.get(channel, -1) + 1), last + 1)
            written[channel] = last
        yield due


def capture(
    scene: Scene, rig: Rig, *, keyframes: int, seed: int, faults: SceneFaults | None = None
) -> Iterator[Firing]:
    """Every firing that is written to disk, by keyframe and channel, oldest first within a channel.

    Of a dead sensor only keyframes come: what it would have seen there is what is labelled.
    """
    start = _keyframe_time(rig, 0, seed=seed)
    for index, due in enumerate(firings_due(rig, keyframes, seed=seed)):
        shots: list[Shot] = []
        for channel, numbers in due.items():
            mount, suffers = rig.sensors[channel], faults.on(channel, index) if faults else SensorFaults()
            for number in numbers[-1:] if suffers.dead else numbers:
                t = firing_time(mount, number, channel=channel, seed=seed)
                noise = firing_time(mount, number - suffers.late_firings, channel=channel, seed=seed)
                true_time = noise - suffers.clock_error(noise - start)
                true_mount = suffers.true_mount(mount.ego_T_sensor)
                shots.append(Shot(channel, t, noise, true_time, true_mount, index, number == numbers[-1], suffers))
        for shot, data in zip(shots, _readings(scene, rig, shots, seed), strict=True):
            yield Firing(**vars(shot), data=data)


def _readings(scene: Scene, rig: Rig, shots: list[Shot], seed: int) -> Iterator[Data]:
    """What each shot saw. Radars are cast together, which is faster."""
    rngs = [stream(seed, shot.channel, round(shot.noise * 1e6)) for shot in shots]
    looks = [
        Look(rig.radars[shot.channel], shot.true_time, rng, shot.ego_T_sensor)
        for shot, rng in zip(shots, rngs, strict=True)
        if shot.channel in rig.radars
    ]
    scans = iter(detect_radars(scene, looks) if looks else ())
    for shot, rng in zip(shots, rngs, strict=True):
        mount, t, ego_T_sensor = rig.sensors[shot.channel], shot.true_time, shot.ego_T_sensor
        if isinstance(mount, Camera):
            # the same drops and dirt in every frame
            lens_seed = int(stream(seed, shot.channel, "lens").integers(2**62))
            yield render_camera(scene, mount, ego_T_sensor=ego_T_sensor, t=t, rng=rng, lens_seed=lens_seed)
        elif isinstance(mount, Lidar):
            yield scan_lidar(scene, mount, ego_T_sensor=ego_T_sensor, t_end=t, rng=rng)
        else:
            yield next(scans)
