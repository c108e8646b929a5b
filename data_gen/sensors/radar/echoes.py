"""Which reflectors a radar reaches, how strong they are in the mean and how fast their range changes."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.rig.mounts import Radar
from data_gen.scene.scene import WORLD, Scene
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.radar.detection import DIRECT, UNDERBODY, Array, Echoes, link_budget_db

GRAZING = 0.2
"""A reflector shows while the cosine between its normal and the ray that comes from the sensor is below this."""
OBLIQUE_DB = -12.0
"""What edges, rivets and joints of a flat reflector still return when it is seen along its surface, against its front."""
SKIN = 0.5
"""Metres that a reflector may lie behind the surface of its own body."""
FAINT = 2.0
"""Mean SNR under which a reflection is not followed up: it alone is detected once in a hundred scans."""
UNDERBODY_PROBABILITY, UNDERBODY_GAIN, UNDERBODY_HEIGHT = 0.2, 0.1, 1.0
"""Of the reflectors up to this height (m) that a vehicle hides, the fraction that is reached over the road below its body, and
at what power."""
MICRO_HEIGHT, MICRO_FRACTION, MICRO_MAX = 0.6, 0.1, 0.3
"""Reflectors on wheels and legs, lower than this (m), spread in Doppler by a fraction of the speed, at most so many m/s."""
STEP = 1e-3
"""Seconds to either side when a range or position is differentiated."""


def visible_echoes(scene: Scene, events: Sequence[CaptureEvent[Radar]]) -> list[Echoes]:
    """For each event, the reflectors that face the sensor, lie in its field of view and are not hidden."""
    origins, views = [], []
    for event in events:
        global_T_sensor = scene.ego.pose(event.true_time) @ event.ego_T_sensor
        origins.append(global_T_sensor[:3, 3])
        views.append(_in_view(scene, event, global_T_sensor))
    which, directions, distance, azimuth, snr = (np.concatenate(part) for part in zip(*views, strict=True))
    owner = np.repeat(np.arange(len(events)), [len(view[0]) for view in views])
    times = np.array([event.true_time for event in events])[owner]
    reach = max(event.mount.max_range for event in events)
    hits = scene.cast(np.array(origins)[owner], directions, times, reach, counted=False)
    bodies, reflectors = scene.reflectors
    uniform = np.concatenate([event.rng.random(len(view[0])) for event, view in zip(events, views, strict=True)])
    hidden = hits.distance < distance - SKIN
    low = (bodies[which] > WORLD) & (reflectors.position[which, 2] < UNDERBODY_HEIGHT)
    passable = _on_wheels(scene)[hits.body] & (hits.body != bodies[which])
    under = hidden & low & passable & (uniform < UNDERBODY_PROBABILITY)
    snr[under] *= UNDERBODY_GAIN
    kept = np.flatnonzero(~hidden | under)
    body, local, owner = bodies[which[kept]], reflectors.position[which[kept]], owner[kept]
    doppler, spread = _doppler(scene, events, owner, body, local)
    cause = np.where(under[kept], UNDERBODY, DIRECT).astype(np.uint8)
    echoes = Echoes(distance[kept], azimuth[kept], doppler, snr[kept], body.astype(np.int32), cause)
    ends = np.searchsorted(owner, np.arange(len(events) + 1))
    found = [echoes[start:end] for start, end in pairwise(ends)]
    for event, echo, part in zip(events, found, np.split(spread, ends[1:-1]), strict=True):
        echo.doppler[:] += event.rng.normal(size=len(part)) * part
    return found


def _on_wheels(scene: Scene) -> NDArray[np.bool_]:
    """Whether there is air below a body: of every actor, and False for WORLD and NOTHING, which index from the end."""
    kinds = [actor.asset.category or actor.asset.imitates for actor in scene.actors]
    return np.array([*(kind.startswith("vehicle") for kind in kinds), False, False])


def _in_view(scene: Scene, event: CaptureEvent[Radar], global_T_sensor: Array) -> tuple[Array, ...]:
    """Index (K,), ray (K, 3), distance, azimuth and mean SNR of the reflectors that one event would see in the open."""
    bodies, reflectors = scene.reflectors
    position, yaw = scene.poses(event.true_time)
    which, rays, distance, azimuth, turned = _facing(
        bodies, reflectors.position, reflectors.normal, position, np.cos(yaw), np.sin(yaw), global_T_sensor,
        event.mount.max_range, np.radians(event.mount.fov_deg),
    )  # fmt: skip
    budget = link_budget_db(distance, azimuth, event.mount, scene.condition.rain_rate)
    snr = 10 ** ((reflectors.rcs[which] + budget + aspect_db(turned)) / 10)
    bright = snr > FAINT
    return which[bright], rays[bright], distance[bright], azimuth[bright], snr[bright]


def aspect_db(turned: Array) -> Array:
    """Loss of a reflector in dB whose normal has the cosine ``turned`` with the ray that comes in.

    None up to 45 degrees; then with the square of the cosine, as of a rough plate (Lambert): doors, bumpers and rails are
    curved and ribbed, and no polished plates.
    """
    return np.maximum(20 * np.log10(np.clip(-turned, 1e-3, 0.5**0.5) / 0.5**0.5), OBLIQUE_DB)


@jit
def _facing(bodies, points, normals, position, cos, sin, global_T_sensor, max_range, half_fov):
    """Reflectors in range, in the field of view and turned to the sensor: index, unit ray, distance, azimuth, cosine between
    ray and normal (-1 for what has none).

    A linear array measures the angle off its own axis, which for a raised target is not quite the azimuth.
    """
    which = np.empty(len(bodies), np.int64)
    rays, distance, azimuth = np.empty((len(bodies), 3)), np.empty(len(bodies)), np.empty(len(bodies))
    turned = np.empty(len(bodies))
    n = 0
    for i in range(len(bodies)):
        b = bodies[i]
        x, y = points[i, 0], points[i, 1]
        rays[n, 0] = position[b, 0] + cos[b] * x - sin[b] * y - global_T_sensor[0, 3]
        rays[n, 1] = position[b, 1] + sin[b] * x + cos[b] * y - global_T_sensor[1, 3]
        rays[n, 2] = position[b, 2] + points[i, 2] - global_T_sensor[2, 3]
        r = np.sqrt(rays[n, 0] ** 2 + rays[n, 1] ** 2 + rays[n, 2] ** 2)
        if r >= max_range or r < 1e-3:
            continue
        ahead = left = 0.0
        for c in range(3):
            rays[n, c] /= r
            ahead += rays[n, c] * global_T_sensor[c, 0]
            left += rays[n, c] * global_T_sensor[c, 1]
        angle = np.arcsin(min(max(left, -1.0), 1.0))
        nx, ny = cos[b] * normals[i, 0] - sin[b] * normals[i, 1], sin[b] * normals[i, 0] + cos[b] * normals[i, 1]
        turned[n] = nx * rays[n, 0] + ny * rays[n, 1] + normals[i, 2] * rays[n, 2]
        if nx == 0 and ny == 0 and normals[i, 2] == 0:
            turned[n] = -1.0
        if ahead > 0 and abs(angle) <= half_fov and turned[n] < GRAZING:
            which[n], distance[n], azimuth[n] = i, r, angle
            n += 1
    return which[:n], rays[:n], distance[:n], azimuth[:n], turned[:n]


def _doppler(
    scene: Scene, events: Sequence[CaptureEvent[Radar]], owner: NDArray[np.int64], body: NDArray[np.int64], local: Array
) -> tuple[Array, Array]:
    """d(range)/dt of each echo, taken literally, so that turning bodies and lever arms are in it; and the standard
    deviation that the micro-motion of wheels and legs adds. ``owner`` is the event's index."""
    reach, place = [], []
    times = np.array([event.true_time for event in events])
    for step in (-STEP, STEP):
        place.append(scene.place(body, local, times[owner] + step))
        reach.append(np.linalg.norm(place[-1] - sensor_places(scene, events, step)[owner], axis=1))
    speed = np.linalg.norm(place[1] - place[0], axis=1) / (2 * STEP)
    spread = np.where(local[:, 2] < MICRO_HEIGHT, np.minimum(MICRO_FRACTION * speed, MICRO_MAX), 0.0)
    return (reach[1] - reach[0]) / (2 * STEP), spread


def sensor_places(scene: Scene, events: Sequence[CaptureEvent[Radar]], step: float = 0.0) -> Array:
    """Global positions (L, 3) of the sensors ``step`` seconds after each event's time."""
    position, yaw, _ = scene.ego.at(np.array([event.true_time + step for event in events]))
    x, y, z = np.array([event.ego_T_sensor[:3, 3] for event in events]).T
    cos, sin = np.cos(yaw), np.sin(yaw)
    return position + np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)


def sensor_velocity(scene: Scene, ego_T_sensor: Array, t: float) -> Array:
    """Velocity (3,) of the sensor over ground in its own axes, the lever arm of the ego's turning included."""
    before, after = ((scene.ego.pose(t + step) @ ego_T_sensor)[:3, 3] for step in (-STEP, STEP))
    return (after - before) / (2 * STEP) @ (scene.ego.pose(t) @ ego_T_sensor)[:3, :3]
