"""A 77 GHz radar that reports detections: the list that a car gets.

Reflections come from ``echoes``, their mirror images from ``ghosts``, what is nothing from
``clutter``; ``detection`` is the receiver between them and the list.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_gen.rig.mounts import Radar
from data_gen.scene.scene import Scene
from data_gen.sensors.common.data import PointData
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.radar.clutter import false_detections, spray_echoes
from data_gen.sensors.radar.detection import Array, Echoes, detect, link_budget_db
from data_gen.sensors.radar.echoes import sensor_velocity, visible_echoes
from data_gen.sensors.radar.flags import RAMP, ambig_state, detected_in_both_ramps, invalid_state, pdh0
from data_gen.sensors.radar.ghosts import ghost_echoes
from fusion_net.common.geometry import wrap_angle

MOVING, STATIONARY, ONCOMING = 0, 1, 2
"""The codes of nuScenes' dyn_prop that a single scan can tell; "stopped" and "crossing" need a history."""
STATIONARY_SPEED = 0.5
"""Compensated radial speed in m/s up to which a detection is called stationary."""
RCS_STEP, RCS_LIMITS = 0.5, (-64.0, 63.5)
"""dBsm: what the eight bits of an ARS408's message hold."""


@dataclass(frozen=True)
class RadarScan(PointData):
    """P detections in the sensor's frame (x along the boresight, y left)."""

    x: NDArray[np.float32]  # metres
    y: NDArray[np.float32]
    rcs: NDArray[np.float32]  # dBsm, as a receiver infers it from power and range, in steps of RCS_STEP
    vx: NDArray[np.float32]  # radial velocity as a vector in sensor axes, m/s
    vy: NDArray[np.float32]
    vx_comp: NDArray[np.float32]  # the same without the sensor's own motion: zero for what stands still
    vy_comp: NDArray[np.float32]
    range: NDArray[np.float32]  # metres
    azimuth: NDArray[np.float32]  # radians counter-clockwise from the boresight
    doppler: NDArray[np.float32]  # d(range)/dt in m/s: positive recedes; folded into +-max_doppler
    snr_db: NDArray[np.float32]
    dyn_prop: NDArray[np.uint8]  # nuScenes' code
    body: NDArray[np.int32]  # actor index, WORLD, or NOTHING for ghosts and false detections
    ambig_state: NDArray[np.uint8]  # codes of ``flags``: whether another fold of the Doppler is plausible
    invalid_state: NDArray[np.uint8]  # what the sensor suspects: LOW_RCS, MIRROR
    pdh0: NDArray[np.uint8]  # how likely it thinks the detection is nothing
    cause: NDArray[np.uint8]  # a code of ``detection``: DIRECT, UNDERBODY, SINGLE_BOUNCE, ..., SPRAY

    @property
    def points_in_sensor_frame(self) -> NDArray[np.float32]:
        """In the sensor's own plane: it measures no elevation."""
        return np.stack([self.x, self.y, 0 * self.x], axis=1)


def sense(scene: Scene, event: CaptureEvent[Radar]) -> RadarScan:
    """One scan."""
    return sense_batch(scene, [event])[0]


def sense_batch(scene: Scene, events: Sequence[CaptureEvent[Radar]]) -> list[RadarScan]:
    """The scans of several events, each as if it were alone; together they cost little more than one."""
    if not events:
        return []
    scans = []
    for event, direct, mirrored in zip(events, visible_echoes(scene, events), ghost_echoes(scene, events), strict=True):
        own_velocity = sensor_velocity(scene, event.mount.ego_T_sensor, event.true_time)
        echoes = [direct, mirrored]
        if scene.condition.spray:
            echoes.append(spray_echoes(scene, event, own_velocity))
        true = detect(Echoes.concatenate(echoes), event.mount, event.rng)
        false = false_detections(event.mount, own_velocity, event.rng, scene.condition.rain_rate)
        found = Echoes.concatenate([true, false]).strongest(event.mount.max_detections)
        scans.append(report(found, event.mount, own_velocity, event.rng))
    return scans


def report(found: Echoes, radar: Radar, own_velocity: Array, rng: np.random.Generator) -> RadarScan:
    """Detections as the car gets them: positions, relative and ground radial velocities, inferred cross-sections, doubts.

    Of the velocities over ground that fold into the measured Doppler a car takes the least, as most of the world stands still:
    of a target too faint for one of the ramps, there are many.
    """
    cos, sin = np.cos(found.azimuth), np.sin(found.azimuth)
    both = detected_in_both_ramps(found.snr, rng)
    limit = np.where(both, radar.max_doppler, min(RAMP, radar.max_doppler))
    own = cos * own_velocity[0] + sin * own_velocity[1]
    ground = wrap_angle(found.doppler + own, 2 * limit)
    doppler = wrap_angle(ground - own, 2 * radar.max_doppler)
    snr_db = 10 * np.log10(found.snr)
    rcs = np.round((snr_db - link_budget_db(found.range, found.azimuth, radar)) / RCS_STEP) * RCS_STEP
    rcs = rcs.clip(*RCS_LIMITS)
    columns = {
        "x": found.range * cos,
        "y": found.range * sin,
        "rcs": rcs,
        "vx": doppler * cos,
        "vy": doppler * sin,
        "vx_comp": ground * cos,
        "vy_comp": ground * sin,
        "range": found.range,
        "azimuth": found.azimuth,
        "doppler": doppler,
        "snr_db": snr_db,
    }
    motion = np.select([np.abs(ground) <= STATIONARY_SPEED, ground < 0], [STATIONARY, ONCOMING], MOVING).astype(
        np.uint8
    )
    invalid = invalid_state(rcs, found.cause, rng)
    return RadarScan(
        **{k: v.astype(np.float32) for k, v in columns.items()},
        dyn_prop=motion,
        body=found.body,
        ambig_state=ambig_state(ground, limit, motion == STATIONARY),
        invalid_state=invalid,
        pdh0=pdh0(snr_db, both, invalid),
        cause=found.cause,
    )
