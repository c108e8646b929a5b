"""LiDAR sweeps and radar scans as points in the reference frame, with what the faults of their sensors leave of them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.fault_effects import Rings
from fusion_net.data.batch import LIDAR_CHANNELS, RADAR_CHANNELS
from fusion_net.data.sensor_frames import SampleContext, SensorFrame
from fusion_net.nuscenes.ego_path import ego_path
from fusion_net.nuscenes.sensor_files import read_lidar, read_radar

EGO_EXTENT = 1.0
"""Metres: LiDAR returns with |x| and |y| below it in the sensor frame are of the car itself (the devkit's figure)."""


def lidar_point_cloud(context: SampleContext, frame: SensorFrame) -> NDArray[np.float32]:
    """Points (P, 5) LIDAR_CHANNELS of one sweep, without the car's own and without NaN."""
    with context.nusc.file_of(frame.record) as path:
        points, time = read_lidar(path)
    own = (np.abs(points[:, 0]) < EGO_EXTENT) & (np.abs(points[:, 1]) < EGO_EXTENT)
    keep = ~own & np.isfinite(points.sum(axis=1))
    if frame.faults:
        rings = Rings(points[:, 4], context.nusc.beams[context.nusc.channel(frame.record)])
        keep &= frame.faults.kept(points[:, :3], frame.reported_mount, frame.stamp, rings)
    points, time = points[keep], time[keep]
    ego_T_lidar = frame.ego_T_sensor.astype(np.float32)
    cloud = np.empty((len(points), len(LIDAR_CHANNELS)), np.float32)
    cloud[:, :3] = points[:, :3] @ ego_T_lidar[:3, :3].T + ego_T_lidar[:3, 3]
    cloud[:, 3] = points[:, 3] / 255
    cloud[:, 4] = frame.age - time
    return cloud


def radar_point_cloud(
    context: SampleContext, sensor_frames: Sequence[SensorFrame], *, default_filter: bool
) -> NDArray[np.float32]:
    """Points (R, 7) RADAR_CHANNELS of any number of scans, where they were measured."""
    if not sensor_frames:
        return np.zeros((0, len(RADAR_CHANNELS)), np.float32)
    scans = [_scan(context, frame, default_filter) for frame in sensor_frames]
    seen, scan = np.concatenate(scans), np.repeat(np.arange(len(scans)), [len(scan) for scan in scans])
    ego_T_radar = np.stack([frame.ego_T_sensor for frame in sensor_frames])[scan]
    age = np.array([frame.age for frame in sensor_frames])[scan, None]
    place = np.stack([seen["x"], seen["y"], seen["z"]], axis=1)
    position = np.einsum("pij,pj->pi", ego_T_radar[:, :3, :3], place) + ego_T_radar[:, :3, 3]
    vector = np.stack([seen["vx_comp"], seen["vy_comp"]], axis=1)
    velocity = np.einsum("pij,pj->pi", ego_T_radar[:, :2, :2], vector)  # turned, not moved
    return np.hstack([position, seen["rcs"][:, None], velocity, age]).astype(np.float32)


def _scan(context: SampleContext, frame: SensorFrame, default_filter: bool) -> NDArray[np.void]:
    """Detections of one radar. One that does not know where it looks takes the wrong part of the car's own speed off the
    Doppler, so that what stands still seems to move."""
    with context.nusc.file_of(frame.record) as path:
        seen = read_radar(path, default_filter=default_filter)
    if not frame.faults:
        return seen
    place = np.stack([seen["x"], seen["y"], seen["z"]], axis=1)
    kept = frame.faults.kept(place, frame.reported_mount, frame.stamp)
    seen, place = seen[kept], place[kept]
    if frame.mount is frame.reported_mount:
        return seen
    turn, speed = np.split(ego_path(context.nusc, context.scene).twist(frame.stamp), 2)
    own = [(speed + np.cross(turn, m[:3, 3])) @ m[:3, :3] for m in (frame.reported_mount, frame.mount)]
    ray = place[:, :2] / np.linalg.norm(place[:, :2], axis=1, keepdims=True)
    error = (ray @ (own[1] - own[0])[:2])[:, None] * ray
    seen["vx_comp"] += error[:, 0]
    seen["vy_comp"] += error[:, 1]
    return seen
