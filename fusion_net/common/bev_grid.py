"""The one place that maps metres to bird's-eye-view cells.

BEV tensors are (B, C, Y, X). A grid is two axes, each a map from metres to cell coordinates and back: 0 at the lower bound,
k + 0.5 at the centre of cell k. Row = floor(y's coordinate), column = floor(x's): ``floor`` first and the bounds test second,
since truncation would fold everything in (-1, 0) into cell 0. In a grid of equal cells a coordinate is (x - x_min) / cell.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from beartype import beartype
from scipy.optimize import brentq
from torch import Tensor


@dataclass(frozen=True)
class Axis:
    """``count`` equal cells of ``cell`` metres from ``low`` on. Tensors of any shape."""

    low: float
    cell: float
    count: int

    def to_cells(self, metres: Tensor) -> Tensor:
        """Cell coordinates of places in metres, beyond the bounds too."""
        return torch.sub(metres, self.low).div_(self.cell)

    def to_metres(self, cells: Tensor) -> Tensor:
        """Metres of cell coordinates."""
        return self.low + cells * self.cell

    def size(self, index: Tensor) -> Tensor | float:
        """Metres from edge to edge of the cells ``index``."""
        return self.cell

    def between(self, start: Tensor, end: Tensor) -> Tensor:
        """Metres from the centres of cells ``start`` to those of cells ``end``."""
        return (end - start) * self.cell


@dataclass(frozen=True)
class GradedAxis(Axis):
    """``count`` cells from ``low`` on that grow with the distance from 0 m: from one to the next by ``growth`` metres, from
    ``cell`` metres at 0 m on.

    An arithmetic progression, as in the linear-increasing discretization (LID) of depth (Tang et al. 2020, arXiv 2005.13423)
    and in NUC-Net's rings around a LiDAR (Wang et al. 2025, arXiv 2505.24634): what is u cells from 0 m is at
    u (cell + growth abs(u) / 2) metres. The inverse takes a square root, which is rounded in the same way everywhere.
    """

    growth: float

    @staticmethod
    def fitted(low: float, high: float, cell: float, count: int) -> Axis:
        """The axis from ``low`` to ``high``. ``count`` cells of ``cell`` metres must not be longer than that; where they are as
        long, it is the uniform one."""

        def surplus(growth: float) -> float:
            return _cells_from_zero(high, cell, growth) - _cells_from_zero(low, cell, growth) - count

        if math.isclose(count * cell, high - low, abs_tol=1e-6):
            return Axis(low, cell, count)
        most = cell
        while surplus(most) > 0:
            most *= 2
        return GradedAxis(low, cell, count, brentq(surplus, 0.0, most, xtol=1e-300, rtol=1e-15))

    def to_cells(self, metres: Tensor) -> Tensor:
        """Cell coordinates of places in metres, beyond the bounds too."""
        root = metres.abs().mul_(2 * self.growth).add_(self.cell**2).sqrt_()
        return torch.mul(metres, 2).div_(root.add_(self.cell)).sub_(self._start)

    def to_metres(self, cells: Tensor) -> Tensor:
        """Metres of cell coordinates."""
        u = cells + self._start
        return u * (self.cell + self.growth / 2 * u.abs())

    def size(self, index: Tensor) -> Tensor:
        """Metres from edge to edge of the cells ``index``."""
        return self.to_metres(index + 1) - self.to_metres(index)

    def between(self, start: Tensor, end: Tensor) -> Tensor:
        """Metres from the centres of cells ``start`` to those of cells ``end``."""
        return self.to_metres(end + 0.5) - self.to_metres(start + 0.5)

    @cached_property
    def _start(self) -> float:
        return _cells_from_zero(self.low, self.cell, self.growth)


def _cells_from_zero(metres: float, cell: float, growth: float) -> float:
    return 2 * metres / (cell + math.sqrt(cell**2 + 2 * growth * abs(metres)))


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
        self._check_numbers()
        for axis, low, high in self._bounds:
            cells = (high - low) / self.cell
            if cells < 1 or not math.isclose(cells, round(cells), abs_tol=1e-6):
                raise ValueError(
                    f"grid: {axis} from {low} to {high} m is not a whole number of cells of {self.cell} m;"
                    f" nearest {axis}_max is {low + max(1, round(cells)) * self.cell:g}"
                )

    def _check_numbers(self) -> None:
        if not (0 < self.cell < math.inf and all(map(math.isfinite, (self.x_min, self.x_max, self.y_min, self.y_max)))):
            raise ValueError(f"grid: cell={self.cell} must be above 0, and all bounds finite")

    @property
    def _bounds(self) -> tuple[tuple[str, float, float], tuple[str, float, float]]:
        return ("x", self.x_min, self.x_max), ("y", self.y_min, self.y_max)

    @cached_property
    def x_axis(self) -> Axis:
        """What maps x to columns."""
        return Axis(self.x_min, self.cell, round((self.x_max - self.x_min) / self.cell))

    @cached_property
    def y_axis(self) -> Axis:
        """What maps y to rows."""
        return Axis(self.y_min, self.cell, round((self.y_max - self.y_min) / self.cell))

    @property
    def shape(self) -> tuple[int, int]:
        """(Y, X): rows and columns."""
        return self.y_axis.count, self.x_axis.count

    def refined(self, factor: int) -> "BEVGrid":
        """The same ground with every cell cut into ``factor`` x ``factor``, such as the pillars of a point cloud."""
        return BEVGrid(self.x_min, self.x_max, self.y_min, self.y_max, self.cell / factor)

    def rows_columns(self, xy: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Row, column (int64, clamped into the grid) and an inside mask for ego points ``xy`` (..., 2)."""
        rows, columns = self.shape
        column = self.x_axis.to_cells(xy[..., 0]).floor_()
        row = self.y_axis.to_cells(xy[..., 1]).floor_()
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return row.nan_to_num().clamp(0, rows - 1).long(), column.nan_to_num().clamp(0, columns - 1).long(), inside

    def centers(self) -> Tensor:
        """Metres (Y, X, 2) of the cell centres as (x, y)."""
        rows, columns = self.shape
        y = self.y_axis.to_metres(torch.arange(rows) + 0.5)
        x = self.x_axis.to_metres(torch.arange(columns) + 0.5)
        return torch.stack([x.expand(rows, columns), y[:, None].expand(rows, columns)], dim=-1)

    def between(self, start: tuple[Tensor, Tensor], end: tuple[Tensor, Tensor]) -> Tensor:
        """Metres (..., 2) as (x, y) from the centres of cells ``start`` (row, column) to those of cells ``end``."""
        return torch.stack([self.x_axis.between(start[1], end[1]), self.y_axis.between(start[0], end[0])], dim=-1)

    def sides(self) -> tuple[float, float]:
        """Metres of the shortest and of the longest side of any cell."""
        sizes = [float(axis.size(torch.tensor(k))) for axis in (self.x_axis, self.y_axis) for k in range(axis.count)]
        return min(sizes), max(sizes)

    def contains(self, xy: np.ndarray) -> np.ndarray:
        """Which of the ego points (N, 2) lie on the grid (numpy in, numpy out)."""
        x, y = xy[..., 0], xy[..., 1]
        return (x >= self.x_min) & (x < self.x_max) & (y >= self.y_min) & (y < self.y_max)


