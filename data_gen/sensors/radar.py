"""A 77 GHz radar that reports detections: which reflectors it sees, how strong and how fast they are, and what a car makes
of the detections. The receiver in between is :mod:`data_gen.sensors.radar_detection`."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_gen.jit import jit
from data_gen.rig import Radar
from data_gen.scene import NOTHING, WORLD, Scene
from data_gen.sensors.radar_detection import THRESHOLD, Array, Echoes, detect, link_budget_db

MOVING, STATIONARY, ONCOMING = 0, 1, 2
"""The codes of nuScenes' dyn_prop that a single scan can tell; "stopped" and "crossing" need a history."""
STILL = 0.5
"""Compensated radial speed in m/s up to which a detection is called stationary."""
GRAZING = 0.2
"""A reflector shows while the cosine between its normal and the ray that comes from the sensor is below this."""
SKIN = 0.5
"""Metres that a reflector may lie behind the surface of its own body."""
FAINT = 2.0
"""Mean SNR under which a reflection is not followed up: it alone is detected once in a hundred scans."""
UNDERBODY_SHARE, UNDERBODY_GAIN = 0.05, 0.1
"""Of the reflectors that an actor hides, the share that is reached over the road under its body, and at what power."""
LOW, MICRO_SHARE, MICRO_MAX = 0.6, 0.1, 0.3
"""Reflectors on wheels and legs, lower than this (m), spread in Doppler by a share of the speed, at most so many m/s."""
CLUTTER, CLUTTER_STATIC, CLUTTER_SPEED = 5.0, 0.7, 30.0
"""Mean number of false detections a scan, the share of them at rest on the ground, the greatest speed of the others."""
STEP = 1e-3
"""Seconds to either side when a range or position is differentiated."""


@dataclass(frozen=True)
class RadarScan:
    """P detections in the sensor's frame (x along the boresight, y left)."""

    x: NDArray[np.float32]  # metres
    y: NDArray[np.float32]
    rcs: NDArray[np.float32]  # dBsm, as a receiver infers it from power and range
    vx: NDArray[np.float32]  # radial velocity as a vector in sensor axes, m/s
    vy: NDArray[np.float32]
    vx_comp: NDArray[np.float32]  # the same without the sensor's own motion: zero for what stands still
    vy_comp: NDArray[np.float32]
    range: NDArray[np.float32]  # metres
    azimuth: NDArray[np.float32]  # radians counter-clockwise from the boresight
    doppler: NDArray[np.float32]  # d(range)/dt in m/s: positive recedes; folded into +-max_doppler
    snr_db: NDArray[np.float32]
    dyn_prop: NDArray[np.uint8]  # nuScenes' code
    body: NDArray[np.int32]  # actor index, WORLD, or NOTHING for a false detection


@dataclass(frozen=True)
class Look:
    """One firing of a radar at ``t`` seconds.

    ``ego_T_sensor`` (4, 4) is where the sensor truly sits, by default where ``radar`` says; the compensation of the ego's
    motion uses what ``radar`` says, as a car would that does not know better.
    """

    radar: Radar
    t: float
    rng: np.random.Generator
    ego_T_sensor: Array | None = None

    @property
    def mount(self) -> Array:
        """Where the sensor truly sits."""
        return self.radar.ego_T_sensor if self.ego_T_sensor is None else self.ego_T_sensor


def detect_radar(
    scene: Scene, radar: Radar, *, t: float, rng: np.random.Generator, ego_T_sensor: Array | None = None
) -> RadarScan:
    """The scan of a single :class:`Look`."""
    return detect_radars(scene, [Look(radar, t, rng, ego_T_sensor)])[0]


def detect_radars(scene: Scene, looks: Sequence[Look]) -> list[RadarScan]:
    """The scans of several looks, each as if it were alone; together they cost little more than one."""
    scans = []
    for look, echoes in zip(looks, visible_echoes(scene, looks), strict=True):
        own_velocity = sensor_velocity(scene, look.radar.ego_T_sensor, look.t)
        false = false_detections(look.radar, own_velocity, look.rng)
        found = Echoes.concatenate([detect(echoes, look.radar, look.rng), false])
        scans.append(report(found, look.radar, own_velocity))
    return scans


def visible_echoes(scene: Scene, looks: Sequence[Look]) -> list[Echoes]:
    """For each look, the reflectors that face the sensor, lie in its field of view and are not hidden."""
    origins, views = [], []
    for look in looks:
        global_T_sensor = scene.ego.pose(look.t) @ look.mount
        origins.append(global_T_sensor[:3, 3])
        views.append(_in_view(scene, look, global_T_sensor))
    which, directions, distance, azimuth, snr = (np.concatenate(part) for part in zip(*views, strict=True))
    owner = np.repeat(np.arange(len(looks)), [len(view[0]) for view in views])
    times = np.array([look.t for look in looks])[owner]
    hits = scene.cast(np.array(origins)[owner], directions, times, max(look.radar.max_range for look in looks))
    bodies, reflectors = scene.reflectors
    lucky = np.concatenate([look.rng.random(len(view[0])) for look, view in zip(looks, views, strict=True)])
    hidden = hits.distance < distance - SKIN
    under = hidden & (hits.body > WORLD) & (lucky < UNDERBODY_SHARE)
    snr[under] *= UNDERBODY_GAIN
    kept = np.flatnonzero(~hidden | under)
    body, local, owner = bodies[which[kept]], reflectors.position[which[kept]], owner[kept]
    doppler, spread = _doppler(scene, looks, owner, body, local)
    echoes = Echoes(distance[kept], azimuth[kept], doppler, snr[kept], body.astype(np.int32))
    ends = np.searchsorted(owner, np.arange(len(looks) + 1))
    found = [echoes[start:end] for start, end in pairwise(ends)]
    for look, echo, part in zip(looks, found, np.split(spread, ends[1:-1]), strict=True):
        echo.doppler[:] += look.rng.normal(size=len(part)) * part
    return found


