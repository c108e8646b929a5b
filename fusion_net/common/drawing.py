"""Drawing on pictures with cv2: a bird's-eye panel with the car's way up, points and boxes on camera images.

Colours are RGB, images (H, W, 3) uint8; everything draws into the image it is given.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes, box_corners
from fusion_net.common.geometry import project, transform

Image = NDArray[np.uint8]
Color = tuple[int, int, int]

EDGES = np.array([(0, 1), (1, 3), (3, 2), (2, 0), (4, 5), (5, 7), (7, 6), (6, 4), (0, 4), (1, 5), (2, 6), (3, 7)])
"""Pairs of ``box_corners``; the first four are the front face."""
CLASS_COLORS: tuple[Color, ...] = (
    (255, 196, 0), (255, 110, 40), (230, 60, 120), (190, 90, 255), (255, 150, 150),
    (60, 220, 120), (0, 200, 230), (90, 140, 255), (255, 80, 0), (170, 230, 60),
)  # fmt: skip
"""Of the detection classes, in their order."""
NEAR = 0.3
"""Metres before the camera at which edges are cut."""
_SHIFT = 4  # cv2 draws at 1/16 pixel


def label(name: str) -> str:
    """A name of the settings as text for a picture or a page."""
    return {"dusk_glare_spray": "dusk, glare, spray"}.get(name, name.replace("_", " "))


def picture_file(out: str, formats: Sequence[str] = (".png", ".jpg", ".pdf", ".svg")) -> Path:
    """The path of a picture to be written, its folder made. ValueError when its suffix is none of ``formats``."""
    path = Path(out)
    if path.suffix not in formats:
        raise ValueError(f"out={out} is no picture; end it with {' or '.join(formats[:2])}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OSError(f"out={out}: its folder cannot be made ({error.strerror}); give another") from error
    return path


def depth_colors(depth: ArrayLike, far: float = 60.0) -> NDArray[np.uint8]:
    """Colours (N, 3) from red (near) to blue (``far`` metres), by the logarithm."""
    fraction = np.log(np.maximum(np.asarray(depth, float), 1.0)) / np.log(far)
    levels = np.clip(30 + 205 * (1 - fraction), 30, 235).astype(np.uint8).reshape(-1, 1)  # without the map's dark ends
    return cv2.applyColorMap(levels, cv2.COLORMAP_TURBO).reshape(-1, 3)[:, ::-1]


@dataclass(frozen=True)
class BEVPanel:
    """A picture of a grid's ground: x (ahead) is up, y (left) is left, ``scale`` pixels per metre."""

    grid: BEVGrid
    scale: float = 8.0

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of pixels."""
        grid = self.grid
        return round((grid.x_max - grid.x_min) * self.scale), round((grid.y_max - grid.y_min) * self.scale)

    def canvas(self, ring: float = 10.0) -> Image:
        """A dark panel with circles every ``ring`` metres around the car and the car's own arrow."""
        grid = self.grid
        image = np.full((*self.size, 3), 24, np.uint8)
        reach = np.hypot(max(-grid.x_min, grid.x_max), max(-grid.y_min, grid.y_max))
        origin = _fixed(self.pixels(np.zeros((1, 2))))[0].tolist()
        for radius in np.arange(ring, reach, ring):
            cv2.circle(image, origin, _fixed(radius * self.scale).item(), (56, 56, 56), 1, cv2.LINE_AA, _SHIFT)
        self.arrows(image, np.zeros((1, 2)), np.array([[3.0, 0.0]]), (255, 255, 255))
        return image

    def pixels(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Pixels (N, 2) as (u, v) of ego points (N, 2)."""
        x, y = np.asarray(xy, float)[:, :2].T
        return np.stack([self.grid.y_max - y, self.grid.x_max - x], axis=1) * self.scale

    def of_map(self, values: NDArray) -> NDArray:
        """A map (Y, X, ...) of the grid as a picture (H, W, ...) of its ground: of each pixel the value of its cell."""
        height, width = self.size
        x = self.grid.x_max - (torch.arange(height) + 0.5) / self.scale
        y = self.grid.y_max - (torch.arange(width) + 0.5) / self.scale
        row, column, _ = self.grid.rows_columns(torch.stack(torch.meshgrid(x, y, indexing="ij"), dim=-1))
        return values[row.numpy(), column.numpy()]

    def points(self, image: Image, xy: ArrayLike, color: ArrayLike, radius: int = 1) -> None:
        """Squares of 2 ``radius`` - 1 pixels in one colour (3,) or a colour each (N, 3)."""
        dots(image, self.pixels(xy), color, radius)

    def arrows(self, image: Image, xy: ArrayLike, vectors: ArrayLike, color: Color) -> None:
        """Arrows from ego points (N, 2) along vectors (N, 2) in metres."""
        tails, tips = self.pixels(xy), self.pixels(np.asarray(xy) + np.asarray(vectors))
        for tail, tip in zip(_fixed(tails).tolist(), _fixed(tips).tolist(), strict=True):
            length = np.hypot(tip[0] - tail[0], tip[1] - tail[1]) / 2**_SHIFT
            cv2.arrowedLine(image, tail, tip, color, 1, cv2.LINE_AA, _SHIFT, 5 / max(length, 10))

    def boxes(self, image: Image, boxes: Boxes, color: Color, thickness: int = 1) -> None:
        """Outlines, a line from the centre to the front, and an arrow of one second of velocity where it is known."""
        if not len(boxes):
            return
        corners = box_corners(boxes.center, boxes.wlh, boxes.yaw)[:, [1, 3, 7, 5], :2]
        outline = _fixed(self.pixels(corners.reshape(-1, 2))).reshape(-1, 4, 2)
        cv2.polylines(image, list(outline), True, color, thickness, cv2.LINE_AA, _SHIFT)
        centers, fronts = (_fixed(self.pixels(xy)).tolist() for xy in (boxes.center, corners[:, :2].mean(axis=1)))
        for center, front in zip(centers, fronts, strict=True):
            cv2.line(image, center, front, color, thickness, cv2.LINE_AA, _SHIFT)
        moving = np.linalg.norm(np.nan_to_num(boxes.velocity), axis=1) > 0.5
        self.arrows(image, boxes.center[moving, :2], boxes.velocity[moving], color)


def points_on_image(
    image: Image, points: ArrayLike, *, cam_K: NDArray, ego_T_cam: NDArray, scale: float = 1.0, radius: int = 1
) -> None:
    """Ego points (N, 3) on a camera's image that was enlarged by ``scale``, coloured by depth, near ones on top."""
    pixels, depth = project(cam_K, transform(np.linalg.inv(ego_T_cam), np.asarray(points)[:, :3]))
    order = np.argsort(-depth)
    order = order[depth[order] > NEAR]
    dots(image, pixels[order] * scale, depth_colors(depth[order]), radius)


def boxes_on_image(
    image: Image, boxes: Boxes, *, cam_K: NDArray, ego_T_cam: NDArray, color: Color, scale: float = 1.0
) -> None:
    """Ego boxes as wire frames on a camera's image that was enlarged by ``scale``; the front face has its diagonals."""
    edges, _ = box_edges(boxes, cam_K=cam_K, ego_T_cam=ego_T_cam, scale=scale)
    for a, b in _fixed(edges).tolist():
        cv2.line(image, a, b, color, 1, cv2.LINE_AA, _SHIFT)


def box_edges(
    boxes: Boxes, *, cam_K: NDArray, ego_T_cam: NDArray, scale: float = 1.0
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The wire frames of ego boxes on a camera's image that was enlarged by ``scale``: pixels (E, 2, 2), start and end of each
    edge, of those that are ahead, and the row (E,) of each edge's box; the front face has its diagonals."""
    if not len(boxes):
        return np.zeros((0, 2, 2)), np.zeros(0, np.int64)
    corners = box_corners(boxes.center, boxes.wlh, boxes.yaw)
    corners = transform(np.linalg.inv(ego_T_cam), corners.reshape(-1, 3)).reshape(-1, 8, 3)
    edges = np.concatenate([EDGES, [(0, 3), (1, 2)]])
    start, end = (corners[:, edges[:, side]].reshape(-1, 3) for side in (0, 1))
    ahead = np.maximum(start[:, 2], end[:, 2]) > NEAR
    start, end = start[ahead], end[ahead]
    start, end = _cut(start, end), _cut(end, start)
    pixels = np.stack([np.clip(project(cam_K, points)[0] * scale, -5e3, 5e3) for points in (start, end)], axis=1)
    return pixels, np.repeat(np.arange(len(boxes)), len(edges))[ahead]


def dots(image: Image, pixels: NDArray[np.float64], color: ArrayLike, radius: int = 1) -> None:
    """Squares of 2 ``radius`` - 1 pixels at (u, v); what lies outside is left out, later ones cover earlier ones."""
    height, width = image.shape[:2]
    colors = np.broadcast_to(np.asarray(color, np.uint8), (len(pixels), 3))
    near = np.isfinite(pixels).all(axis=1) & (np.abs(pixels) < 1e6).all(axis=1)
    reach = np.arange(1 - radius, radius)
    steps = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
    cell = np.floor(pixels[near]).astype(np.int64)[:, None] + steps
    inside = (cell >= 0).all(axis=-1) & (cell[..., 0] < width) & (cell[..., 1] < height)
    image[cell[inside][:, 1], cell[inside][:, 0]] = np.broadcast_to(colors[near][:, None], (*inside.shape, 3))[inside]


def _cut(point: NDArray, other: NDArray) -> NDArray:
    """Camera points (N, 3), those behind NEAR moved along their edge onto it."""
    behind = point[:, 2] < NEAR
    rise = np.where(behind, other[:, 2] - point[:, 2], 1.0)
    fraction = np.where(behind, (NEAR - point[:, 2]) / rise, 0.0)
    return point + fraction[:, None] * (other - point)


def _fixed(values: ArrayLike) -> NDArray[np.int64]:
    """Pixel coordinates as cv2 takes them with sub-pixel bits; cv2's pixel centres are at whole numbers."""
    return np.round((np.asarray(values) - 0.5) * 2**_SHIFT).astype(np.int64)
