"""Augmentation of a sample: one matrix for the bird's-eye view, one for the colours.

The colour matrix goes with the sample; the image network applies it, and only while it learns: features of a frozen
one are those of the images as they are, computed once. The bird's-eye matrix (4, 4) turns, mirrors and scales the ego
frame, and with it points, boxes, headings, velocities and the cameras' ``ego_T_cam``, so that a 3-D point stays on its
pixel and its cell. A scaled or mirrored ``ego_T_cam`` is no rigid motion any more: invert it as a general matrix. Depth
labels are metres of the camera and stay as they are.
"""

from dataclasses import dataclass, replace

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.common.boxes import transform_boxes
from fusion_net.common.geometry import from_yaw
from fusion_net.data.samples import Sample

GREY = np.array([0.299, 0.587, 0.114])
"""Luma of RGB (ITU-R BT.601)."""
SAME_VIEW = np.eye(4)


@beartype
@dataclass(frozen=True, kw_only=True)
class Augment:
    """Ranges of the random changes of a sample. ``rotation_deg``: heading within +-; ``scale``: size within 1 +-; ``flip_y``
    mirrors left and right in half of the samples. ``brightness``, ``contrast``, ``saturation``: factors within 1 +-, the
    same for all cameras of the sample."""

    rotation_deg: float = 0.0
    scale: float = 0.0
    flip_y: bool = False
    brightness: float = 0.0
    contrast: float = 0.0
    saturation: float = 0.0

    def __post_init__(self) -> None:
        for name in ("scale", "brightness", "contrast", "saturation"):
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"augment: {name}={getattr(self, name)} is not within [0, 1)")

    def __call__(self, sample: Sample, rng: np.random.Generator) -> Sample:
        """The sample, changed at random."""
        changed = change_view(sample, self.random_view(rng))
        return replace(changed, colors=self.random_colors(rng).astype(np.float32))

    def random_view(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """``new_T_ego`` (4, 4)."""
        turn, size = rng.uniform(-1, 1, 2) * (np.radians(self.rotation_deg), self.scale)
        mirror = -1.0 if rng.random() < 0.5 and self.flip_y else 1.0
        return from_yaw(turn) @ np.diag([1 + size, mirror * (1 + size), 1 + size, 1.0])

    def random_colors(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """(3, 4) from (R, G, B, 1) in 0..255 to the new RGB."""
        reach = (self.brightness, self.contrast, self.saturation)
        brightness, contrast, saturation = 1 + rng.uniform(-1, 1, 3) * reach
        mix = saturation * np.eye(3) + (1 - saturation) * GREY  # each colour against its own grey
        offset = np.full((3, 1), 127.5 * (1 - contrast) * brightness)
        return np.hstack([mix * contrast * brightness, offset])


def change_view(sample: Sample, new_T_ego: NDArray[np.float64]) -> Sample:
    """The sample in another ego frame (4, 4)."""
    linear = new_T_ego[:3, :3].astype(np.float32)
    radar = move_points(sample.radar_points, new_T_ego)
    if radar is not sample.radar_points:
        radar[:, 4:6] = radar[:, 4:6] @ linear[:2, :2].T  # vx, vy
    return replace(
        sample,
        lidar_points=move_points(sample.lidar_points, new_T_ego),
        radar_points=radar,
        ego_T_cam=new_T_ego @ sample.ego_T_cam,
        boxes=transform_boxes(new_T_ego, sample.boxes),
    )


def move_points(points: NDArray[np.float32], new_T_ego: NDArray[np.float64]) -> NDArray[np.float32]:
    """Points (P, 3+) in another ego frame (4, 4); themselves where it is the same. A matrix without a turn takes one pass
    over the points in place of a product, with the same result to the bit."""
    if np.array_equal(new_T_ego, SAME_VIEW):
        return points
    linear, shift = new_T_ego[:3, :3].astype(np.float32), new_T_ego[:3, 3].astype(np.float32)
    moved = points.copy()
    if np.count_nonzero(linear) > np.count_nonzero(linear.diagonal()):
        moved[:, :3] = points[:, :3] @ linear.T + shift
        return moved
    for axis in np.flatnonzero((linear.diagonal() != 1) | (shift != 0)):
        column = moved[:, axis]
        column *= linear[axis, axis]
        column += shift[axis]
    return moved
