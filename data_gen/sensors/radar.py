"""A 77 GHz radar that reports detections: which reflectors it sees, how strong and how fast they are, and what a car makes
of the detections. The receiver in between is :mod:`data_gen.sensors.radar_detection`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_gen.mesh import Scatterers
from data_gen.rig import Radar
from data_gen.scene import NOTHING, WORLD, Scene
from data_gen.sensors.radar_detection import THRESHOLD, Array, Echoes, detect, link_budget_db
from fusion_net.geometry import invert, transform

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
UNDERBODY_SHARE, UNDERBODY_GAIN = 0.2, 0.1
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


def detect_radar(
    scene: Scene, radar: Radar, *, t: float, rng: np.random.Generator, ego_T_sensor: Array | None = None
) -> RadarScan:
    """The scan at ``t`` seconds.

    ``ego_T_sensor`` (4, 4) is where the sensor truly sits, by default where ``radar`` says; the compensation of the ego's
    motion uses what ``radar`` says, as a car would that does not know better.
    """
    believed = radar.ego_T_sensor
    echoes = visible_echoes(scene, radar, believed if ego_T_sensor is None else ego_T_sensor, t, rng)
    own_velocity = sensor_velocity(scene, believed, t)
    false = false_detections(radar, own_velocity, rng)
    return report(Echoes.concatenate(detect(echoes, radar, rng), false), radar, own_velocity)


def visible_echoes(scene: Scene, radar: Radar, ego_T_sensor: Array, t: float, rng: np.random.Generator) -> Echoes:
    """Reflectors that face the sensor, lie in its field of view and are not hidden, with their mean SNR."""
    global_T_sensor = scene.ego.pose(t) @ ego_T_sensor
    body, reflectors = _reflectors_near(scene, global_T_sensor[:3, 3], radar.max_range)
    position = scene.place(body, reflectors.position, t)
    normal = scene.place(body, reflectors.position + reflectors.normal, t) - position
    ray = position - global_T_sensor[:3, 3]
    distance = np.maximum(np.linalg.norm(ray, axis=1), 1e-3)
    in_sensor = transform(invert(global_T_sensor), position)
    # A linear array measures the angle off its own axis, which for a raised target is not quite the azimuth.
    azimuth = np.arcsin(np.clip(in_sensor[:, 1] / distance, -1, 1))
    snr = 10 ** ((reflectors.rcs + link_budget_db(distance, azimuth, radar, scene.condition.rain_rate)) / 10)
    seen = (distance < radar.max_range) & (in_sensor[:, 0] > 0) & (np.abs(azimuth) <= np.radians(radar.fov_deg))
    seen &= np.einsum("ij,ij->i", normal, ray) < GRAZING * distance
    seen = np.flatnonzero(seen & (snr > FAINT))
    ray, distance, snr = ray[seen], distance[seen], snr[seen]

    hits = scene.cast(global_T_sensor[:3, 3], ray / distance[:, None], t, radar.max_range)
    hidden = hits.distance < distance - SKIN
    under = hidden & (hits.body > WORLD) & (rng.random(len(seen)) < UNDERBODY_SHARE)
    echoes = Echoes(
        distance, azimuth[seen], np.zeros(len(seen)), np.where(under, UNDERBODY_GAIN * snr, snr), body[seen]
    )
    reached = ~hidden | under
    local = reflectors.position[seen[reached]]
    return _in_motion(echoes[reached], local, scene, ego_T_sensor, t, rng)


def _reflectors_near(scene: Scene, center: Array, max_range: float) -> tuple[NDArray[np.int32], Scatterers]:
    """Body index (S,) and local reflectors of the world around ``center`` and of all actors."""
    world = scene.world_scatterers
    near = np.flatnonzero(((world.position - center) ** 2).sum(axis=1) < max_range**2)
    parts = [Scatterers(world.position[near], world.normal[near], world.rcs[near])]
    parts += [actor.asset.scatterers for actor in scene.actors]
    bodies = np.arange(WORLD, len(scene.actors), dtype=np.int32)
    return np.repeat(bodies, [len(part.rcs) for part in parts]), Scatterers.concatenate(parts)


def _in_motion(
    echoes: Echoes, local: Array, scene: Scene, ego_T_sensor: Array, t: float, rng: np.random.Generator
) -> Echoes:
    """The echoes with their Doppler: d(range)/dt taken literally, so that turning bodies and lever arms are in it, and
    the micro-motion of wheels and legs."""
    before, after = (scene.place(echoes.body, local, t + step) for step in (-STEP, STEP))
    speed = np.linalg.norm(after - before, axis=1) / (2 * STEP)
    from_before, from_after = ((scene.ego.pose(t + step) @ ego_T_sensor)[:3, 3] for step in (-STEP, STEP))
    closing = np.linalg.norm(after - from_after, axis=1) - np.linalg.norm(before - from_before, axis=1)
    spread = np.where(local[:, 2] < LOW, np.minimum(MICRO_SHARE * speed, MICRO_MAX), 0.0)
    doppler = closing / (2 * STEP) + rng.normal(size=len(speed)) * spread
    return Echoes(echoes.range, echoes.azimuth, doppler, echoes.snr, echoes.body)


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
