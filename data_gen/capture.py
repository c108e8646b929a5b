"""Fires every sensor of a rig through an episode: when, from where, and in which order, without touching files."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_gen.faults import SceneFaults
from data_gen.random import stream
from data_gen.rig import Camera, Lidar, Mount, Rig
from data_gen.scene import Scene
from data_gen.sensors.camera import CameraFrame, render_camera
from data_gen.sensors.lidar import LidarSweep, scan_lidar
from data_gen.sensors.radar import Look, RadarScan, detect_radars
from fusion_net.data.faults import SensorFaults
from fusion_net.data.nuscenes import REFERENCE

Data = CameraFrame | LidarSweep | RadarScan

MAX_JITTER = 0.4
"""Share of the period that a firing is at most early or late, so that none overtakes the next."""


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
    """Seconds of the keyframes: ends of LiDAR sweeps (or whole periods, without a LiDAR) with room for the sweeps before."""
    channel = REFERENCE if REFERENCE in rig.lidars else next(iter(rig.lidars), "")
    clock = rig.lidars.get(channel)
    rate, phase = (clock.rate, clock.phase) if clock else (rig.keyframe_rate, 0.0)
    lead = max((rig.sweeps.get(rig.modalities[c], 0) + 1) / m.rate + m.phase for c, m in rig.sensors.items())
    first = phase + math.ceil((lead - phase) * rate - 1e-9) / rate
    nominal = first + np.arange(count) / rig.keyframe_rate
    if clock is None or not clock.jitter:
        return nominal
    return np.array([firing_time(clock, round((t - phase) * rate), channel=channel, seed=seed) for t in nominal])


def firing_time(mount: Mount, number: int, *, channel: str, seed: int) -> float:
    """When a sensor fires for the ``number``-th time by its own clock, jitter included."""
    nominal = mount.phase + number / mount.rate
    if not mount.jitter:
        return nominal
    late = stream(seed, channel, number, "jitter").normal(0.0, mount.jitter)
    return nominal + float(np.clip(late, -MAX_JITTER / mount.rate, MAX_JITTER / mount.rate))


def firing_times(mount: Mount, t: float, sweeps: int, *, channel: str = "", seed: int = 0) -> list[float]:
    """The last ``sweeps`` + 1 firings of a sensor at or before ``t``, oldest first."""
    last = math.floor((t - mount.phase) * mount.rate + 1e-6) + (mount.jitter > 0)
    times = [firing_time(mount, last - back, channel=channel, seed=seed) for back in range(sweeps + 2, -1, -1)]
    return [time for time in times if time <= t + 1e-6 / mount.rate][-sweeps - 1 :]


def capture(
    scene: Scene, rig: Rig, *, keyframes: int, seed: int, faults: SceneFaults | None = None
) -> Iterator[Firing]:
    """Every firing that is written to disk, by keyframe and channel, oldest first within a channel.

    Of a dead sensor only keyframes come: what it would have seen there is what is labelled.
    """
    written: dict[str, float] = {}
    times = keyframe_times(rig, keyframes, seed=seed)
    for index, t_key in enumerate(times):
        shots: list[Shot] = []
        for channel, mount in rig.sensors.items():
            suffers = faults.on(channel, index) if faults else SensorFaults()
            due = firing_times(mount, t_key, rig.sweeps.get(rig.modalities[channel], 0), channel=channel, seed=seed)
            for t in due:
                if t <= written.get(channel, -math.inf) + 1e-9 or (suffers.dead and t < due[-1]):
                    continue
                late = suffers.late_firings
                noise = firing_times(mount, t, late, channel=channel, seed=seed)[0] if late else t
                true_time = noise - suffers.clock_error(noise - times[0])
                true_mount = suffers.true_mount(mount.ego_T_sensor)
                shots.append(Shot(channel, t, noise, true_time, true_mount, index, t == due[-1], suffers))
            written[channel] = due[-1]
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
