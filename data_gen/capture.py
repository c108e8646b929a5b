"""Fires every sensor of a rig through an episode: when, from where, and in which order, without touching files."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_gen.random import stream
from data_gen.rig import Camera, Lidar, Mount, Rig
from data_gen.scene import Scene
from data_gen.sensors.camera import CameraFrame, render_camera
from data_gen.sensors.lidar import LidarSweep, scan_lidar
from data_gen.sensors.radar import Look, RadarScan, detect_radars


@dataclass(frozen=True)
class Firing:
    """One reading of one sensor. ``keyframe`` is the index of the keyframe it belongs to or comes before."""

    channel: str
    time: float  # seconds of the episode
    keyframe: int
    is_keyframe: bool
    data: CameraFrame | LidarSweep | RadarScan


def keyframe_times(rig: Rig, count: int) -> NDArray[np.float64]:
    """Seconds of the keyframes: ends of LiDAR sweeps (or whole periods, without a LiDAR) with room for the sweeps before."""
    clock = next(iter(rig.lidars.values()), None)
    rate, phase = (clock.rate, clock.phase) if clock else (rig.keyframe_rate, 0.0)
    lead = max((rig.sweeps.get(_modality(rig, c), 0) + 1) / m.rate + m.phase for c, m in rig.sensors.items())
    first = phase + math.ceil((lead - phase) * rate - 1e-9) / rate
    return first + np.arange(count) / rig.keyframe_rate


def firing_times(mount: Mount, t: float, sweeps: int) -> list[float]:
    """The last ``sweeps`` + 1 firings of a sensor at or before ``t``, oldest first."""
    last = math.floor((t - mount.phase) * mount.rate + 1e-6)
    return [mount.phase + (last - back) / mount.rate for back in range(sweeps, -1, -1)]


def capture(scene: Scene, rig: Rig, *, keyframes: int, seed: int) -> Iterator[Firing]:
    """Every firing that is written to disk, by keyframe and channel, oldest first within a channel."""
    written: dict[str, float] = {}
    for index, t_key in enumerate(keyframe_times(rig, keyframes)):
        shots = []
        for channel, mount in rig.sensors.items():
            times = firing_times(mount, float(t_key), rig.sweeps.get(_modality(rig, channel), 0))
            shots += [(channel, t, t == times[-1]) for t in times if t > written.get(channel, -math.inf) + 1e-9]
            written[channel] = times[-1]
        rngs = [stream(seed, channel, round(t * 1e6)) for channel, t, _ in shots]
        radars, sensors = rig.radars, rig.sensors
        looks = [Look(radars[c], t, rng) for (c, t, _), rng in zip(shots, rngs, strict=True) if c in radars]
        scans = iter(detect_radars(scene, looks) if looks else ())
        for (channel, t, is_keyframe), rng in zip(shots, rngs, strict=True):
            data = next(scans) if channel in radars else _fire(scene, sensors[channel], t, rng)
            yield Firing(channel, t, index, is_keyframe, data)


def _fire(scene: Scene, mount: Mount, t: float, rng: np.random.Generator) -> CameraFrame | LidarSweep:
    if isinstance(mount, Camera):
        return render_camera(scene, mount, t=t, rng=rng)
    assert isinstance(mount, Lidar)
    return scan_lidar(scene, mount, t_end=t, rng=rng)


def _modality(rig: Rig, channel: str) -> str:
    return "camera" if channel in rig.cameras else "lidar" if channel in rig.lidars else "radar"
