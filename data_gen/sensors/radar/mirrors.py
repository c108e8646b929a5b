"""The mirrors of a road: guard rails, walls, sides of trucks, and which reflectors a radar could see in them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.rig.mounts import Radar
from data_gen.scene.scene import WORLD, Scene
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.radar.detection import Array
from data_gen.sensors.radar.echoes import GRAZING, sensor_places

MIRROR_PROBABILITY = 0.3
"""Probability that an actor's mirror paths show in a scan: a surface is smooth and upright in places only."""
LOSS_DB = ((6.0, 10.0), (10.0, 15.0))
"""Least and greatest loss of a path that bounces once and of one that bounces twice."""
LONG, TALL = 5.5, 2.2
"""Least length and height in metres of an actor whose sides are mirrors: trucks, buses, trailers."""
REACH = 0.5
"""Metres to either side of a sideways reflector of the static world that mirror; rails and boards have one every metre."""

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Strips:
    """F upright mirrors, each in its body's frame: ``reach`` metres to either side of ``position``, facing ``normal``."""

    body: Indices  # (F,) actor index or WORLD
    position: Array  # (F, 3)
    normal: Array  # (F, 3) unit, horizontal
    reach: Array  # (F,)


def strips(scene: Scene) -> Strips:
    """The long sides of tall actors and what stands upright in the static world. How high each is, a ray will tell."""
    points = scene.world_scatterers
    upright = np.flatnonzero((points.normal[:, 2] == 0) & points.normal.any(axis=1))
    sizes = np.array([actor.asset.size for actor in scene.actors]).reshape(-1, 3)
    large = np.flatnonzero((sizes[:, 0] >= LONG) & (sizes[:, 2] >= TALL))
    side = np.repeat([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]], len(large), axis=0)
    large = np.tile(large, 2)
    return Strips(
        np.concatenate([np.full(len(upright), WORLD), large]),
        np.concatenate([points.position[upright].astype(float), side * sizes[large] / 2]),
        np.concatenate([points.normal[upright].astype(float), side]),
        np.concatenate([np.full(len(upright), REACH), sizes[large, 0] / 2]),
    )


@dataclass(frozen=True)
class Pairs:
    """K pairs of a reflector and a strip that mirrors it: event, reflector and strip, and the loss in dB once and twice."""

    owner: Indices  # (K,), in order
    which: Indices
    strip: Indices
    loss: Array  # (K, 2)

    def __getitem__(self, index) -> "Pairs":
        return Pairs(*(column[index] for column in vars(self).values()))


def mirrored_pairs(scene: Scene, events: Sequence[CaptureEvent[Radar]], mirror: Strips) -> Pairs:
    """The reflectors that each event could see in a strip, had neither anything in its way."""
    bodies, points = scene.reflectors
    starts = np.searchsorted(bodies, np.arange(len(scene.actors) + 1))
    radius = np.array([np.linalg.norm(actor.asset.size) / 2 for actor in scene.actors])
    rows = []
    for k, (event, sensor) in enumerate(zip(events, sensor_places(scene, events), strict=True)):
        shown = event.rng.random(len(radius)) < MIRROR_PROBABILITY
        loss = np.stack([event.rng.uniform(*bounds, len(radius)) for bounds in LOSS_DB], axis=1)
        position, yaw = scene.poses(event.true_time)
        which, strip = _mirrored(
            points.position, points.normal, starts, radius, shown, position, np.cos(yaw), np.sin(yaw),
            *vars(mirror).values(), sensor, (scene.ego.pose(event.true_time) @ event.ego_T_sensor)[:2, 0],
            np.cos(np.radians(event.mount.fov_deg)) - 0.02, event.mount.max_range,
        )  # fmt: skip
        rows.append((np.full(len(which), k), which, strip, loss[bodies[which]]))
    return Pairs(*(np.concatenate(column) for column in zip(*rows, strict=True)))


@jit
def _mirrored(
    points,
    normals,
    starts,
    radius,
    shown,
    position,
    cos,
    sin,
    body,
    foot,
    normal,
    reach,
    sensor,
    boresight,
    least,
    max_range,
):
    """Pairs (reflector, strip) for which the line from the sensor to the reflector's image crosses the strip, within range and,
    nearly, the view (``least`` cosine with the ``boresight``), and the reflector faces the strip.

    From the sensor's own image, ``off`` behind the plane, a reflector lies at (s, h) along and off the plane: the line crosses
    at s off / h. A whole actor is passed over when its sphere lies outside the wedge that the strip opens.
    """
    which, strip = np.empty(1024, np.int64), np.empty(1024, np.int64)
    count = 0
    for f in range(len(body)):
        b = body[f]
        nx, ny = cos[b] * normal[f, 0] - sin[b] * normal[f, 1], sin[b] * normal[f, 0] + cos[b] * normal[f, 1]
        x = position[b, 0] + cos[b] * foot[f, 0] - sin[b] * foot[f, 1]
        y = position[b, 1] + sin[b] * foot[f, 0] + cos[b] * foot[f, 1]
        off = (sensor[0] - x) * nx + (sensor[1] - y) * ny
        along = (sensor[1] - y) * nx - (sensor[0] - x) * ny
        if off < 0.1 or off * off + along * along > max_range * max_range:
            continue
        low, high = -reach[f] - along, reach[f] - along
        slack_low, slack_high = np.sqrt(low * low + off * off), np.sqrt(high * high + off * off)
        for a in range(len(radius)):
            if not shown[a] or a == b:
                continue
            h = off + (position[a, 0] - x) * nx + (position[a, 1] - y) * ny
            s = (position[a, 1] - y) * nx - (position[a, 0] - x) * ny - along
            r = radius[a]
            if h < off - r or low * h - off * s > r * slack_low or off * s - high * h > r * slack_high:
                continue
            for i in range(starts[a], starts[a + 1]):
                px = position[a, 0] + cos[a] * points[i, 0] - sin[a] * points[i, 1] - x
                py = position[a, 1] + sin[a] * points[i, 0] + cos[a] * points[i, 1] - y
                h = off + px * nx + py * ny
                s = py * nx - px * ny - along
                if h < off + 0.1 or off * s < low * h or off * s > high * h:
                    continue
                length = np.sqrt(h * h + s * s)
                ahead = (-s * ny - h * nx) * boresight[0] + (s * nx - h * ny) * boresight[1]
                mx = cos[a] * normals[i, 0] - sin[a] * normals[i, 1]
                my = sin[a] * normals[i, 0] + cos[a] * normals[i, 1]
                turned = (h * nx - s * ny) * mx + (h * ny + s * nx) * my
                if length > max_range or ahead < least * length or turned > GRAZING * length:
                    continue
                if count == len(which):
                    which, strip = np.append(which, which), np.append(strip, strip)
                which[count], strip[count] = i, f
                count += 1
    return which[:count].copy(), strip[:count].copy()
