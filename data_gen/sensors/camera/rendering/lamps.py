"""Lamps: which are lit, what they throw on surfaces, and where they are seen as points of light.

What shines is known from the meshes (``luminaires``); who has lamps on follows from condition and motion.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_gen.assets.shapes.mesh import Asset
from data_gen.jobs.jit import jit
from data_gen.scene.conditions import Condition
from data_gen.scene.luminaires import Luminaires, luminaires
from data_gen.scene.motion import Motion
from data_gen.scene.noise import ramp
from data_gen.scene.scene import Scene

Array = NDArray[np.float64]

LOW_BEAM = 15_000.0
"""Candela of one head-lamp."""
LAMP_COLOR = (1.06, 1.0, 0.86)
BRAKE = 8.0
"""Brake lamps have 80 cd where tail lamps have 10."""
STREET_LUX = 12.0
"""Mean illuminance of a street whose lamps burn with their full light."""
STREET_LAMP = 2_000.0
"""Lumens from which a lamp of the static world lights a street, and is off by day; signals have less."""
_LAMP_MOUNT = 0.65
"""Height of head-lamps in metres; half their spacing."""
_EGO_LAMP_X = 3.6
_BEAM_REACH, _STREET_REACH, _SEEN = 90.0, 70.0, 120.0
"""Metres from the camera within which beams, street lamps and points of light count."""
_BEAMS = {"bicycle": 0.02, "motorcycle": 1.0}
"""Low beams of a vehicle, in those of one head-lamp; two for others."""
_RED = 4.0  # as much red as green makes a tail or brake lamp


class Lamps(NamedTuple):
    """The lamps of one scene at one time, for one eye."""

    beams: Array  # (B, 6) low beams: position, direction (cos, sin of yaw), candela
    street: Luminaires  # those that light the street
    points: Luminaires  # those that the eye sees
    gain: Array  # (A + 1, 2) of the emission of white and red faces of each body; the world's, last: of others, of street lamps


@lru_cache(maxsize=256)
def _of_asset(asset: Asset) -> Luminaires:
    return luminaires(asset.mesh)


def are_lit(condition: Condition) -> bool:
    """Whether drivers have their lamps on: in the dark, in rain and in fog."""
    return condition.illuminance < 1_000.0 or condition.visibility < 1_000.0 or condition.rain_rate > 2.0


def lamp_gain(scene: Scene, motion: Motion, *, lit: bool) -> Array:
    """``Lamps.gain``: head-lamps and running lights of what drives, tail lamps if ``lit``, brake lamps of who slows down or
    waits. What is parked is dark; street lamps burn at night."""
    ahead = np.stack([np.cos(motion.yaw), np.sin(motion.yaw)], axis=1)
    speed = (motion.velocity[:, :2] * ahead).sum(axis=1)
    gains = (motion.acceleration[:, :2] * ahead).sum(axis=1)
    drives = np.array([_drives(actor.asset.category, actor.attribute) for actor in scene.actors] + [False])
    brakes = (gains < -0.6) | (np.abs(speed) < 0.3)
    gain = np.stack([np.ones(len(speed)), np.where(brakes, BRAKE, float(lit))], axis=1) * drives[:, None]
    gain[-1] = 1.0, float(scene.condition.is_night)
    return gain


def _drives(category: str, attribute: str) -> bool:
    return category.startswith("vehicle.") and not attribute.endswith(("parked", "without_rider"))


def lamps_of(scene: Scene, motion: Motion, eye: Array, t: float) -> Lamps:
    """The lamps around ``eye`` (3,). By clear day there are none but those that the camera sees as bright faces."""
    lit = are_lit(scene.condition)
    gain = lamp_gain(scene, motion, lit=lit)
    none = Luminaires(*(np.zeros((0, 3)) for _ in range(3)))
    if not lit:
        return Lamps(np.zeros((0, 6)), none, none, gain)
    world = _within(scene.luminaires, eye, _SEEN)
    is_street = world.flux.sum(axis=1) > STREET_LAMP
    bright = min(scene.condition.illuminance / STREET_LUX, 1.0) if scene.condition.is_night else 0.0
    world = world._replace(flux=world.flux * np.where(is_street, bright, 1.0)[:, None])
    street, beams = none, np.zeros((0, 6))
    if scene.condition.is_night:
        street = _within(Luminaires(*(field[is_street] for field in world)), eye, _STREET_REACH)
        beams = _beams(scene, motion, eye, t)
    return Lamps(beams, street, _points(scene, motion, eye, t, gain, world), gain)


def _within(lamps: Luminaires, eye: Array, reach: float) -> Luminaires:
    near = np.linalg.norm(lamps.position - eye, axis=1) < reach
    return Luminaires(*(field[near] for field in lamps))


def _points(scene: Scene, motion: Motion, eye: Array, t: float, gain: Array, world: Luminaires) -> Luminaires:
    """The lamps (P, ...) that send light to the eye: lit, turned towards it and not hidden."""
    position, yaw = motion.position, motion.yaw
    parts = [world]
    near = np.linalg.norm(position[:-1] - eye, axis=1) < _SEEN
    for index in np.flatnonzero(near & (gain[:-1].max(axis=1) > 0)).tolist():
        lamps = _of_asset(scene.actors[index].asset)
        c, s = np.cos(yaw[index]), np.sin(yaw[index])
        turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        red = lamps.flux[:, 0] > _RED * lamps.flux[:, 1]
        flux = lamps.flux * gain[index][red.astype(int), None]
        parts.append(Luminaires(lamps.position @ turn + position[index], lamps.axis @ turn, flux))
    points = Luminaires(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    towards = eye - points.position
    distance = np.linalg.norm(towards, axis=1)
    towards /= distance[:, None]
    kept = (points.flux.max(axis=1) > 0) & (
        (towards * points.axis).sum(axis=1) + 0.3 > np.linalg.norm(points.axis, axis=1)
    )
    kept = np.flatnonzero(kept & (distance > 1.0))
    # A ray to the lamp ends before the face that is the lamp and whatever it is set into.
    hidden = scene.occluded(eye, -towards[kept], t, distance[kept] - 0.6)
    return Luminaires(*(field[kept[~hidden]] for field in points))


def _beams(scene: Scene, motion: Motion, eye: Array, t: float) -> Array:
    """Low beams (B, 6) of the ego and of vehicles around, one for both lamps of a vehicle."""
    ego = scene.ego.pose(t)
    sides = ego[:3, :3] @ [[_EGO_LAMP_X] * 2, [_LAMP_MOUNT, -_LAMP_MOUNT], [_LAMP_MOUNT] * 2] + ego[:3, 3:]
    beams = [(*place, ego[0, 0], ego[1, 0], LOW_BEAM) for place in sides.T]
    position, yaw = motion.position, motion.yaw
    near = np.flatnonzero(np.hypot(*(position - eye)[:-1, :2].T) < _BEAM_REACH)
    for actor, (x, y, z), angle in zip((scene.actors[i] for i in near), position[near], yaw[near], strict=True):
        if not _drives(actor.asset.category, actor.attribute):
            continue
        count = _BEAMS.get(actor.asset.category.removeprefix("vehicle."), 2.0)
        nose, c, s = actor.asset.size[0] / 2 + 0.05, np.cos(angle), np.sin(angle)
        beams.append((x + nose * c, y + nose * s, z + _LAMP_MOUNT, c, s, count * LOW_BEAM))
    return np.array(beams)


@jit
def beam_lux(p, n, beams):
    """Illuminance in lux at ``p`` on a face with normal ``n`` from low beams (B, 6): +-20 degrees across, -1 to -15 degrees
    down, E = I cos / d^2."""
    total = 0.0
    for j in range(len(beams)):
        dx, dy, dz = p[0] - beams[j, 0], p[1] - beams[j, 1], p[2] - beams[j, 2]
        along = dx * beams[j, 3] + dy * beams[j, 4]
        d2 = dx * dx + dy * dy + dz * dz + 0.3
        if along < 0.2 or d2 > 8100.0:
            continue
        d = np.sqrt(d2)
        facing = -(n[0] * dx + n[1] * dy + n[2] * dz) / d
        if facing <= 0:
            continue
        across = (dy * beams[j, 3] - dx * beams[j, 4]) / along
        down = -dz / along
        wide = np.exp(-((across / 0.36) ** 2) * 1.4)
        high = 0.06 + 0.94 * ramp(-0.012, 0.018, down) * (1 - ramp(0.10, 0.34, down))
        total += beams[j, 5] * wide * high * facing / d2
    return total


@jit
def add_street_lux(p, n, lamps, out):
    """Illuminance in lux at ``p`` on a face with normal ``n`` from luminaires within 40 m, added to ``out`` (3,)."""
    position, axis, flux = lamps
    for j in range(len(position)):
        dx, dy, dz = p[0] - position[j, 0], p[1] - position[j, 1], p[2] - position[j, 2]
        d2 = dx * dx + dy * dy + dz * dz + 0.3
        if d2 > 1600.0:
            continue
        d = np.sqrt(d2)
        facing = -(n[0] * dx + n[1] * dy + n[2] * dz) / d
        if facing <= 0:
            continue
        weight = sent(dx / d, dy / d, dz / d, axis[j]) * facing / d2
        for c in range(3):
            out[c] += flux[j, c] * weight


@jit
def sent(x, y, z, axis):
    """Candela a lumen that a luminaire sends in the unit direction (x, y, z)."""
    flat = np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    return ((1 - flat) * 0.25 + max(x * axis[0] + y * axis[1] + z * axis[2], 0.0)) / np.pi
