"""The labelled boxes against the readings, by the devkit's own transforms: points inside, pixels covered, velocities."""

import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from findings import Finding, share
from nuscenes import NuScenes
from nuscenes.eval.detection.constants import DETECTION_NAMES
from nuscenes.eval.detection.utils import category_to_detection_name
from nuscenes.utils.data_classes import Box, LidarPointCloud
from nuscenes.utils.geometry_utils import points_in_box, transform_matrix, view_points
from project import nuscenes_format
from pyquaternion import Quaternion

MARGIN = 0.1
"""Metres that a box is grown by on every side before LiDAR points are counted: some standard deviations of the range."""
SEEN_TO = 55.0
"""Metres of depth up to which objects are labelled, less half a truck."""


def check_boxes(tree: NuScenes, samples: list[dict]) -> Iterator[Finding]:
    """Boxes against LiDAR and camera in ``samples``, and all boxes' velocities."""
    yield from _lidar(tree, samples)
    yield from _camera(tree, samples)
    yield from _velocity(tree)


def _lidar(tree: NuScenes, samples: list[dict]) -> Iterator[Finding]:
    labelled, frozen, moved = 0, 0, 0
    for sample in samples:
        record = tree.get("sample_data", sample["data"][nuscenes_format.REFERENCE])
        path = os.path.join(tree.dataroot, record["filename"])
        points = global_T_sensor(tree, record) @ _homogeneous(LidarPointCloud.from_file(path).points[:3])
        times = _times(path, points.shape[1])
        for token in sample["anns"]:
            annotation = tree.get("sample_annotation", token)
            own = nuscenes_format.LIDAR_ECHOES  # wherever they lie
            count = annotation.get(own, annotation["num_lidar_pts"])
            box = _grown(tree.get_box(token))
            labelled += count
            frozen += min(count, int(points_in_box(box, points[:3]).sum()))
            shifted = points[:3] - np.append(velocity_of(tree, annotation), 0.0)[:, None] * times
            moved += min(count, int(points_in_box(box, shifted).sum()))
    yield share("LiDAR points of labels: inside their box, which stands still", frozen, labelled, 0.80)
    yield share("LiDAR points of labels: inside their box where it was at the point's time", moved, labelled, 0.98)


def _camera(tree: NuScenes, samples: list[dict]) -> Iterator[Finding]:
    """Of the pixels that show an object, those that a projected box of its class covers."""
    covered, of = 0, 0
    for sample in samples:
        for channel, token in sample["data"].items():
            if channel.startswith("CAM"):
                hits, pixels = _covered(tree, sample, token)
                covered, of = covered + hits, of + pixels
    yield share("pixels of objects: inside a projected box of their class", covered, of, 0.98)


def _covered(tree: NuScenes, sample: dict, token: str) -> tuple[int, int]:
    record = tree.get("sample_data", token)
    path = Path(tree.dataroot) / record["filename"]
    if not path.with_suffix(nuscenes_format.CLASS_SUFFIX).exists():
        return 0, 0
    classes = cv2.imread(str(path.with_suffix(nuscenes_format.CLASS_SUFFIX)), cv2.IMREAD_UNCHANGED)
    depth = cv2.imread(str(path.with_suffix(nuscenes_format.DEPTH_SUFFIX)), cv2.IMREAD_UNCHANGED)
    depth = depth / nuscenes_format.DEPTH_SCALE
    late = 1e-6 * (record["timestamp"] - sample["timestamp"])
    camera_T_global = np.linalg.inv(global_T_sensor(tree, record))
    intrinsic = np.array(tree.get("calibrated_sensor", record["calibrated_sensor_token"])["camera_intrinsic"])
    under = np.zeros((1 + len(DETECTION_NAMES), *classes.shape), np.uint8)
    for annotation_token in sample["anns"]:
        annotation, box = tree.get("sample_annotation", annotation_token), tree.get_box(annotation_token)
        name = category_to_detection_name(annotation["category_name"])
        box.translate(np.append(velocity_of(tree, annotation), 0.0) * late)
        outline = _outline((camera_T_global @ _homogeneous(box.corners()))[:3], intrinsic)
        if name and len(outline):
            cv2.fillConvexPoly(under[1 + DETECTION_NAMES.index(name)], outline, 1)
    shown = (classes > 0) & (depth > 0) & (depth < SEEN_TO)
    hits = [cv2.dilate(mask, np.ones((3, 3), np.uint8)) & (shown & (classes == i)) for i, mask in enumerate(under)]
    return int(np.sum(hits)), int(shown.sum())


