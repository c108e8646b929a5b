"""One pixel's depth: the distribution that the network predicts along the pixel's ray, and the cells of the bird's-eye view
that the pixel's feature lands in (Lift-Splat, Philion and Fidler 2020)."""

import numpy as np
import torch

from fusion_lab.engine.answers import Answer
from fusion_lab.views.content import MISSING, Content, svg, text
from fusion_lab.views.pictures import SCALE, camera_picture
from fusion_net.common.bev_grid import Axis
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.encoders.view_transforms import ego_points

CHART = (420, 190)
MAP = 300
"""Pixels that the map is high."""


def content(answer: Answer) -> Content:
    """The image with the pixel, the distribution as bars, the ground with the cells."""
    image, sample = answer.seen.image, answer.sample
    if image is None or answer.bins is None:
        return Content(MISSING)
    height, width = image.depth_logits.shape[-2:]
    row = min(int(answer.state.v * height), height - 1)
    column = min(int(answer.state.u * width), width - 1)
    probability = sharpened(image.depth_logits[0, 0, :, row, column].float(), answer.state.confidence)
    truth = 0.0 if sample.dense_depth is None else float(sample.dense_depth[0, row, column])
    centers = answer.bins.centers()
    where = _landing(answer, centers, row, column, (height, width))
    stride = sample.images.shape[1] / height
    box = [SCALE * stride * column, SCALE * stride * row, SCALE * stride]
    overlay = (
        '<rect x="{0:.0f}" y="{1:.0f}" width="{2:.0f}" height="{2:.0f}" fill="none" stroke="#fff" stroke-width="4"/>'
    )
    cells = len({cell for cell, inside in where if inside})
    largest, mean = float(centers[probability.argmax()]), float((probability * centers).sum())
    said = (
        f"most likely {largest:.1f} m, mean {mean:.1f} m, entropy {_entropy(probability):.1f} of"
        f" {np.log2(len(probability)):.1f} bits; exact depth {f'{truth:.1f} m' if truth else 'unknown (sky or no surface)'}"
    )
    panel = (
        f"<p>Click on the image to choose a pixel. It says: {said}. Its feature is spread over {cells} cells of the grid"
        " along its ray, to each with its probability.</p>"
        f'<div class="beside">{_bars(probability, answer.bins, truth)}'
        f"{_ground(answer, probability, where, truth, centers)}</div>"
    )
    picture = camera_picture(answer)[:, : SCALE * sample.images.shape[2]]
    return Content(panel, picture, overlay.format(*box), f"Camera image; the chosen pixel: {said}")


def sharpened(logits: torch.Tensor, power: float) -> torch.Tensor:
    """The distribution (D,) of ``logits`` raised to a power and normalised: 0 is flat, 1 what the network says, more is
    surer."""
    return (power * logits.log_softmax(dim=0)).softmax(dim=0)


def _entropy(probability: torch.Tensor) -> float:
    return float(-(probability * probability.clamp(min=1e-12).log2()).sum())


def _landing(
    answer: Answer, centers: torch.Tensor, row: int, column: int, size: tuple[int, int]
) -> list[tuple[tuple[int, int], bool]]:
    """The cell (row, column) of the grid that each bin's centre lands in, and whether it is on the grid."""
    sample, grid = answer.sample, answer.grid
    depth = centers.expand(1, 1, *size, len(centers))
    cam_K, ego_T_cam = (torch.from_numpy(each[None, :1]).float() for each in (sample.cam_K, sample.ego_T_cam))
    points = ego_points(depth, cam_K, ego_T_cam, sample.images.shape[1] // size[0])[0, 0, row, column]
    rows, columns, inside = (each.tolist() for each in grid.rows_columns(points[:, :2]))
    return list(zip(zip(rows, columns, strict=True), inside, strict=True))


def _bars(probability: torch.Tensor, bins: DepthBins, truth: float) -> str:
    """Probability by bin, from 0, with the exact depth as a line."""
    (width, height), top = CHART, float(probability.max())
    left, bottom, step = 34, 30, (CHART[0] - 44) / len(probability)
    parts = []
    for k, value in enumerate(probability.tolist()):
        tall = (height - bottom - 16) * value / top
        parts.append(f'<rect x="{left + k * step:.1f}" y="{height - bottom - tall:.1f}" width="{step * 0.85:.1f}"'
                     f' height="{tall:.1f}" class="bar"/>')  # fmt: skip
    for metres in (2, 5, 10, 20, 50):
        at = float(bins.coordinate(torch.tensor(float(metres))))
        if 0 <= at <= bins.count:
            parts.append(text(left + at * step, height - 12, f"{metres} m", 'text-anchor="middle"'))
    if truth and 0 <= (at := float(bins.coordinate(torch.tensor(truth)))) <= bins.count:
        x = left + at * step
        parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="10" y2="{height - bottom}" class="truth"/>')
        parts.append(text(x + 4, 18, f"exact {truth:.1f} m", 'class="truth"'))
    parts.append(text(2, 20, f"{top:.2f}") + text(2, height - bottom, "0"))
    return svg(width, height, "".join(parts), f"Depth distribution of the pixel, highest {top:.2f}")


def _ground(answer: Answer, probability, where, truth: float, centers: torch.Tensor) -> str:
    """The grid from above, ahead up, with the cells that the pixel lands in."""
    grid = answer.grid
    scale = MAP / (grid.x_max - grid.x_min)
    width = (grid.y_max - grid.y_min) * scale
    parts = [f'<rect width="{width:.0f}" height="{MAP}" class="ground"/>']
    top = float(probability.max())
    nearest = int((centers - truth).abs().argmin()) if truth else -1
    for k, (((row, column), inside), value) in enumerate(zip(where, probability.tolist(), strict=True)):
        if inside:
            x, wide = _side(grid.y_axis, row, grid.y_max, scale)
            y, tall = _side(grid.x_axis, column, grid.x_max, scale)
            mark = ' stroke="#63e06a" stroke-width="2"' if k == nearest else ""
            parts.append(f'<rect x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" height="{tall:.1f}" fill="#ff9a2e"'
                         f' fill-opacity="{max(value / top, 0.06):.2f}"{mark}/>')  # fmt: skip
    parts.append(text(6, 16, "its cells; green: the exact one", 'class="onmap"'))
    return svg(width, MAP, "".join(parts), "The grid from above with the cells along the pixel's ray")


def _side(axis: Axis, index: int, high: float, scale: float) -> tuple[float, float]:
    """Where a cell begins on the map along one axis, which is drawn from ``high`` down, and how long it is, in pixels."""
    low_edge, high_edge = axis.to_metres(torch.tensor([index, index + 1.0])).tolist()
    return (high - high_edge) * scale, (high_edge - low_edge) * scale
