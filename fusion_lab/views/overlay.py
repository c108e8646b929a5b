"""Boxes as SVG over a picture: labels dashed, detections drawn through, so that they differ by more than their colour."""

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from fusion_lab.engine.answers import Answer
from fusion_lab.views.pictures import RADAR_SECONDS, SCALE, panel_of
from fusion_net.common.boxes import Boxes, box_corners
from fusion_net.common.drawing import box_edges, label

Point = Sequence[float]
LABEL, FOUND = "#63e06a", "#ff9a2e"
STYLES = {"label": f'stroke="{LABEL}" stroke-dasharray="6 4"', "found": f'stroke="{FOUND}"'}


def on_camera(answer: Answer) -> str:
    """Wire frames on the images, which lie side by side."""
    sample, parts = answer.sample, []
    for place in range(len(sample.images)):
        shift = place * SCALE * sample.images.shape[2]
        view = {"cam_K": sample.cam_K[place], "ego_T_cam": sample.ego_T_cam[place], "scale": float(SCALE)}
        for kind, boxes in (("label", sample.boxes), ("found", answer.shown)):
            edges, owner = box_edges(boxes, **view)
            edges, owner = _of_visible(edges, owner, sample.images.shape[1:3])
            for row in np.unique(owner).tolist():
                lines = edges[owner == row].tolist()
                path = "".join(f"M{x + shift:.1f} {y:.1f}L{u + shift:.1f} {v:.1f}" for (x, y), (u, v) in lines)
                parts.append(_group(kind, boxes, row, answer.classes, f'<path d="{path}"/>'))
    return "".join(parts)


def on_ground(answer: Answer) -> str:
    """Outlines with a line to the front, and of the velocity as many seconds as of the radar's."""
    panel, parts = panel_of(answer.grid), []
    for kind, boxes in (("label", answer.sample.boxes), ("found", answer.shown)):
        corners = box_corners(boxes.center, boxes.wlh, boxes.yaw)[:, [1, 3, 7, 5], :2]
        velocity = np.nan_to_num(boxes.velocity)
        outlines = panel.pixels(corners.reshape(-1, 2)).reshape(-1, 4, 2).tolist()
        centers, fronts, soon = (
            panel.pixels(xy).tolist()
            for xy in (boxes.center, corners[:, :2].mean(axis=1), boxes.center[:, :2] + RADAR_SECONDS * velocity)
        )
        moves = np.linalg.norm(velocity, axis=1) > 0.5
        for row, outline in enumerate(outlines):
            shapes = _polygon(outline) + _line(centers[row], fronts[row])
            if moves[row]:
                shapes += _line(centers[row], soon[row], ' stroke-width="1"')
            parts.append(_group(kind, boxes, row, answer.classes, shapes))
    return "".join(parts)


def described(boxes: Boxes, row: int, classes: list[str]) -> str:
    """A box in words."""
    x, y = boxes.center[row, :2]
    side = "left" if y > 0 else "right"
    score = "" if boxes.score[row] == 1 else f", score {boxes.score[row]:.2f}"
    speed = np.linalg.norm(boxes.velocity[row])
    moves = f", {speed:.1f} m/s" if np.isfinite(speed) and speed > 0.5 else ""
    return f"{label(classes[boxes.label[row]])}, {x:.0f} m ahead, {abs(y):.0f} m to the {side}{moves}{score}"


def _group(kind: str, boxes: Boxes, row: int, classes: list[str], shapes: str) -> str:
    title = f"{'label' if kind == 'label' else 'detection'}: {described(boxes, row, classes)}"
    return (
        f'<g class="{kind}" fill="none" stroke-width="2" pointer-events="stroke" {STYLES[kind]}>'
        f"<title>{escape(title)}</title>{shapes}</g>"
    )


def _polygon(points: Sequence[Point]) -> str:
    return f'<polygon points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}"/>'


def _line(start: Point, end: Point, more: str = "") -> str:
    return f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}"{more}/>'


def _of_visible(edges: NDArray, owner: NDArray, size: tuple[int, ...]) -> tuple[NDArray, NDArray]:
    """Edges (E, 2, 2) and their boxes' rows (E,), of the boxes of which the end of any edge lies in the picture."""
    (x, y), (height, width) = np.moveaxis(edges, -1, 0), size
    inside = ((x >= 0) & (x < SCALE * width) & (y >= 0) & (y < SCALE * height)).any(axis=1)
    visible = np.isin(owner, owner[inside])
    return edges[visible], owner[visible]
