"""``num_lidar_pts`` and ``num_radar_pts`` against the devkit's own count of a keyframe's points inside each box."""

import os
from collections.abc import Iterator

import numpy as np
from check_boxes import global_T_sensor
from findings import Finding, share
from nuscenes import NuScenes
from nuscenes.utils.data_classes import LidarPointCloud, RadarPointCloud
from nuscenes.utils.geometry_utils import points_in_box


def check_counts(tree: NuScenes, samples: list[dict]) -> Iterator[Finding]:
    """Of the LiDAR and of all radars together without any filter, as nuScenes' schema says. One point on a face of a box may
    fall to either side by rounding."""
    RadarPointCloud.disable_filters()
    equal, of = {"num_lidar_pts": 0, "num_radar_pts": 0}, 0
    for sample in samples:
        clouds = {
            "num_lidar_pts": _global_points(tree, sample, "LIDAR", LidarPointCloud),
            "num_radar_pts": _global_points(tree, sample, "RADAR", RadarPointCloud),
        }
        for token in sample["anns"]:
            annotation, box = tree.get("sample_annotation", token), tree.get_box(token)
            of += 1
            for key, points in clouds.items():
                equal[key] += abs(annotation[key] - int(points_in_box(box, points).sum())) <= 1
    RadarPointCloud.default_filters()
    for key, hits in equal.items():
        yield share(f"{key}: as many points in the box as the devkit counts", hits, of, 1.0)


def _global_points(tree: NuScenes, sample: dict, prefix: str, kind: type) -> np.ndarray:
    """(3, P) of all keyframe readings of a modality."""
    clouds = [np.zeros((3, 0))]
    for channel, token in sample["data"].items():
        if channel.startswith(prefix):
            record = tree.get("sample_data", token)
            cloud = kind.from_file(os.path.join(tree.dataroot, record["filename"]))
            cloud.transform(global_T_sensor(tree, record))
            clouds.append(cloud.points[:3])
    return np.concatenate(clouds, axis=1)