def _in_view(scene: Scene, look: Look, global_T_sensor: Array) -> tuple[Array, ...]:
    """Index (K,), ray (K, 3), distance, azimuth and mean SNR of the reflectors that one look would see in the open."""
    bodies, reflectors = scene.reflectors
    position, yaw = scene.poses(look.t)
    which, rays, distance, azimuth = _facing(
        bodies, reflectors.position, reflectors.normal, position, np.cos(yaw), np.sin(yaw), global_T_sensor,
        look.radar.max_range, np.radians(look.radar.fov_deg),
    )  # fmt: skip
    budget = link_budget_db(distance, azimuth, look.radar, scene.condition.rain_rate)
    snr = 10 ** ((reflectors.rcs[which] + budget) / 10)
    bright = snr > FAINT
    return which[bright], rays[bright], distance[bright], azimuth[bright], snr[bright]


@jit
def _facing(bodies, points, normals, position, cos, sin, global_T_sensor, max_range, half_fov):
    """Reflectors in range, in the field of view and turned to the sensor: index, unit ray, distance, azimuth.

    A linear array measures the angle off its own axis, which for a raised target is not quite the azimuth.
    """
    which = np.empty(len(bodies), np.int64)
    rays, distance, azimuth = np.empty((len(bodies), 3)), np.empty(len(bodies)), np.empty(len(bodies))
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
        turned = nx * rays[n, 0] + ny * rays[n, 1] + normals[i, 2] * rays[n, 2]
        if ahead > 0 and abs(angle) <= half_fov and turned < GRAZING:
            which[n], distance[n], azimuth[n] = i, r, angle
            n += 1
    return which[:n], rays[:n], distance[:n], azimuth[:n]


def _doppler(
    scene: Scene, looks: Sequence[Look], owner: NDArray[np.int64], body: NDArray[np.int64], local: Array
) -> tuple[Array, Array]:
    """d(range)/dt of each echo, taken literally, so that turning bodies and lever arms are in it; and the standard
    deviation that the micro-motion of wheels and legs adds. ``owner`` is the look's index."""
    reach, place = [], []
    times = np.array([look.t for look in looks])
    for step in (-STEP, STEP):
        sensor = np.array([(scene.ego.pose(look.t + step) @ look.mount)[:3, 3] for look in looks])
        place.append(scene.place(body, local, times[owner] + step))
        reach.append(np.linalg.norm(place[-1] - sensor[owner], axis=1))
    speed = np.linalg.norm(place[1] - place[0], axis=1) / (2 * STEP)
    spread = np.where(local[:, 2] < LOW, np.minimum(MICRO_SHARE * speed, MICRO_MAX), 0.0)
    return (reach[1] - reach[0]) / (2 * STEP), spread


def sensor_velocity(scene: Scene, ego_T_sensor: Array, t: float) -> Array:
    """Velocity (3,) of the sensor over ground in its own axes, the lever arm of the ego's turning included."""
    before, after = ((scene.ego.pose(t + step) @ ego_T_sensor)[:3, 3] for step in (-STEP, STEP))
    return (after - before) / (2 * STEP) @ (scene.ego.pose(t) @ ego_T_sensor)[:3, :3]


def false_detections(radar: Radar, own_velocity: Array, rng: np.random.Generator) -> Echoes:
    """Clutter and noise just over the threshold, spread evenly over the covered ground; most of it stands still."""
    count = rng.poisson(CLUTTER)
    azimuth = np.radians(rng.uniform(-radar.fov_deg, radar.fov_deg, count))
    static = -(np.cos(azimuth) * own_velocity[0] + np.sin(azimuth) * own_velocity[1])
    other = rng.uniform(-CLUTTER_SPEED, CLUTTER_SPEED, count)
    return Echoes(
        range=radar.max_range * np.sqrt(rng.random(count)),
        azimuth=azimuth,
        doppler=np.where(rng.random(count) < CLUTTER_STATIC, static, other),
        snr=THRESHOLD * 10 ** (rng.exponential(0.2, count)),
        body=np.full(count, NOTHING, np.int32),
    )


def report(found: Echoes, radar: Radar, own_velocity: Array) -> RadarScan:
    """Detections as the car gets them: positions, relative and ground radial velocities, inferred cross-sections."""
    cos, sin = np.cos(found.azimuth), np.sin(found.azimuth)
    ground = found.doppler + cos * own_velocity[0] + sin * own_velocity[1]
    snr_db = 10 * np.log10(found.snr)
    columns = {
        "x": found.range * cos,
        "y": found.range * sin,
        "rcs": snr_db - link_budget_db(found.range, found.azimuth, radar),
        "vx": found.doppler * cos,
        "vy": found.doppler * sin,
        "vx_comp": ground * cos,
        "vy_comp": ground * sin,
        "range": found.range,
        "azimuth": found.azimuth,
        "doppler": found.doppler,
        "snr_db": snr_db,
    }
    motion = np.select([np.abs(ground) <= STILL, ground < 0], [STATIONARY, ONCOMING], MOVING).astype(np.uint8)
    return RadarScan(**{k: v.astype(np.float32) for k, v in columns.items()}, dyn_prop=motion, body=found.body)
