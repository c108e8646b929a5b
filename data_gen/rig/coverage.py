"""What a rig looks at: the sectors of its sensors as intervals of azimuth, and the points that they see in the open."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_gen.rig.rig import Camera, Lidar, Mount, Radar, Rig
from data_gen.sensors.lidar.lidar import ELEVATION_DEG
from fusion_net.common.geometry import invert, project, transform

Interval = tuple[float, float]


@dataclass(frozen=True)
class View:
    """A sector of the ground as seen from the ego: directions within ``half`` radians of ``center``, counter-clockwise from
    straight ahead. ``half`` is pi for all round."""

    center: float
    half: float


FRONT = View(0.0, float(np.radians(36.0)))
"""The view of a single front camera of 72 degrees, by which traffic and its surroundings were tuned."""


def sector_deg(mount: Mount) -> Interval:
    """Azimuths that a sensor covers, counter-clockwise from its boresight, in degrees: right-hand then left-hand edge."""
    if isinstance(mount, Camera):
        (focal, _, cx), _, _ = mount.cam_K.tolist()
        return float(-np.degrees(np.arctan((mount.width - cx) / focal))), float(np.degrees(np.arctan(cx / focal)))
    if isinstance(mount, Lidar):
        return mount.sector_deg[0], mount.sector_deg[1]
    assert isinstance(mount, Radar)
    return -mount.fov_deg, mount.fov_deg


def view_of(rig: Rig) -> View:
    """The smallest sector that holds the views of all cameras; of a rig without any, of the LiDARs, or else of the radars.

    Where objects are placed hangs on it, so it goes by nominal figures: a camera's field of view about its boresight, yaws
    in whole degrees.
    """
    intervals = []
    for mount in (rig.cameras or rig.lidars or rig.radars).values():
        low, high = (-mount.hfov_deg / 2, mount.hfov_deg / 2) if isinstance(mount, Camera) else sector_deg(mount)
        yaw = round(mount.rotation_deg[2])
        intervals.append((yaw + low, yaw + high))
    blind = max(gaps(intervals), default=(180.0, 180.0), key=lambda gap: gap[1] - gap[0])
    half = 180.0 - (blind[1] - blind[0]) / 2
    center = ((blind[0] + blind[1]) / 2 + 360.0) % 360.0 - 180.0
    return View(float(np.radians(center)), float(np.radians(half)))


def gaps(intervals: list[Interval]) -> list[Interval]:
    """What the intervals of azimuth leave of the circle, in degrees counter-clockwise from the first one's start."""
    if not intervals:
        return [(-180.0, 180.0)]
    spans = sorted((low % 360.0, high - low) for low, high in intervals)
    first = spans[0][0]
    reach = max(first, *(start + width - 360.0 for start, width in spans))  # of those that go past the cut
    found = []
    for start, width in [*spans, (first + 360.0, 0.0)]:
        if start > reach:
            found.append((reach, start))
        reach = max(reach, start + width)
    return found


def sees(mount: Mount, points: ArrayLike) -> NDArray[np.bool_]:
    """Which ego points (N, 3) lie in a camera's image, within a LiDAR's or within a radar's field of view and range."""
    local = transform(invert(mount.ego_T_sensor), points)
    if isinstance(mount, Camera):
        (u, v), depth = project(mount.cam_K, local)[0].T, local[:, 2]
        return (depth > 0) & (u >= 0) & (u < mount.width) & (v >= 0) & (v < mount.height)
    body = transform(invert(mount.ego_T_body), points)
    low, high = sector_deg(mount)
    azimuth = np.degrees(np.arctan2(body[:, 1], body[:, 0]))
    inside = (azimuth - low) % 360 <= high - low
    distance = np.linalg.norm(body, axis=1)
    if isinstance(mount, Lidar):
        elevation = np.degrees(np.arcsin(body[:, 2] / np.maximum(distance, 1e-9)))
        inside &= (elevation >= ELEVATION_DEG.min()) & (elevation <= ELEVATION_DEG.max())
    return inside & (distance <= getattr(mount, "max_range", np.inf))


def nearest_ground(mount: Mount) -> float:
    """Horizontal distance in metres from a camera or LiDAR to the nearest ground that it sees, inf where it sees none."""
    if isinstance(mount, Camera):
        u, v = np.meshgrid(np.linspace(0, mount.width, 65), np.linspace(0, mount.height, 65))
        pixels = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1)
        rays = pixels @ np.linalg.inv(mount.cam_K).T @ mount.ego_T_sensor[:3, :3].T
    else:
        azimuth, elevation = np.meshgrid(np.radians(np.linspace(*sector_deg(mount), 181)), np.radians(ELEVATION_DEG))
        level = np.cos(elevation)
        body = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)
        rays = body @ mount.ego_T_body[:3, :3].T
    down = rays[rays[:, 2] < -1e-6]
    reach = np.hypot(down[:, 0], down[:, 1]) / -down[:, 2] * mount.translation[2]
    return float(reach.min(initial=np.inf))
