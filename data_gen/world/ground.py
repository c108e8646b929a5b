"""The ground as a raster of materials over x and y: asphalt, paint, pavement, grass. One picture serves the camera's albedo,
the LiDAR's reflectivity and the drivable mask of the nuScenes map."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.assets.shapes.mesh import TEXTURES

# name: linear RGB albedo, texture, reflectivity at 905 nm, whether cars drive there
GROUND = {
    "grass": ((0.10, 0.16, 0.05), "grass", 0.45, False),
    "asphalt": ((0.12, 0.12, 0.125), "asphalt", 0.14, True),
    "shoulder": ((0.16, 0.155, 0.15), "asphalt", 0.18, False),
    "pavement": ((0.30, 0.29, 0.27), "slabs", 0.30, False),
    "kerb": ((0.42, 0.41, 0.39), "concrete", 0.38, False),
    "white_paint": ((0.72, 0.72, 0.70), "paint", 0.65, True),
    "yellow_paint": ((0.62, 0.45, 0.06), "paint", 0.55, True),
    "gravel": ((0.26, 0.22, 0.17), "gravel", 0.28, False),
    "dry_grass": ((0.15, 0.17, 0.06), "grass", 0.42, False),
    "worn_paint": ((0.40, 0.40, 0.39), "paint", 0.36, True),
    "patch": ((0.075, 0.075, 0.08), "asphalt", 0.10, True),
    "tar": ((0.04, 0.04, 0.042), "plain", 0.06, True),
}
GROUND_NAMES = tuple(GROUND)
MARKS = ("white_paint", "yellow_paint", "worn_paint", "tar")
"""What lies on the road in thin lines."""
IS_MARK = np.array([name in MARKS for name in GROUND_NAMES])
EVEN = 128
"""The value of :attr:`GroundMap.tone` that leaves the colour as it is."""
TONE_STRIDE = 2
"""Pixels of the material raster a pixel of the tone raster."""
_DRIVABLE = np.array([entry[3] for entry in GROUND.values()])


@dataclass(frozen=True)
class GroundMap:
    """Material of the ground: ``material`` (rows, columns) indexes ``GROUND_NAMES``; row 0 is at the lowest y, column 0 at
    the lowest x; ``origin`` is the global (x, y) of the lower left corner; ``resolution`` metres a pixel.

    ``cover`` (rows, columns) is the share of each cell that :data:`MARKS` cover, 0 .. 255, from which the camera finds their
    edges within a cell; ``tone`` (rows / 2, columns / 2) what age, oil and tyres do to the albedo, a factor times 128.
    Without them marks fill their cells and nothing is worn.
    """

    material: NDArray[np.uint8]
    origin: tuple[float, float]
    resolution: float
    cover: NDArray[np.uint8] = None  # type: ignore[assignment]  # filled in below
    tone: NDArray[np.uint8] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.cover is None:
            full = np.resize(255 * IS_MARK, 256).astype(np.uint8)
            object.__setattr__(self, "cover", cv2.LUT(self.material, full))
        if self.tone is None:
            shape = [-(-size // TONE_STRIDE) for size in self.material.shape]
            object.__setattr__(self, "tone", np.full(shape, EVEN, np.uint8))

    def at(self, xy: NDArray) -> NDArray[np.uint8]:
        """Material index of global points (N, 2); outside the map it is grass."""
        cell = np.floor((np.asarray(xy)[:, :2] - self.origin) / self.resolution).astype(np.int64)
        rows, columns = self.material.shape
        inside = (cell[:, 0] >= 0) & (cell[:, 0] < columns) & (cell[:, 1] >= 0) & (cell[:, 1] < rows)
        found = np.full(len(cell), GROUND_NAMES.index("grass"), np.uint8)
        found[inside] = self.material[cell[inside, 1], cell[inside, 0]]
        return found

    @property
    def drivable(self) -> NDArray[np.bool_]:
        """(rows, columns): where cars drive."""
        return cv2.LUT(self.material, np.resize(_DRIVABLE, 256).view(np.uint8)).view(bool)


def ground_table() -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]]:
    """Albedo (G, 3), texture index (G,) and LiDAR reflectivity (G,) of the ground's materials."""
    return (
        np.array([entry[0] for entry in GROUND.values()], np.float32),
        np.array([TEXTURES.index(entry[1]) for entry in GROUND.values()], np.uint8),
        np.array([entry[2] for entry in GROUND.values()], np.float32),
    )