@beartype
@dataclass(frozen=True)
class GradedGrid(BEVGrid):
    """A rectangle of ground in the ego frame cut into ``rows`` x ``columns`` cells that are small near the car: ``cell`` metres
    at x = 0 and at y = 0, longer with abs(x) and wider with abs(y) (``GradedAxis``), alike to the left and to the right.

    Of cells of ``cell`` metres as many as fit make a ``BEVGrid``; the fewer there are, the faster they grow. The uneven cells
    of a polar grid (PolarBEV, Liu et al. 2022, arXiv 2207.01878) follow the camera's rays; these keep the axes of the ego
    frame, and with them convolutions that mean the same ahead and aside, mirror images, and boxes in metres.
    """

    rows: int
    columns: int

    def __post_init__(self) -> None:
        self._check_numbers()
        counts = (("columns", self.columns), ("rows", self.rows))
        for (axis, low, high), (name, count) in zip(self._bounds, counts, strict=True):
            if not low < high:
                raise ValueError(f"grid: {axis}_max={high} must be above {axis}_min={low}")
            if count < 1:
                raise ValueError(f"grid: {name}={count} must be at least 1")
            if count * self.cell > high - low + 1e-6:
                most = math.floor((high - low) / self.cell + 1e-6)
                fewer = f"{name}={most} or fewer, or " if most else ""
                raise ValueError(
                    f"grid: {name}={count} cells of at least {self.cell} m do not fit into {axis} from {low} to {high} m;"
                    f" take {fewer}cell={(high - low) / count:g} or less"
                )

    @cached_property
    def x_axis(self) -> Axis:
        """What maps x to columns."""
        return GradedAxis.fitted(self.x_min, self.x_max, self.cell, self.columns)

    @cached_property
    def y_axis(self) -> Axis:
        """What maps y to rows."""
        return GradedAxis.fitted(self.y_min, self.y_max, self.cell, self.rows)

    def refined(self, factor: int) -> "GradedGrid":
        """The same ground with every cell cut into ``factor`` x ``factor``, such as the pillars of a point cloud."""
        fine = self.cell / factor, self.rows * factor, self.columns * factor
        return GradedGrid(self.x_min, self.x_max, self.y_min, self.y_max, *fine)
