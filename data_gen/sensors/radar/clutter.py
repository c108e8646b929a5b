"""What a radar reports where nothing stands: noise and road clutter, raindrops, spray."""

import numpy as np

from data_gen.rig.mounts import Radar
from data_gen.scene.scene import NOTHING, Scene
from data_gen.scene.spray import EXTINCTION, plumes_at
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.radar.detection import CLUTTER, RAIN, SPRAY, THRESHOLD, Array, Echoes, link_budget_db

FALSE, AT_REST, FALSE_SPEED = 5.0, 0.7, 30.0
"""Mean number of false detections a scan, the fraction of them at rest on the ground, the greatest speed of the others."""
RAIN_COUNT, RAIN_REACH, RAIN_SPEED = 0.1, 20.0, 1.0
"""Detections of drops a scan and mm/h, the range in metres up to which there are any, and the spread of their velocity."""
SPRAY_CLUSTERS, SPRAY_RCS, SPRAY_SPEED = 2, (-10.0, 3.0), (0.3, 0.6)
"""Most clusters a plume; their RCS (mean and spread, dBsm) at the extinction behind a car at 25 m/s on 1 mm of water; their
velocity as a fraction of the vehicle's."""


def false_detections(radar: Radar, own_velocity: Array, rng: np.random.Generator, rain_rate: float = 0.0) -> Echoes:
    """Detections just over the threshold: noise and clutter all over the covered ground, most of it at rest, and rain.

    Drops fill the beam, so a cell of rain at range R returns R^2 / R^4 of what it would at 1 m; what an adaptive threshold
    leaves of such an even carpet are few spikes, ever fewer up to 20 m.
    """
    clutter, drops = rng.poisson(FALSE), rng.poisson(RAIN_COUNT * rain_rate) if rain_rate else 0
    count = clutter + drops
    rain = np.arange(count) >= clutter
    azimuth = np.radians(rng.uniform(-radar.fov_deg, radar.fov_deg, count))
    static = -(np.cos(azimuth) * own_velocity[0] + np.sin(azimuth) * own_velocity[1])
    other = rng.uniform(-FALSE_SPEED, FALSE_SPEED, count)
    nearer = rng.random(count)  # fraction of the covered ground
    still = rain | (rng.random(count) < AT_REST)
    return Echoes(
        range=np.where(rain, RAIN_REACH * (1 - np.sqrt(nearer)), radar.max_range * np.sqrt(nearer)).clip(0.5),
        azimuth=azimuth,
        doppler=np.where(still, static, other) + np.where(rain, RAIN_SPEED, 0.0) * rng.normal(size=count),
        snr=THRESHOLD * 10 ** (rng.exponential(0.2, count)),
        body=np.full(count, NOTHING, np.int32),
        cause=np.where(rain, RAIN, CLUTTER).astype(np.uint8),
    )


def spray_echoes(scene: Scene, event: CaptureEvent[Radar], own_velocity: Array) -> Echoes:
    """Weak reflections of the water behind vehicles, none to two a plume, slower than the vehicle; hidden as all else is.
    ``own_velocity`` (3,) of the sensor in its own axes."""
    plumes = plumes_at(scene, event.true_time)
    rng = event.rng
    which = np.repeat(np.arange(len(plumes.length)), rng.integers(0, SPRAY_CLUSTERS + 1, len(plumes.length)))
    count = len(which)
    back, side, up = rng.uniform((0.2, -0.8, 0.2), (0.8, 0.8, 0.8), (count, 3)).T
    rcs = rng.normal(*SPRAY_RCS, count) + 10 * np.log10(plumes.extinction[which] / EXTINCTION)
    slower = rng.uniform(*SPRAY_SPEED, count)
    left = plumes.axis[which][:, ::-1] * (-1, 1)
    place = plumes.origin[which].copy()
    place[:, :2] += (back * plumes.length[which])[:, None] * plumes.axis[which]
    place[:, :2] += (side * plumes.half_width[which, 0])[:, None] * left
    place[:, 2] += up * plumes.height[which, 0]
    global_T_sensor = scene.ego.pose(event.true_time) @ event.ego_T_sensor
    ray = place - global_T_sensor[:3, 3]
    distance = np.linalg.norm(ray, axis=1)
    ray /= distance[:, None]
    in_sensor = ray @ global_T_sensor[:3, :3]
    azimuth = np.arcsin(in_sensor[:, 1])
    moving = slower * np.einsum("kc,kc->k", ray[:, :2], plumes.speed[which])
    snr = 10 ** ((rcs + link_budget_db(distance, azimuth, event.mount, scene.condition.rain_rate)) / 10)
    echoes = Echoes(
        distance, azimuth, moving - in_sensor @ own_velocity, snr, np.full(count, NOTHING, np.int32),
        np.full(count, SPRAY, np.uint8),
    )  # fmt: skip
    in_view = (
        (in_sensor[:, 0] > 0) & (np.abs(azimuth) < np.radians(event.mount.fov_deg)) & (distance < event.mount.max_range)
    )
    return echoes[in_view & ~scene.occluded(global_T_sensor[:3, 3], ray, event.true_time, distance)]
