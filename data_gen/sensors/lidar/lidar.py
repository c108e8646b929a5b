"""A spinning LiDAR: each ray cast at the time it leaves, its range measured, faint returns lost by received power."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from data_gen.rig.mounts import Lidar
from data_gen.scene.scene import Hits, Scene
from data_gen.scene.wetness import ABSORBING
from data_gen.sensors.common.data import PointData
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.lidar.beams import compensated, echoed, leave
from data_gen.sensors.lidar.power import Returns, detection_probability, range_sigma
from data_gen.sensors.lidar.weather import Rays, with_weather
from data_gen.world.ground import ground_table
from fusion_net.common.fault_effects import Rings
from fusion_net.common.geometry import invert

RANGE_STEP = 0.002
"""Metres of one count of the range word, of every Velodyne."""

_REFLECTIVITY = ground_table()[2]


@dataclass(frozen=True)
class LidarSweep(PointData):
    """One turn, in the LIDAR_TOP frame (x right, y forward, z up) at the turn's end, ego-motion compensated."""

    per_actor: ClassVar[tuple[str, ...]] = ("aimed", "reached")
    points: NDArray[np.float32]  # (P, 3) metres
    intensity: NDArray[np.float32]  # (P,) calibrated reflectivity, whole numbers 0 .. 255
    ring: NDArray[np.uint8]  # (P,)
    time: NDArray[np.float32]  # (P,) seconds relative to the turn's end, <= 0
    body: NDArray[np.int32]  # (P,) actor index, WORLD, or NOTHING for what no surface returned
    aimed: NDArray[np.int64]  # (A,) rays that would meet each actor alone; too few between keyframes
    reached: NDArray[np.int64]  # (A,) and those that did, before drop-out

    @property
    def points_in_sensor_frame(self) -> NDArray[np.float32]:
        """``points``."""
        return self.points

    @property
    def ray_counts(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """``aimed`` and ``reached``."""
        return self.aimed, self.reached

    def rings(self, mount: Lidar) -> Rings:
        """``ring``, of as many beams as the LiDAR has."""
        return Rings(self.ring, mount.model.beams)


def sense(scene: Scene, event: CaptureEvent[Lidar]) -> LidarSweep:
    """The sweep that ends at the event's time. The compensation of the ego's motion uses the nominal mount, the only one that
    the car knows."""
    lidar, t_end, rng = event.mount, event.true_time, event.rng
    in_sensor, beam, dt = firing_pattern(lidar)
    nominal, true = lidar.ego_T_sensor, event.ego_T_sensor
    position, yaw, _ = scene.ego.at(t_end + dt)
    origins, directions = leave(in_sensor, true, position, yaw)
    hits = scene.cast(origins, directions, t_end + dt, lidar.max_range, counted=event.is_keyframe)

    rays = Rays(origins, directions, t_end + dt)
    surfaces = surface_returns(scene, hits, rays, max_range=lidar.max_range)
    returns = with_weather(scene, rays, surfaces, lidar=lidar, rng=rng)

    detected = rng.random(len(returns.ray)) < detection_probability(returns.snr)
    ray, distance, snr, byte, body = returns.of(detected)
    measured = distance + rng.normal(size=len(ray)) * range_sigma(snr, noise=lidar.model.range_noise)
    measured = np.round(measured / RANGE_STEP) * RANGE_STEP
    byte = np.clip(np.round(byte * (1 + rng.normal(size=len(ray)) * 0.1 / np.sqrt(snr))), 0, 255)

    sensor_T_global = invert(scene.ego.pose(t_end) @ nominal)
    points = compensated(in_sensor[ray], measured, nominal, position[ray], yaw[ray], sensor_T_global)
    return LidarSweep(
        points=points,
        intensity=byte.astype(np.float32),
        ring=lidar.model.ring[beam[ray]],
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
    model = lidar.model
    beams = (tuple(model.elevation_deg), model.beams_at_once, model.firing_interval)
    return _firing_pattern(*beams, lidar.turn_columns, lidar.rate, lidar.cut_deg, *lidar.sector_deg)


@lru_cache(maxsize=4)
def _firing_pattern(elevations_deg, at_once, interval, columns, rate, cut, low, high):
    turn, slot = 1 / rate, np.arange(len(elevations_deg)) // at_once
    dt = (np.arange(columns) * turn / columns)[:, None] + slot * interval - turn
    azimuth_deg = cut - 360 * rate * (dt + turn)
    column, beam = np.nonzero((azimuth_deg - low) % 360 <= high - low)
    azimuth, elevation = np.radians(azimuth_deg[column, beam]), np.radians(np.array(elevations_deg, float)[beam])
    level = np.cos(elevation)
    directions = np.stack([-np.sin(azimuth) * level, np.cos(azimuth) * level, np.sin(elevation)], axis=1)
    return directions, beam, dt[column, beam]


def surface_returns(scene: Scene, hits: Hits, rays: Rays, *, max_range: float) -> Returns:
    """What the surfaces that were hit send back."""
    ground, wetness = scene.ground, scene.wetness
    raster = ground.material, np.asarray(ground.origin, float), float(ground.resolution), _REFLECTIVITY
    return Returns(
        *echoed(
            (hits.body, hits.face, hits.distance, hits.local, hits.normal), rays.directions, scene.surface.reflectivity,
            (scene.ground_faces, *raster), (ABSORBING, wetness.covered), scene.condition.extinction, max_range,
        )
    )  # fmt: skip
