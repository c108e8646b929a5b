"""One picture of eight samples: what the camera saw, what LiDAR and radar measured, what is there and what was found."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.drawing import BEVPanel, Color, Image, boxes_on_image
from fusion_net.common.geometry import invert, project, transform
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.data.samples import Sample

LABEL, FOUND = (96, 220, 96), (255, 150, 40)
LIDAR, RADAR = (130, 130, 140), (90, 190, 255)
CAPTION = (235, 235, 235)
LEGEND = (
    ("labels", LABEL),
    ("predictions, score > {:g}", FOUND),
    ("LiDAR", LIDAR),
    ("radar and half a second of its velocity", RADAR),
)
WIDTH = 640
"""Pixels that the cameras of a sample are wide."""
ALONE = 480
"""Pixels that the ground is high where there is no camera beside it."""


def picture_sheet(
    path: Path, dataset: NuScenesDataset, found: Mapping[str, Boxes], *, samples: int = 8, min_score: float = 0.3
) -> None:
    """Writes the sheet. ``found``: predictions by token in the ego frame; the samples are spread evenly over the split."""
    places = spread_evenly(len(dataset), samples)
    tiles = []
    for place in places:
        sample = dataset[place]
        boxes = found.get(sample.token, Boxes.empty())
        tiles.append(draw_sample(sample, boxes[boxes.score > min_score], dataset))
    sheet = legend(min_score, 2 * tiles[0].shape[1] if tiles else WIDTH)
    if tiles:
        sheet = np.concatenate([sheet, montage(tiles, columns=2)])
    if not cv2.imwrite(str(path), sheet[..., ::-1]):
        raise OSError(f"could not write {path}")


def spread_evenly(length: int, count: int) -> list[int]:
    """Up to ``count`` places of a sequence, from its first to its last."""
    return np.unique(np.linspace(0, length - 1, count).round().astype(int)).tolist() if length else []


def draw_sample(sample: Sample, found: Boxes, dataset: NuScenesDataset) -> Image:
    """One tile: the cameras with labels, the same with predictions, and the ground from above with both. Without a camera
    only the ground."""
    cameras = draw_cameras(sample, found, dataset.classes)
    tile = np.concatenate([cameras, draw_ground(sample, found, dataset.grid, height=len(cameras))], axis=1)
    return np.pad(tile, ((3, 3), (3, 3), (0, 0)))


def draw_cameras(sample: Sample, found: Boxes, classes: list[str]) -> Image:
    """The cameras with labels above the same with predictions; nothing, ``ALONE`` pixels high, where there is no camera."""
    if not len(sample.images):
        return np.zeros((ALONE, 0, 3), np.uint8)
    both = ((sample.boxes, LABEL), (found, FOUND))
    return np.concatenate([camera_rows(sample, boxes, color, classes) for boxes, color in both])


def draw_ground(
    sample: Sample, found: Boxes, grid: BEVGrid, *, height: int, sensors: Sequence[str] = MODALITIES
) -> Image:
    """The ground from above with labels, predictions and what these sensors measured, ``height`` pixels high."""
    panel = BEVPanel(grid, scale=height / (grid.x_max - grid.x_min))
    ground = panel.canvas()
    if "lidar" in sensors:
        panel.points(ground, sample.lidar_points[:, :2], LIDAR)
    if "radar" in sensors:
        panel.points(ground, sample.radar_points[:, :2], RADAR, radius=2)
        panel.arrows(ground, sample.radar_points[:, :2], sample.radar_points[:, 4:6] / 2, RADAR)
    panel.boxes(ground, sample.boxes, LABEL)
    panel.boxes(ground, found, FOUND)
    return ground


def camera_rows(sample: Sample, boxes: Boxes, color: Color, classes: list[str] | None) -> Image:
    """All cameras side by side, ``WIDTH`` pixels, up to three in a row, with boxes and their class names (None: without)."""
    count, height, width = sample.images.shape[:3]
    columns = min(count, 3)
    scale = WIDTH / columns / width
    size = (WIDTH // columns, round(height * scale))
    images = []
    for camera in range(count):
        image = cv2.resize(sample.images[camera], size, interpolation=cv2.INTER_CUBIC)
        mount = {"cam_K": sample.cam_K[camera], "ego_T_cam": sample.ego_T_cam[camera]}
        boxes_on_image(image, boxes, color=color, scale=scale, **mount)
        if classes is not None:
            _names(image, boxes, color, classes, scale=scale, **mount)
        images.append(image)
    rows = montage(images, columns)
    return np.pad(rows, ((0, 0), (0, WIDTH - rows.shape[1]), (0, 0)))


def _names(image: Image, boxes: Boxes, color: Color, classes: list[str], *, cam_K, ego_T_cam, scale: float) -> None:
    """The class above each box that is ahead of the camera, with its score if it was predicted."""
    top = boxes.center + np.column_stack([np.zeros((len(boxes), 2)), boxes.wlh[:, 2] / 2])
    pixels, depth = project(cam_K, transform(invert(ego_T_cam), top))
    for (u, v), z, label, score in zip(pixels * scale, depth, boxes.label, boxes.score, strict=True):
        if z > 1 and 0 <= u < image.shape[1] and 0 <= v < image.shape[0]:
            text = classes[label] if score == 1 else f"{classes[label]} {score:.2f}"
            where = (int(u) - 3 * len(text), max(9, int(v) - 4))
            cv2.putText(image, text, where, cv2.FONT_HERSHEY_SIMPLEX, 0.35, color, 1, cv2.LINE_AA)


def montage(images: list[Image], columns: int) -> Image:
    """Images of one size in rows; black where the last row is not full."""
    blank = np.zeros_like(images[0])
    padded = images + [blank] * (-len(images) % columns)
    rows = [np.concatenate(padded[i : i + columns], axis=1) for i in range(0, len(padded), columns)]
    return np.concatenate(rows)


def legend(min_score: float, width: int) -> Image:
    """What the colours of a sheet mean, ``width`` pixels."""
    strip = np.zeros((26, width, 3), np.uint8)
    x = 12
    for text, color in LEGEND:
        text = text.format(min_score)
        cv2.rectangle(strip, (x, 8), (x + 10, 18), color, -1)
        cv2.putText(strip, text, (x + 16, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, CAPTION, 1, cv2.LINE_AA)
        x += 16 + cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)[0][0] + 28
    return strip
