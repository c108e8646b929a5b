"""The one place that maps metres to bird's-eye-view cells.

BEV tensors are (B, C, Y, X): row = floor((y - y_min) / cell), column = floor((x - x_min) / cell). ``floor`` first and the
bounds test second: truncation would fold everything in (-1, 0) into cell 0.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from beartype import beartype
from torch import Tensor


@beartype
@dataclass(frozen=True)
class BEVGrid:
    """A rectangle of ground in the ego frame cut into square cells. Bounds and cell in metres."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float
    cell: float

    def __post_init__(self) -> None:
        if not (0 < self.cell < math.inf and all(map(math.isfinite, (self.x_min, self.x_max, self.y_min, self.y_max)))):
            raise ValueError(f"grid: cell={self.cell} must be above 0, and all bounds finite")
        for axis, low, high in (("x", self.x_min, self.x_max), ("y", self.y_min, self.y_max)):
            cells = (high - low) / self.cell
            if cells < 1 or not math.isclose(cells, round(cells), abs_tol=1e-6):
                raise ValueError(
                    f"grid: {axis} from {low} to {high} m is not a whole number of cells of {self.cell} m;"
                    f" nearest {axis}_max is {low + max(1, round(cells)) * self.cell:g}"
                )

    @property
    def shape(self) -> tuple[int, int]:
        """(Y, X): rows and columns."""
        return round((self.y_max - self.y_min) / self.cell), round((self.x_max - self.x_min) / self.cell)

    def at(self, cell: float) -> "BEVGrid":
        """The same ground at another cell size (finer for pillars, coarser for a deeper map)."""
        return BEVGrid(self.x_min, self.x_max, self.y_min, self.y_max, cell)

    def rows_columns(self, xy: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Row, column (int64, clamped into the grid) and an inside mask for ego points ``xy`` (..., 2)."""
        rows, columns = self.shape
        column = torch.floor((xy[..., 0] - self.x_min) / self.cell)
        row = torch.floor((xy[..., 1] - self.y_min) / self.cell)
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return row.nan_to_num().clamp(0, rows - 1).long(), column.nan_to_num().clamp(0, columns - 1).long(), inside

    def centers(self) -> Tensor:
        """Metres (Y, X, 2) of the cell centres as (x, y)."""
        rows, columns = self.shape
        y = self.y_min + (torch.arange(rows) + 0.5) * self.cell
        x = self.x_min + (torch.arange(columns) + 0.5) * self.cell
        return torch.stack([x.expand(rows, columns), y[:, None].expand(rows, columns)], dim=-1)

    def contains(self, xy: np.ndarray) -> np.ndarray:
        """Which of the ego points (N, 2) lie on the grid (numpy in, numpy out)."""
        x, y = xy[..., 0], xy[..., 1]
        return (x >= self.x_min) & (x < self.x_max) & (y >= self.y_min) & (y < self.y_max)
