"""Multipath: targets seen a second and third time in the mirrors of a road - guard rails, walls, sides of trucks.

An upright strip that is smooth to a wave of 4 mm mirrors what lies before it. The path that bounces once, on its way out or
back, has the mean length of the direct and the mirrored path; the one that bounces both ways shows the mirror image itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_gen.rig.mounts import Radar
from data_gen.scene.scene import NOTHING, Hits, Scene
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.radar.detection import DOUBLE_BOUNCE, SINGLE_BOUNCE, Array, Echoes, link_budget_db
from data_gen.sensors.radar.echoes import FAINT, GRAZING, SKIN, STEP, aspect_db, sensor_places
from data_gen.sensors.radar.mirrors import Pairs, Strips, mirrored_pairs, strips

FLAT = 0.25
"""Metres that the surface may lie before or behind the plane of its strip."""


@dataclass(frozen=True)
class _Paths:
    """The geometry of K mirror paths, global frame."""

    sensor: Array  # (K, 3) metres
    target: Array  # (K, 3)
    facing: Array  # (K, 3) normal of the target's reflector, zero where it has none
    image: Array  # (K, 3) of the target in the mirror
    bounce: Array  # (K, 3) where the line from the sensor to the image meets the mirror's plane
    normal: Array  # (K, 3) of the mirror

    def lengths(self) -> tuple[Array, Array]:
        """Metres (K,) from the sensor to the target and to its image."""
        return np.linalg.norm(self.target - self.sensor, axis=1), np.linalg.norm(self.image - self.sensor, axis=1)


def ghost_echoes(scene: Scene, events: Sequence[CaptureEvent[Radar]]) -> list[Echoes]:
    """For each event, the mirrored echoes of actors: paths that bounce once, arriving from either side, and twice."""
    mirror = strips(scene)
    pairs = mirrored_pairs(scene, events, mirror)
    paths = _paths(scene, events, mirror, pairs)
    angles, snr = _strength(scene, events, pairs, paths)
    bright = np.flatnonzero(snr.max(axis=1) > FAINT)
    pairs, snr, angles = pairs[bright], snr[bright], angles[bright]
    paths = _Paths(*(column[bright] for column in vars(paths).values()))
    snr *= _unblocked(scene, events, mirror, pairs, paths)
    lit = np.flatnonzero(snr.max(axis=1) > FAINT)
    pairs, snr, angles = pairs[lit], snr[lit], angles[lit]
    lengths = [_paths(scene, events, mirror, pairs, step).lengths() for step in (-STEP, 0.0, STEP)]
    (direct, mirrored), closing = lengths[1], np.subtract(lengths[2], lengths[0]) / (2 * STEP)
    body = np.full(len(lit), NOTHING, np.int32)
    once, twice = (np.full(len(lit), code, np.uint8) for code in (SINGLE_BOUNCE, DOUBLE_BOUNCE))
    back, mean = (direct + mirrored) / 2, closing.mean(axis=0)
    echoes = Echoes.concatenate(
        [
            Echoes(back, angles[:, 0], mean, snr[:, 0], body, once),
            Echoes(back, angles[:, 1], mean, snr[:, 0], body, once),
            Echoes(mirrored, angles[:, 1], closing[1], snr[:, 1], body, twice),
        ]
    )
    owner = np.where(echoes.snr > FAINT, np.tile(pairs.owner, 3), len(events))
    order = np.argsort(owner, kind="stable")
    ends = np.searchsorted(owner[order], np.arange(len(events) + 1))
    return [echoes[order[start:end]] for start, end in pairwise(ends)]


def _paths(
    scene: Scene, events: Sequence[CaptureEvent[Radar]], mirror: Strips, pairs: Pairs, step: float = 0.0
) -> _Paths:
    """Where everything is ``step`` seconds after the events' times. The image: p' = p - 2 ((p - p0) . n) n."""
    bodies, points = scene.reflectors
    body, local = bodies[pairs.which], points.position[pairs.which]
    times = np.array([event.true_time for event in events])[pairs.owner] + step
    sensor = sensor_places(scene, events, step)[pairs.owner]
    target = scene.place(body, local, times)
    facing = scene.place(body, local + points.normal[pairs.which], times) - target
    owner, middle = mirror.body[pairs.strip], mirror.position[pairs.strip]
    foot = scene.place(owner, middle, times)
    normal = scene.place(owner, middle + mirror.normal[pairs.strip], times) - foot
    before, behind = (np.einsum("kc,kc->k", point - foot, normal) for point in (sensor, target))
    image = target - 2 * behind[:, None] * normal
    bounce = sensor + (image - sensor) * (before / (before + behind))[:, None]
    return _Paths(sensor, target, facing, image, bounce, normal)


def _strength(scene: Scene, events: Sequence[CaptureEvent[Radar]], pairs: Pairs, paths: _Paths) -> tuple[Array, Array]:
    """Azimuth (K, 2) of target and image, and mean SNR (K, 2) of the path that bounces once and of that which does twice.

    A path out and back takes half of its budget in dB from either way. What is out of view or seen from behind has 0.
    """
    ends = np.stack([paths.target, paths.image], axis=1) - paths.sensor[:, None]
    distance = np.linalg.norm(ends, axis=2)
    rays = _unit(np.stack([ends[:, 0], paths.target - paths.bounce], axis=1))
    has_side = np.any(paths.facing, axis=1, keepdims=True)
    turned = np.where(has_side, np.einsum("kwc,kc->kw", rays, paths.facing), -1.0)
    angles, level = np.empty_like(distance), np.empty_like(distance)
    borders = np.searchsorted(pairs.owner, np.arange(len(events) + 1))
    for event, (start, end) in zip(events, pairwise(borders), strict=True):
        part, radar = slice(start, end), event.mount
        global_T_sensor = scene.ego.pose(event.true_time) @ event.ego_T_sensor
        in_sensor = ends[part] @ global_T_sensor[:3, :3] / distance[part, :, None]
        angles[part] = np.arcsin(np.clip(in_sensor[..., 1], -1, 1))
        in_view = (in_sensor[..., 0] > 0) & (np.abs(angles[part]) <= np.radians(radar.fov_deg))
        in_view &= (turned[part] < GRAZING) & (distance[part] < radar.max_range)
        budget = link_budget_db(distance[part], angles[part], radar, scene.condition.rain_rate)
        level[part] = np.where(in_view, budget, -np.inf)
    level += aspect_db(turned) + scene.reflectors[1].rcs[pairs.which, None]
    return angles, 10 ** ((np.stack([level.mean(axis=1), level[:, 1]], axis=1) - pairs.loss) / 10)


def _unblocked(
    scene: Scene, events: Sequence[CaptureEvent[Radar]], mirror: Strips, pairs: Pairs, paths: _Paths
) -> NDArray[np.bool_]:
    """Whether the way out and back is free (K, 2) for the path that bounces once and for that which does twice: the mirror is
    really there and in sight of the sensor, and so is the target of the mirror; once, the target of the sensor as well."""
    times = np.array([event.true_time for event in events])[pairs.owner]
    out = np.zeros((len(times), 2), bool)
    if not len(times):
        return out
    middle = float(times.max() + times.min()) / 2

    def met(start: Array, end: Array, chosen: NDArray[np.int64]) -> tuple[Hits, Array, Array]:
        way = end[chosen] - start[chosen]
        far = np.linalg.norm(way, axis=1)
        reach = float(far.max(initial=0.0)) + 1.0
        return (
            scene.cast(start[chosen], way / far[:, None], times[chosen], reach, counted=False, middle=middle),
            way,
            far,
        )

    hits, way, far = met(paths.sensor, paths.bounce, np.arange(len(times)))
    steep = -np.einsum("kc,kc->k", way, paths.normal) / far
    bounces = (np.abs(hits.distance - far) * steep < FLAT) & (hits.body == mirror.body[pairs.strip])
    chosen = np.flatnonzero(bounces)
    for start, column in ((paths.bounce + 0.02 * paths.normal, 1), (paths.sensor, 0)):
        hits, _, far = met(start, paths.target, chosen)
        chosen = chosen[np.greater(hits.distance, far - SKIN)]
        out[chosen, column] = True
    return out


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