def _outline(corners: np.ndarray, intrinsic: np.ndarray) -> np.ndarray:
    """Outline (P, 1, 2) in whole pixels of what lies before the camera of a box with corners (3, 8)."""
    share = np.linspace(0, 1, 33)[:, None, None]
    lines = corners[:, :, None] * share[..., None] + corners[:, None, :] * (1 - share[..., None])  # (33, 3, 8, 8)
    points = np.moveaxis(lines, 1, 0).reshape(3, -1)
    points = points[:, points[2] > 0.3]
    pixels = view_points(points, intrinsic, normalize=True)[:2].T
    return (
        np.rint(cv2.convexHull(np.clip(pixels, -1e4, 1e4).astype(np.float32))).astype(np.int32) if len(pixels) else ()
    )


def _velocity(tree: NuScenes) -> Iterator[Finding]:
    """Finite differences against the exact velocity that our labels carry beside nuScenes' fields."""
    errors: dict[str, list[float]] = {"centred": [], "one-sided": []}
    for row in tree.sample_annotation:
        found = tree.box_velocity(row["token"])[:2]
        if nuscenes_format.EXACT_VELOCITY in row and np.isfinite(found).all():
            kind = "centred" if row["prev"] and row["next"] else "one-sided"
            errors[kind].append(float(np.hypot(*(found - row[nuscenes_format.EXACT_VELOCITY]))))
    for kind, limit in (("centred", 0.5), ("one-sided", 1.5)):
        values = np.array(errors[kind] or [0.0])
        text = f"velocity by {kind} differences: off the exact one"
        yield Finding(f"{text}, median", float(np.median(values)), "<=", 0.1, len(errors[kind]), "m/s")
        yield Finding(f"{text}, 95 % below", float(np.percentile(values, 95)), "<=", limit, len(errors[kind]), "m/s")


def global_T_sensor(tree: NuScenes, record: dict) -> np.ndarray:
    """(4, 4) of the sensor that took a sample_data record."""
    pose = tree.get("ego_pose", record["ego_pose_token"])
    mount = tree.get("calibrated_sensor", record["calibrated_sensor_token"])
    return transform_matrix(pose["translation"], Quaternion(pose["rotation"])) @ transform_matrix(
        mount["translation"], Quaternion(mount["rotation"])
    )


def velocity_of(tree: NuScenes, annotation: dict) -> np.ndarray:
    """(2,) m/s: the exact one where there is one."""
    exact = annotation.get(nuscenes_format.EXACT_VELOCITY)
    return np.array(exact or np.nan_to_num(tree.box_velocity(annotation["token"])[:2]))


def _times(path: str, count: int) -> np.ndarray:
    """Seconds (P,) of the points relative to the sweep's stamp, from the side file; 0 where there is none."""
    side_file = path.removesuffix(nuscenes_format.FILE_SUFFIX["lidar"]) + nuscenes_format.TIME_SUFFIX
    return np.load(side_file) if os.path.exists(side_file) else np.zeros(count)


def _grown(box: Box) -> Box:
    box.wlh = box.wlh + 2 * MARGIN
    return box


def _homogeneous(points: np.ndarray) -> np.ndarray:
    return np.vstack([points, np.ones(points.shape[1])])
