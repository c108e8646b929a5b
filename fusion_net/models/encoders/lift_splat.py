"""Lift-splat (Philion & Fidler 2020): every pixel's feature goes to every depth along its ray, weighted by the depth's
probability, and a cell sums what falls into it."""

import torch
from beartype import beartype
from torch import Tensor

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.blocks.splat import SplatIndex, splat, to_map
from fusion_net.models.encoders.view_transforms import ViewTransform, pixel_rays, rotated

_FAINT = 0.1
"""Summed probability at which a normalized cell has half of its mean feature."""


@beartype
class LiftSplat(ViewTransform):
    """Forward projection of every pixel's feature to the BEV cells along its ray, at the centres of the depth bins.

    ``height_edges``: metres at which the pillar is cut into layers that have features of their own (none: one layer).
    ``bilinear`` divides an entry among the four nearest cells, at four times the entries. ``normalize`` divides a layer of a
    cell by its summed weight, so that near cells, which many rays cross, and far ones are of one scale; a nearly empty one
    stays faint.
    """

    def __init__(
        self,
        *,
        grid: BEVGrid,
        bins: DepthBins,
        stride: int,
        height_edges: list[float] | None = None,
        bilinear: bool = False,
        normalize: bool = False,
    ) -> None:
        super().__init__(grid=grid, bins=bins, stride=stride)
        height_edges = height_edges or []
        if sorted(set(height_edges)) != height_edges:
            raise ValueError(f"lift-splat: height_edges must rise, got {height_edges}")
        self.height_edges, self.bilinear, self.normalize = height_edges, bilinear, normalize
        self.num_layers = len(height_edges) + 1

    def _geometry(
        self, cam_K: Tensor, ego_T_cam: Tensor, size: tuple[int, int]
    ) -> tuple[SplatIndex, Tensor, Tensor | None]:
        """The pattern of the product (cells x pixels and layers); of each of its entries the index of its probability, and
        its share of it."""
        (batch, cameras), bins = cam_K.shape[:2], self.bins.count
        rays = rotated(ego_T_cam[:, :, None, None, :3, :3], pixel_rays(cam_K, *size, self.stride))
        origin, depth = ego_T_cam[:, :, None, None, None, :3, 3], self.bins.centers().to(cam_K)
        # Planes of one coordinate, changed in place: the calibration differs at every step, so this is on the clock.
        x, y, z = ((depth * rays[..., i, None]).add_(origin[..., i]) for i in range(3))
        column, row = self.grid.x_axis.to_cells(x), self.grid.y_axis.to_cells(y)
        band = [z >= edge for edge in self.height_edges]
        share = None
        if self.bilinear:
            column, row, share = _corners(column, row)
            band = [above[..., None] for above in band]
        else:
            column, row = column.floor_(), row.floor_()
        rows, columns = self.grid.shape
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        kept = inside.flatten().nonzero()[:, 0]
        sample = torch.arange(batch, device=cam_K.device, dtype=torch.int32).view(-1, *[1] * (row.dim() - 1))
        cell = row.mul_(columns).add_(column).int() + sample * (rows * columns)
        corners = 4 if self.bilinear else 1
        pixels = torch.arange(batch * cameras * size[0] * size[1], device=cam_K.device, dtype=torch.int32)
        column_of = pixels.mul_(self.num_layers).repeat_interleave(bins * corners).view_as(cell)
        if band:
            column_of = column_of + sum(above.int() for above in band)
        index = SplatIndex.of(
            column_of.flatten().index_select(0, kept),
            cell.flatten().index_select(0, kept),
            pixels=len(pixels) * self.num_layers,
            cells=batch * rows * columns,
        )
        if share is None:
            return index, kept, None
        return index, torch.div(kept, corners, rounding_mode="floor"), share.flatten().index_select(0, kept)

    def forward(self, features: Tensor, probability: Tensor, cam_K: Tensor, ego_T_cam: Tensor) -> Tensor:
        """Features (B, N, h, w, layers, C) and depth probabilities (B, N, h, w, D) to (B, C, Y, X)."""
        index, entry, share = self.geometry(cam_K, ego_T_cam, features.shape[2:4])
        weights = probability.flatten().index_select(0, entry)
        weights = weights if share is None else weights * share
        if self.normalize:
            layer = index.cell * self.num_layers + index.pixel % self.num_layers
            total = weights.new_zeros(len(index.by_cell.row_starts) * self.num_layers).index_add(0, layer, weights)
            weights = weights / (total.index_select(0, layer) + _FAINT)
        return to_map(splat(features.flatten(0, 4), weights, index), len(features), self.grid)


def _corners(column: Tensor, row: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The four cells (..., 4) whose centres surround continuous cell coordinates, and the bilinear share of each."""
    column, row = column.sub_(0.5), row.sub_(0.5)
    left, top = column.floor(), row.floor()
    dx, dy = column.sub_(left), row.sub_(top)
    share = [(1 - dy) * (1 - dx), (1 - dy) * dx, dy * (1 - dx), dy * dx]
    columns, rows = [left, left + 1, left, left + 1], [top, top, top + 1, top + 1]
    return torch.stack(columns, dim=-1), torch.stack(rows, dim=-1), torch.stack(share, dim=-1)
