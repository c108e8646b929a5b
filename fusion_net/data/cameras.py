"""One camera of one sample: the picture as the network sees it, its geometry and its labels."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion_net.common.geometry import invert
from fusion_net.common.nuscenes_format import CLASS_SUFFIX, DEPTH_SUFFIX
from fusion_net.data.depth_labels import class_map, dense_depth, lidar_depth
from fusion_net.nuscenes.sensor_files import read_image, read_labels

MAX_WIDTH = 704
"""Pixels that an image is wide at most unless a size is asked for: what detectors on nuScenes' 1600 commonly take."""


@dataclass(frozen=True)
class CameraView:
    """What one camera gave. Labels are None where there is no source for them."""

    image: NDArray[np.uint8]  # (H, W, 3) RGB
    cam_K: NDArray[np.float64]  # (3, 3)
    ego_T_cam: NDArray[np.float64]  # (4, 4)
    alive: bool
    lidar_depth: NDArray[np.float32]  # (h, w)
    dense_depth: NDArray[np.float32] | None  # (h, w)
    class_map: NDArray[np.int64] | None  # (h, w)


@dataclass(frozen=True)
class ImageFit:
    """Scales a picture of any size to a width and cuts rows off its top, so that (H, W) come out."""

    source: tuple[int, int]
    height: int
    width: int

    @property
    def scaled_height(self) -> int:
        """Rows after scaling, before the cut."""
        return round(self.source[0] * self.width / self.source[1])

    def image(self, image: NDArray, interpolation: int = cv2.INTER_AREA) -> NDArray:
        """The picture (height, width, ...)."""
        if self.width != self.source[1]:
            image = cv2.resize(image, (self.width, self.scaled_height), interpolation=interpolation)
        return image[self.scaled_height - self.height :]

    def cam_K(self, cam_K: NDArray) -> NDArray[np.float64]:
        """The pinhole matrix of the fitted picture. With pixel centres at +0.5 scaling is a plain product."""
        scaled = np.diag([self.width / self.source[1], self.scaled_height / self.source[0], 1.0]) @ cam_K
        scaled[1, 2] -= self.scaled_height - self.height
        return scaled


def check_size(size: Sequence[int], stride: int | None) -> None:
    """ValueError where ``size`` is not [H, W] in whole cells of ``stride`` pixels."""
    if len(size) != 2 or min(size) < 1:
        raise ValueError(f"image_size={list(size)} is not [height, width] in pixels")
    if stride and (size[0] % stride or size[1] % stride):
        near = [max(stride, pixels // stride * stride) for pixels in size]
        raise ValueError(f"image_size={list(size)} is not in whole cells of {stride} pixels (label_stride); use {near}")


def fit_image(source: tuple[int, int], size: Sequence[int] | None, stride: int | None) -> ImageFit:
    """How a picture of ``source`` (H, W) becomes one of ``size``; None: at most ``MAX_WIDTH`` wide, the aspect kept but
    for the rows and columns that make no whole cell of ``stride`` pixels, or as it is where no cells are wanted."""
    if size is None and stride is None:
        return ImageFit(source, *source)
    cell = stride or 1
    width = min(source[1], MAX_WIDTH) // cell * cell if size is None else size[1]
    tallest = round(source[0] * width / source[1]) // cell * cell
    if not width or not tallest:
        raise ValueError(
            f"label_stride={stride} is larger than the image of {source[0]}x{source[1]}; use a smaller one"
        )
    if size is not None and size[0] > tallest:
        raise ValueError(
            f"image_size={list(size)} is taller than the image of {source[0]}x{source[1]} at that width; use at most"
            f" {[tallest, width]}"
        )
    return ImageFit(source, tallest if size is None else size[0], width)


def view_camera(
    path: Path | None,
    fit: ImageFit,
    cam_K: NDArray,
    ego_T_cam: NDArray,
    *,
    lidar_points: NDArray[np.float32],
    label_of: NDArray[np.int64],
    label_stride: int | None,
) -> CameraView:
    """Reads a camera's files. ``path`` None: the camera is dead, its picture is black and its labels are empty.

    ``lidar_points`` (P, 3+) lie in the frame that ``ego_T_cam`` leads to, ``label_of`` maps pixel values to labels.
    """
    size = {"height": fit.height, "width": fit.width}
    cam_K = fit.cam_K(cam_K)
    image = np.zeros((fit.height, fit.width, 3), np.uint8) if path is None else fit.image(read_image(path, fit.source))
    if label_stride is None:
        return CameraView(image, cam_K, ego_T_cam, path is not None, np.zeros((0, 0), np.float32), None, None)
    cells = (fit.height // label_stride, fit.width // label_stride)
    if path is None:
        zero = np.zeros(cells, np.float32)
        return CameraView(image, cam_K, ego_T_cam, False, zero, zero, np.full(cells, -1))
    sparse = lidar_depth(lidar_points, invert(ego_T_cam), cam_K, **size, stride=label_stride)
    depth, classes = (read_labels(path, suffix, fit.source) for suffix in (DEPTH_SUFFIX, CLASS_SUFFIX))
    if depth is None:
        return CameraView(image, cam_K, ego_T_cam, True, sparse, None, None)
    depth = fit.image(depth, cv2.INTER_NEAREST)
    dense = dense_depth(depth, label_stride)
    if classes is None:
        return CameraView(image, cam_K, ego_T_cam, True, sparse, dense, None)
    labels = class_map(fit.image(classes, cv2.INTER_NEAREST), depth, label_of, label_stride)
    return CameraView(image, cam_K, ego_T_cam, True, sparse, dense, labels)
