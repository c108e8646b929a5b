"""The splat as a sparse matrix product: what falls into a cell is summed, and the frustum features are never materialized.

``bev = S @ features`` with a sparse cells x pixels matrix S whose entries are weights. ``embedding_bag`` is that product over
compressed sparse rows (CSR). Its gradient with respect to the features is the transposed product, and with respect to each
entry of S a dot product.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from fusion_net.common.bev_grid import BEVGrid


@dataclass(frozen=True)
class SparseRows:
    """The pattern of a sparse matrix with E entries in compressed sparse row (CSR) form; the values are kept apart.

    ``order`` sorts the values by row; it is None where they are stored in that order.
    """

    order: Tensor | None  # (E,)
    columns: Tensor  # (E,) int32, sorted by row
    row_starts: Tensor  # (rows,) int32: the first entry of each row

    @staticmethod
    def of(row: Tensor, column: Tensor, *, rows: int) -> "SparseRows":
        """From the row in [0, rows) and the column of each entry (E,), in any order."""
        order = None
        if not (row[1:] >= row[:-1]).all():
            row, order = torch.sort(row, stable=True)
            column = column.index_select(0, order)
        counts = torch.bincount(row, minlength=rows)
        return SparseRows(order, column, (counts.cumsum(0) - counts).int())

    def product(self, values: Tensor, dense: Tensor) -> Tensor:
        """The matrix with ``values`` (E,) times ``dense`` (columns, C): (rows, C)."""
        if not len(self.columns):
            return dense.new_zeros(len(self.row_starts), dense.shape[1])
        values = values if self.order is None else values.index_select(0, self.order)
        return F.embedding_bag(self.columns, dense, self.row_starts, mode="sum", per_sample_weights=values)


@dataclass(frozen=True)
class SplatIndex:
    """The pattern of S (cells x pixels): entry e is in row ``cell[e]`` and column ``pixel[e]``."""

    pixel: Tensor  # (E,) int32
    cell: Tensor  # (E,) int32
    by_cell: SparseRows  # S, for the forward pass
    by_pixel: SparseRows  # S transposed, for the gradient of the features

    @staticmethod
    def of(pixel: Tensor, cell: Tensor, *, pixels: int, cells: int) -> "SplatIndex":
        """From the pixel and the cell of each entry, integers (E,) in any order; E may be 0."""
        pixel, cell = pixel.int(), cell.int()
        by_cell, by_pixel = SparseRows.of(cell, pixel, rows=cells), SparseRows.of(pixel, cell, rows=pixels)
        return SplatIndex(pixel, cell, by_cell, by_pixel)

    def with_cells(self, cell: Tensor, *, cells: int) -> "SplatIndex":
        """The same pixels in the same order in other cells (E,), without sorting the pixels again."""
        order, cell = self.by_pixel.order, cell.int()
        by_pixel = SparseRows(order, cell if order is None else cell.index_select(0, order), self.by_pixel.row_starts)
        return SplatIndex(self.pixel, cell, SparseRows.of(cell, self.pixel, rows=cells), by_pixel)


class _Splat(torch.autograd.Function):
    @staticmethod
    def forward(ctx, features: Tensor, weights: Tensor, index: SplatIndex) -> Tensor:
        ctx.save_for_backward(features, weights)
        ctx.index = index
        return index.by_cell.product(weights, features)

    @staticmethod
    def backward(ctx, *grads: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        features, weights = ctx.saved_tensors
        index, grad = ctx.index, grads[0].contiguous()
        grad_features = grad_weights = None
        if ctx.needs_input_grad[0]:
            grad_features = index.by_pixel.product(weights, grad)
        if ctx.needs_input_grad[1]:
            # The gradient of an entry is the dot product of its pixel's feature with its cell's gradient. Pixels take the
            # part of the operator's bags and the BEV gradient that of its table, so that the entries of LiftSplat, which
            # are stored by pixel, are read in memory order.
            no_offsets = index.pixel.new_empty(0)
            dot_products = torch.ops.aten._embedding_bag_per_sample_weights_backward
            grad_weights = dot_products(features, grad, index.cell, no_offsets, index.pixel, 0)
        return grad_features, grad_weights, None


def splat(features: Tensor, weights: Tensor, index: SplatIndex) -> Tensor:
    """Sum over the entries of each cell of weight x feature: (P, C) and (E,) to (cells, C), in float32 or float64.

    Sums of hundreds of entries lose too much in bfloat16, so autocast ends here.
    """
    dtype = torch.promote_types(features.dtype, torch.float32)
    with torch.autocast(features.device.type, enabled=False):
        return _Splat.apply(features.contiguous().to(dtype), weights.contiguous().to(dtype), index)


def flat_cells(xy: Tensor, grid: BEVGrid) -> tuple[Tensor, Tensor]:
    """Cell numbers of ego points (B, ..., 2) in the batch's maps, b * Y * X + row * X + column, and an inside mask."""
    row, column, inside = grid.rows_columns(xy)
    sample = torch.arange(len(xy), device=xy.device).view(-1, *[1] * (row.dim() - 1))
    return (sample * grid.shape[0] + row) * grid.shape[1] + column, inside


def to_map(cells: Tensor, batch: int, grid: BEVGrid) -> Tensor:
    """(B * Y * X, C) to (B, C, Y, X), without a copy: the memory already is in channels_last order."""
    return cells.view(batch, *grid.shape, -1).permute(0, 3, 1, 2)
