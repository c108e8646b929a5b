"""One frame of the animation: the camera, what is known of each sensor and how much was found so far, the ground from above."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.drawing import Image
from fusion_net.common.modalities import STYLES
from fusion_net.data.samples import Sample
from fusion_net.viz.picture_sheet import CAPTION, FOUND, LABEL, WIDTH, camera_rows, draw_ground, legend

MATCH = 2.0
"""Metres between centres within which a detection is a label's: the largest distance but one of nuScenes' metric."""
ALIVE, DEAD, TO_COME, TRACK = (70, 150, 90), (220, 60, 60), (62, 62, 66), (36, 36, 38)
MISSED = (32, 73, 32)
NAMES_END, ROW, BARS = 110, 26, 84
"""Pixels: where the strip's names end, the height of a sensor's row, the height of the bars."""


@dataclass(frozen=True)
class Moment:
    """A keyframe, the sensors that were alive, and what the detector found with them."""

    sample: Sample
    sensors: tuple[str, ...]
    found: Boxes  # ego frame
    time: float  # s since the first one


def found_labels(labels: Boxes, found: Boxes) -> NDArray[np.bool_]:
    """Of each label (L,) whether a detection of its class has its centre within ``MATCH``, each detection counted once."""
    distance = np.linalg.norm(labels.center[:, None, :2] - found.center[None, :, :2], axis=-1)
    near = (distance < MATCH) & (labels.label[:, None] == found.label)
    rows, columns = linear_sum_assignment(near, maximize=True)
    hit = np.zeros(len(labels), bool)
    hit[rows] = near[rows, columns]
    return hit


def draw_frame(
    moments: Sequence[Moment],
    now: int,
    *,
    grid: BEVGrid,
    dying: str,
    sensors: Sequence[str],
    min_score: float,
) -> Image:
    """The frame of ``moments[now]``. ``sensors``: those of the detector; ``dying``: the one that is not always there."""
    moment = moments[now]
    cameras = camera_rows(moment.sample, moment.sample.boxes, LABEL, None)
    if "camera" in moment.sensors:
        bare = camera_rows(moment.sample, Boxes.empty(), FOUND, None)
        boxed = camera_rows(moment.sample, moment.found, FOUND, None)
        cameras = np.where((boxed != bare).any(axis=-1, keepdims=True), boxed, cameras)
    else:
        cameras = np.zeros_like(cameras)
        _write(cameras, "no image", (cameras.shape[1] // 2 - 40, len(cameras) // 2), DEAD, 0.6)
    left = np.concatenate([cameras, _strip(moments, now, dying, sensors)])
    ground = draw_ground(moment.sample, moment.found, grid, height=len(left), sensors=moment.sensors)
    both = np.concatenate([left, np.zeros((len(left), 4, 3), np.uint8), ground], axis=1)
    return np.concatenate([legend(min_score, both.shape[1]), both])


def _strip(moments: Sequence[Moment], now: int, dying: str, sensors: Sequence[str]) -> Image:
    """A row for each sensor with a cell for each keyframe, and below how many labels were found."""
    headline, rows = 34, ROW * len(sensors)
    image = np.full((headline + rows + BARS + 26, WIDTH, 3), 18, np.uint8)
    is_alive = dying in moments[now].sensors
    name = STYLES[dying].label
    text = f"{moments[now].time:.1f} s   " + ("all sensors alive" if is_alive else f"the {name} is dead")
    _write(image, text, (12, 23), CAPTION if is_alive else DEAD, 0.55)
    cell = (WIDTH - NAMES_END - 12) / len(moments)
    top, floor = headline + rows + 10, headline + rows + BARS
    for row, sensor in enumerate(sensors):
        is_on = sensor in moments[now].sensors
        _write(image, STYLES[sensor].label, (12, headline + row * ROW + 17), CAPTION if is_on else DEAD)
    _write(image, "found", (12, top + 22), FOUND)
    _write(image, "of labels", (12, top + 40), LABEL)
    most = max(1, *(len(moment.sample.boxes) for moment in moments))
    for number, moment in enumerate(moments):
        left, right = (round(NAMES_END + cell * edge) for edge in (number, number + 1))
        for row, sensor in enumerate(sensors):
            color = (ALIVE if sensor in moment.sensors else DEAD) if number <= now else TO_COME
            _fill(image, left, headline + row * ROW + 3, right - 2, headline + (row + 1) * ROW - 3, color)
        if number <= now:
            labels, hits = len(moment.sample.boxes), int(found_labels(moment.sample.boxes, moment.found).sum())
            _fill(image, left, floor - round((floor - top) * labels / most), right - 2, floor, MISSED)
            _fill(image, left, floor - round((floor - top) * hits / most), right - 2, floor, FOUND)
            if number == now:
                text = f"{hits} of {labels}, {len(moment.found) - hits} false"
                _write(image, text, (min(left, WIDTH - 124), floor + 18), CAPTION)
        else:
            _fill(image, left, floor - 2, right - 2, floor, TRACK)
    return image


def _fill(image: Image, left: int, top: int, right: int, bottom: int, color: Sequence[int]) -> None:
    image[top:bottom, left:right] = color


def _write(image: Image, text: str, where: tuple[int, int], color: Sequence[int], size: float = 0.45) -> None:
    cv2.putText(image, text, where, cv2.FONT_HERSHEY_SIMPLEX, size, tuple(color), 1, cv2.LINE_AA)
