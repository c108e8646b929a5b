"""A spinning LiDAR: the HDL-32E's beams, each ray cast at the time it leaves, ranged and thinned by received power."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from data_gen.rig.rig import Lidar
from data_gen.scene.scene import WORLD, Hits, Scene
from data_gen.sensors.lidar.power import (
    Returns,
    detection_probability,
    film_loss,
    range_sigma,
    rough_cosine,
    signal_to_noise,
)
from data_gen.sensors.lidar.weather import Rays, with_weather
from data_gen.world.ground import GROUND_NAMES, ground_table
from fusion_net.common.geometry import invert, rotate_yaw, transform

# fmt: off
ELEVATION_DEG = np.array([
    -30.67, -9.33, -29.33, -8.00, -28.00, -6.66, -26.66, -5.33, -25.33, -4.00, -24.00, -2.67, -22.67, -1.33, -21.33, 0.00,
    -20.00, 1.33, -18.67, 2.67, -17.33, 4.00, -16.00, 5.33, -14.67, 6.67, -13.33, 8.00, -12.00, 9.33, -10.67, 10.67,
])
# fmt: on
"""Beam elevations in firing order (HDL-32E manual)."""

RING = np.argsort(np.argsort(ELEVATION_DEG)).astype(np.uint8)
"""nuScenes' ring of each beam in firing order: 0 points down most."""

FIRING = 1.152e-6
"""Seconds from one laser of a column to the next (HDL-32E manual, appendix E)."""

RANGE_STEP = 0.002
"""Metres of one count of the range word."""

RETRO = 0.85
"""Reflectivity from which a surface is retro-reflective sheeting, reported up to 255 where diffuse per cent end at 100."""

SOAKING = np.isin(GROUND_NAMES, ("grass", "dry_grass", "gravel"))
"""Which grounds hold no film of water."""


@dataclass(frozen=True)
class LidarSweep:
    """One turn, in the LIDAR_TOP frame (x right, y forward, z up) at the turn's end, ego-motion compensated."""

    points: NDArray[np.float32]  # (P, 3) metres
    intensity: NDArray[np.float32]  # (P,) calibrated reflectivity, whole numbers 0 .. 255
    ring: NDArray[np.uint8]  # (P,)
    time: NDArray[np.float32]  # (P,) seconds relative to the turn's end, <= 0
    body: NDArray[np.int32]  # (P,) actor index, WORLD, or NOTHING for what no surface returned
    aimed: NDArray[np.int64]  # (A,) rays that would meet each actor alone
    reached: NDArray[np.int64]  # (A,) and those that did, before drop-out


def scan_lidar(
    scene: Scene,
    lidar: Lidar,
    *,
    t_end: float,
    rng: np.random.Generator,
    ego_T_sensor: NDArray[np.float64] | None = None,
) -> LidarSweep:
    """The sweep that ends at ``t_end`` seconds.

    ``ego_T_sensor`` (4, 4) is where the sensor truly sits, by default where ``lidar`` says; the compensation of the ego's
    motion uses what ``lidar`` says, as a car would that does not know better.
    """
    in_sensor, beam, dt = firing_pattern(lidar)
    believed = lidar.ego_T_sensor
    true = believed if ego_T_sensor is None else ego_T_sensor
    position, yaw, _ = scene.ego.at(t_end + dt)
    origins = position + rotate_yaw(np.broadcast_to(true[:3, 3], (len(dt), 3)), yaw)
    directions = rotate_yaw(in_sensor @ true[:3, :3].T, yaw)
    hits = scene.cast(origins, directions, t_end + dt, lidar.max_range)

    rays = Rays(origins, directions, t_end + dt)
    hard = surface_returns(scene, hits, rays, max_range=lidar.max_range)
    heard = with_weather(scene, rays, hard, max_range=lidar.max_range, crosstalk=lidar.crosstalk, rng=rng)

    seen = rng.random(len(heard.ray)) < detection_probability(heard.snr)
    ray, distance, snr, byte, body = heard.of(seen)
    measured = distance + rng.normal(size=len(ray)) * range_sigma(snr)
    measured = np.round(measured / RANGE_STEP) * RANGE_STEP
    byte = np.clip(np.round(byte * (1 + rng.normal(size=len(ray)) * 0.1 / np.sqrt(snr))), 0, 255)

    in_global = position[ray] + rotate_yaw(transform(believed, in_sensor[ray] * measured[:, None]), yaw[ray])
    points = transform(invert(scene.ego.pose(t_end) @ believed), in_global)
    return LidarSweep(
        points=points.astype(np.float32),
        intensity=byte.astype(np.float32),
        ring=RING[beam[ray]],
        time=dt[ray].astype(np.float32),
        body=body,
        aimed=hits.aimed,
        reached=hits.reached,
    )


def firing_pattern(lidar: Lidar) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """The rays of one turn that lie in the sector, in the order of their firing.

    Returns unit directions (N, 3) in the sensor frame, beam indices (N,) in firing order and times (N,) in seconds
    relative to the turn's end. The head turns clockwise seen from above: az(t) = az0 - 2 pi f t, also within a column.
    """
    return _firing_pattern(lidar.columns, lidar.rate, lidar.cut_deg, *lidar.sector_deg)


@lru_cache(maxsize=4)
def _firing_pattern(columns: int, rate: float, cut: float, low: float, high: float):
    turn = 1 / rate
    dt = (np.arange(columns) * turn / columns)[:, None] + np.arange(len(ELEVATION_DEG)) * FIRING - turn
    azimuth_deg = cut - 360 * rate * (dt + turn)
    column, beam = np.nonzero((azimuth_deg - low) % 360 <= high - low)
    azimuth, elevation = np.radians(azimuth_deg[column, beam]), np.radians(ELEVATION_DEG[beam])
    level = np.cos(elevation)
    directions = np.stack([-np.sin(azimuth) * level, np.cos(azimuth) * level, np.sin(elevation)], axis=1)
    return directions, beam, dt[column, beam]


def surface_returns(scene: Scene, hits: Hits, rays: Rays, *, max_range: float) -> Returns:
    """What the surfaces that were hit send back: P = reflectivity x cos(incidence) x e^(-2 a r) / r^2."""
    ray = np.flatnonzero(hits.body >= WORLD)
    distance = hits.distance[ray].astype(float)
    ground = np.flatnonzero(hits.face[ray] < scene.ground_faces)
    reflectivity = scene.surface.reflectivity[hits.face[ray]].astype(float)
    cosine = np.abs(np.einsum("ij,ij->i", hits.normal[ray], rays.directions[ray]))
    material = scene.ground.at(hits.local[ray[ground]])
    reflectivity[ground] = ground_table()[2][material]
    if scene.condition.water_film > 0:
        wet = ground[~SOAKING[material]]
        reflectivity[wet] *= film_loss(cosine[wet], scene.condition.water_film)
    cosine[ground] = rough_cosine(cosine[ground])
    transmission = np.exp(-2 * scene.condition.extinction * distance)
    snr = signal_to_noise(reflectivity * cosine * transmission, distance, max_range=max_range)
    # The byte is calibrated for range, not for weather; it keeps some of the incidence angle.
    byte = np.where(reflectivity < RETRO, 100.0, 255.0) * reflectivity * np.sqrt(cosine) * transmission
    return Returns(ray, distance, snr, byte, hits.body[ray])
