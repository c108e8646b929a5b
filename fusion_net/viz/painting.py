"""Draws what early fusion paints LiDAR points with, and what an error of calibration makes of it:
``python -m fusion_net.viz.painting data=nano sample=3 error_deg=1.0 out=painting.png``.

The scores are exact, the class images that the generator wrote, so whatever is painted wrongly is the projection's fault:
cells that reach beyond an object's edge, calibration, or the time between picture and point. Settings are in
``configs/painting.yaml``.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from omegaconf import DictConfig

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes, points_in_box
from fusion_net.common.cli.command import command
from fusion_net.common.drawing import CLASS_COLORS, BEVPanel, Image, boxes_on_image, dots, picture_file
from fusion_net.common.geometry import invert, project, transform
from fusion_net.common.nuscenes_format import CLASSES, REFERENCE
from fusion_net.data.samples import Sample, SampleReader
from fusion_net.models.encoders.painting import exact_scores, paint_points
from fusion_net.nuscenes.datasets import open_datasets, sample_of_split
from fusion_net.viz.calibration import turned

WIDTH, BOX = 960, (255, 255, 255)
BACKGROUND, UNSEEN = len(CLASSES), len(CLASSES) + 1
"""What a point may be painted with beside the classes."""
COLORS = np.array([*CLASS_COLORS, (95, 95, 105), (45, 45, 60)], np.uint8)
"""Of the classes, the background, and points that no camera sees."""
STEEPEST = 45.0
"""Degrees of error_deg, at most."""


def painted_labels(sample: Sample, points: ArrayLike, stride: int) -> NDArray[np.int64]:
    """What each ego point (P, 3) is painted with: the index of a class, BACKGROUND or UNSEEN."""
    if sample.class_map is None:
        raise ValueError("there are no class images beside the cameras' pictures, as in real data; use generated data")
    painted = paint_points(
        torch.tensor(np.asarray(points)[:, :3]),
        exact_scores(torch.tensor(sample.class_map)[None], len(CLASSES)),
        torch.tensor(sample.cam_K)[None],
        torch.tensor(np.linalg.inv(sample.ego_T_cam))[None],
        stride=stride,
    )
    return painted[:, 3:].argmax(dim=1).numpy()  # where two cameras disagree, the earlier class of the list


def labels_of_boxes(points: NDArray, boxes: Boxes) -> NDArray[np.int64]:
    """The class of the labelled box that each ego point (P, 3) lies in, -1 for none."""
    label = np.full(len(points), -1)
    for k in range(len(boxes)):
        label[points_in_box(points, boxes.center[k], boxes.wlh[k], float(boxes.yaw[k]))] = boxes.label[k]
    return label


def draw_painting(
    sample: Sample, *, stride: int, lidar_place: NDArray, grid: BEVGrid, errors: Sequence[float]
) -> Image:
    """One sheet: each camera with what its cells show; then for each error in degrees of the LiDAR's heading the painted points
    on every camera; below, side by side, from above."""
    legend = _legend(sorted({*sample.boxes.label.tolist(), BACKGROUND, UNSEEN}))
    rows = [legend, *(_segmented(sample, n, stride) for n in range(len(sample.images)))]
    truth = labels_of_boxes(sample.lidar_points[:, :3], sample.boxes)
    grounds = []
    for error in errors:
        points = turned(sample.lidar_points[:, :3], lidar_place, error)
        label = painted_labels(sample, points, stride)
        inside = (truth >= 0) & (label != UNSEEN)
        right = 100 * (label == truth)[inside].sum() / max(inside.sum(), 1)
        ghosts = int(((truth < 0) & (label < BACKGROUND)).sum())
        note = (
            f"{error:g} degrees off: {right:.0f} % of the {inside.sum()} points in boxes have their class, {ghosts} other"
            " points have one"
        )
        rows += [_captioned(_dotted(sample, n, points, label), note) for n in range(len(sample.images))]
        panel = BEVPanel(grid, scale=WIDTH / len(errors) / (grid.y_max - grid.y_min))
        ground = panel.canvas()
        order = np.argsort(-label)  # what has a class lies on top
        panel.points(ground, points[order, :2], COLORS[label[order]], radius=2)
        panel.boxes(ground, sample.boxes, BOX)
        grounds.append(_captioned(ground, f"{error:g} degrees off, with labels"))
    return np.concatenate([*rows, np.concatenate(grounds, axis=1)[:, :WIDTH]])


def _segmented(sample: Sample, camera: int, stride: int) -> Image:
    """A camera's picture, its cells tinted by the class that they show, and boxes."""
    assert sample.class_map is not None
    image = _dimmed(sample, camera, share=0.8)
    label = cv2.resize(sample.class_map[camera].astype(np.int16), image.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    tinted = label >= 0
    image[tinted] = (0.45 * image[tinted] + 0.55 * COLORS[label[tinted]]).astype(np.uint8)
    scale = WIDTH / sample.images.shape[2]
    mount = {"cam_K": sample.cam_K[camera], "ego_T_cam": sample.ego_T_cam[camera]}
    boxes_on_image(image, sample.boxes, color=BOX, scale=scale, **mount)
    return _captioned(image, f"what cells of {stride} pixels show")


def _dotted(sample: Sample, camera: int, points: NDArray, label: NDArray[np.int64]) -> Image:
    """A camera's picture with ego points (P, 3) in the colours of what they are painted with."""
    image = _dimmed(sample, camera)
    pixels, depth = project(sample.cam_K[camera], transform(invert(sample.ego_T_cam[camera]), points))
    order = np.argsort(-depth)
    order = order[depth[order] > 0]
    dots(image, pixels[order] * (WIDTH / sample.images.shape[2]), COLORS[label[order]], radius=2)
    return image


def _dimmed(sample: Sample, camera: int, share: float = 0.5) -> Image:
    height, width = sample.images.shape[1:3]
    size = (WIDTH, round(height * WIDTH / width))
    return np.array(cv2.resize(sample.images[camera], size, interpolation=cv2.INTER_CUBIC) * share, np.uint8)


def _captioned(image: Image, text: str) -> Image:
    strip = np.zeros((24, image.shape[1], 3), np.uint8)
    cv2.putText(strip, text, (8, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (235, 235, 235), 1, cv2.LINE_AA)
    return np.concatenate([strip, image])


def _legend(labels: Sequence[int]) -> Image:
    strip, x = np.zeros((26, WIDTH, 3), np.uint8), 8
    for label in labels:
        text = {BACKGROUND: "background", UNSEEN: "seen by no camera"}.get(label) or CLASSES[label]
        cv2.rectangle(strip, (x, 8), (x + 10, 18), COLORS[label].tolist(), -1)
        cv2.putText(strip, text, (x + 15, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (235, 235, 235), 1, cv2.LINE_AA)
        x += 36 + cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.42, 1)[0][0]
    return strip


def write_painting(
    root: str | Sequence[str],
    *,
    version: str | None = None,
    split: str = "all",
    sample: int = 0,
    error_deg: float = 1.0,
    stride: int = 8,
    out: str = "painting.png",
) -> Path:
    """Draws the keyframe ``sample`` of a split and writes the picture; returns its path."""
    if not abs(error_deg) <= STEEPEST:
        raise ValueError(f"error_deg={error_deg} is not within {STEEPEST:g} degrees; try error_deg=1.0")
    if stride < 1:
        raise ValueError(f"stride={stride} is not a number of pixels: 1 or more; try stride=8")
    nusc, token = sample_of_split(open_datasets(root, version), split, sample)
    path = picture_file(out, formats=(".png", ".jpg"))
    read = SampleReader(label_stride=stride).read(nusc, token)
    all_round = not len(read.lidar_points) or (read.lidar_points[:, 0] < -5).mean() > 0.1
    grid = BEVGrid(-40.0, 40.0, -40.0, 40.0, 1.0) if all_round else BEVGrid(0.0, 45.0, -30.0, 30.0, 1.0)
    place = nusc.ego_T_sensor(nusc.keyframes[token][REFERENCE])[:3, 3]
    errors = list(dict.fromkeys((0.0, error_deg)))
    sheet = draw_painting(read, stride=stride, lidar_place=place, grid=grid, errors=errors)
    if not cv2.imwrite(str(path), sheet[..., ::-1]):
        raise OSError(f"out={path} could not be written")
    print(f"{path}: sample {sample} of {split}, scene {nusc.scene(token)['name']}")
    return path


@command(config_name="painting")
def main(cfg: DictConfig) -> None:
    """Draws the keyframe that ``cfg`` names."""
    options = {name: cfg[name] for name in ("split", "sample", "error_deg", "stride", "out")}
    write_painting(cfg.data.root, version=cfg.data.version, **options)


if __name__ == "__main__":
    main()
