"""3-D boxes and what is done with them in any frame.

A box is (centre x y z, wlh, yaw, velocity). ``wlh`` is nuScenes' order: width across, length along the heading, height.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Boxes:
    """N boxes of one sample in one frame (the reference ego frame unless a name says otherwise).

    ``score`` is 1 for labels; ``log_variance`` is that of the centre's x and y in m^2 (zeros for labels).
    """

    center: NDArray[np.float64]  # (N, 3)
    wlh: NDArray[np.float64]  # (N, 3)
    yaw: NDArray[np.float64]  # (N,) counter-clockwise from x
    velocity: NDArray[np.float64]  # (N, 2) m/s in the same axes; NaN where unknown
    label: NDArray[np.int64]  # (N,) index into the configured class list
    score: NDArray[np.float64]  # (N,)
    log_variance: NDArray[np.float64]  # (N, 2)

    def __len__(self) -> int:
        return len(self.center)

    def __getitem__(self, index) -> "Boxes":
        """The boxes at an index array, mask or slice."""
        return replace(self, **{f.name: getattr(self, f.name)[index] for f in fields(self)})

    @staticmethod
    def empty() -> "Boxes":
        """No boxes."""
        return Boxes.labels(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.int64))

    @staticmethod
    def labels(center, wlh, yaw, velocity, label) -> "Boxes":
        """Ground truth: score 1, no variance."""
        return Boxes(center, wlh, yaw, velocity, label, np.ones(len(center)), np.zeros((len(center), 2)))


def box_corners(center: NDArray, wlh: NDArray, yaw: NDArray) -> NDArray[np.float64]:
    """Corners (N, 8, 3) of boxes: the four of the front face, then of the rear, each (left, right) x (bottom, top)."""
    width, length, height = np.asarray(wlh, float).reshape(-1, 3).T
    sign = np.array([[x, y, z] for x in (1, -1) for y in (1, -1) for z in (-1, 1)], float) / 2
    local = sign[None] * np.stack([length, width, height], axis=1)[:, None]
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y = local[..., 0] * c - local[..., 1] * s, local[..., 0] * s + local[..., 1] * c
    return np.stack([x, y, local[..., 2]], axis=-1) + np.asarray(center, float).reshape(-1, 1, 3)


def points_in_box(points: NDArray, center: NDArray, wlh: NDArray, yaw: float, margin: float = 0.0) -> NDArray[np.bool_]:
    """Which of the points (N, 3) lie in one box grown by ``margin`` metres on every side."""
    local = points[:, :3] - center
    c, s = np.cos(yaw), np.sin(yaw)
    along, across = local[:, 0] * c + local[:, 1] * s, -local[:, 0] * s + local[:, 1] * c
    half = np.asarray(wlh) / 2 + margin
    return (np.abs(across) <= half[0]) & (np.abs(along) <= half[1]) & (np.abs(local[:, 2]) <= half[2])


def transform_boxes(a_T_b: NDArray, boxes: Boxes) -> Boxes:
    """Boxes of frame ``b`` in frame ``a``. Besides a rigid motion ``a_T_b`` (4, 4) may scale evenly and mirror.

    Heading and velocity go through the linear part as vectors, sizes by its scale. The variance keeps to the axes: what
    a turn makes of it off the diagonal is dropped.
    """
    linear = a_T_b[:3, :3]
    heading = np.stack([np.cos(boxes.yaw), np.sin(boxes.yaw)], axis=1) @ linear[:2, :2].T
    return replace(
        boxes,
        center=boxes.center @ linear.T + a_T_b[:3, 3],
        wlh=boxes.wlh * np.cbrt(abs(np.linalg.det(linear))),
        yaw=np.arctan2(heading[:, 1], heading[:, 0]),
        velocity=boxes.velocity @ linear[:2, :2].T,
        log_variance=np.log(np.exp(boxes.log_variance) @ np.square(linear[:2, :2]).T),
    )
