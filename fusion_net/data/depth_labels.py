"""What the camera branch is supervised with, one value per cell of the image at the label stride.

Cell (i, j) covers the pixels [i stride, (i + 1) stride) x [j stride, (j + 1) stride). Depth is along the camera's z
axis, in metres of the camera: an augmentation of the bird's-eye view, scaling included, does not touch it.
"""

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.geometry import transform
from fusion_net.common.nuscenes_format import DEPTH_SCALE

_FAR = np.uint16(65_535)


def lidar_depth(
    points: NDArray[np.float32], cam_T_ego: NDArray, cam_K: NDArray, *, height: int, width: int, stride: int
) -> NDArray[np.float32]:
    """(h, w): depth of the nearest of the points (P, 3+) of the ego frame that project into a cell, 0 where none."""
    x, y, z = transform(cam_T_ego, points[:, :3]).T
    front = z > 0
    x, y, z = x[front], y[front], z[front]
    column = np.floor((cam_K[0, 0] * x + cam_K[0, 1] * y + cam_K[0, 2] * z) / (z * stride))
    row = np.floor((cam_K[1, 1] * y + cam_K[1, 2] * z) / (z * stride))
    rows, columns = height // stride, width // stride
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    nearest = np.full(rows * columns, np.inf, np.float32)
    np.minimum.at(nearest, (row[inside] * columns + column[inside]).astype(np.int64), z[inside].astype(np.float32))
    return np.where(np.isfinite(nearest), nearest, np.float32(0)).reshape(rows, columns)


def dense_depth(depth: NDArray[np.uint16], stride: int) -> NDArray[np.float32]:
    """(h, w) metres: the nearest valid pixel of each cell of a depth image (H, W) in 1/DEPTH_SCALE m, 0 where all
    is sky."""
    nearest = (_cells(depth, stride) - np.uint16(1)).min(axis=-1) + np.uint16(1)  # 0 wraps to the farthest and back
    return nearest.astype(np.float32) / np.float32(DEPTH_SCALE)


def class_map(
    classes: NDArray[np.uint8], depth: NDArray[np.uint16], label_of: NDArray[np.int64], stride: int
) -> NDArray[np.int64]:
    """(h, w): ``label_of`` the class of the nearest labelled pixel of each cell, -1 where no pixel has a label."""
    label = _cells(label_of[classes], stride)
    distance = np.where(label >= 0, np.minimum(_cells(depth, stride) - np.uint16(1), _FAR - np.uint16(1)), _FAR)
    return np.take_along_axis(label, distance.argmin(axis=-1)[..., None], axis=-1)[..., 0]


def _cells(image: NDArray, stride: int) -> NDArray:
    """Image (H, W) as (h, w, stride * stride)."""
    height, width = image.shape
    blocks = image.reshape(height // stride, stride, width // stride, stride).swapaxes(1, 2)
    return blocks.reshape(height // stride, width // stride, stride * stride)
