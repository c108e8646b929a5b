"""Our boxes and points as Rerun's shapes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.common.drawing import depth_colors
from fusion_net.common.geometry import transform

RADAR = (255, 90, 200)
MOVING = 0.5
"""m/s from which a box has an arrow, of one second of its velocity."""


def boxes_3d(boxes: Boxes, names: Sequence[str], **look: Any) -> rr.Boxes3D:
    """Boxes in the frame of their entity, in the colour of their class; Rerun's sizes are along x (the heading), y and z."""
    nought = np.zeros(len(boxes))
    return rr.Boxes3D(
        centers=boxes.center,
        half_sizes=boxes.wlh[:, [1, 0, 2]] / 2,
        quaternions=np.stack([nought, nought, np.sin(boxes.yaw / 2), np.cos(boxes.yaw / 2)], axis=1),
        labels=names,
        class_ids=boxes.label,
        **look,
    )


def values(**columns: NDArray) -> rr.AnyValues:
    """What else is known of the boxes of an entity, a value (N,) each; of none Rerun could not tell the type by itself."""
    return rr.AnyValues(**{name: pa.array(column) for name, column in columns.items()})


def arrows_of(boxes: Boxes) -> rr.Arrows3D:
    """A second of the velocity of those that move."""
    moving = boxes[np.linalg.norm(np.nan_to_num(boxes.velocity), axis=1) > MOVING]
    vectors = np.column_stack([moving.velocity, np.zeros(len(moving))])
    return rr.Arrows3D(origins=moving.center, vectors=vectors, class_ids=moving.label)


def lidar_colors(points: NDArray, ego_T_lidar: NDArray, *, by: str) -> NDArray[np.uint8]:
    """Colours (P, 3) of a sweep (P, 4+) x, y, z, intensity 0..255 in the sensor's frame: blue for low, red for high."""
    if not len(points):
        return np.zeros((0, 3), np.uint8)
    height = transform(ego_T_lidar, points[:, :3])[:, 2] / 3  # 3 m is as red as it gets
    share = np.sqrt(points[:, 3] / 255) if by == "intensity" else height
    return depth_colors(4 ** (3 - 3 * share.clip(0, 1)))
