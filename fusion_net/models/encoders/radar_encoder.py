"""Radar detections to a bird's-eye view: named channels per cell, then convolutions."""

import torch
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.data.batch import RADAR_CHANNELS, Batch
from fusion_net.models.blocks.layers import ConvBlock
from fusion_net.models.blocks.outputs import Encoded
from fusion_net.models.blocks.splat import to_map

RASTER_CHANNELS = ("occupancy", "count", "rcs", "rcs_max", "vx", "vy", "speed", "speed_max", "age", "dx", "dy")
"""Of a cell: 1 if hit, log(1 + hits), mean and greatest RCS (dBsm / 10), mean compensated radial velocity in ego axes
(m/s / 10), mean and greatest speed (/ 10), mean age (s * 10), mean offset from the cell's centre (cells)."""


def rasterize(points: Tensor, sample: Tensor, size: int, grid: BEVGrid) -> Tensor:
    """RADAR_CHANNELS points (R, 7) of ``size`` samples to (B, len(RASTER_CHANNELS), Y, X); there may be no points."""
    rows, columns = grid.shape
    row, column, inside = grid.rows_columns(points[:, :2])
    points, row, column, sample = points[inside], row[inside], column[inside], sample[inside].long()
    cell = (sample * rows + row) * columns + column
    x, y, _, rcs, vx, vy, age = (points[:, i] for i in range(len(RADAR_CHANNELS)))
    speed = torch.hypot(vx, vy)
    dx = (x - grid.x_min) / grid.cell - column - 0.5
    dy = (y - grid.y_min) / grid.cell - row - 0.5
    averaged = torch.stack([torch.ones_like(x), rcs / 10, vx / 10, vy / 10, speed / 10, age * 10, dx, dy], dim=1)
    cells = size * rows * columns
    sums = points.new_zeros(cells, averaged.shape[1]).index_add_(0, cell, averaged)
    hits = sums[:, :1]
    _, rcs_mean, vx, vy, speed_mean, age, dx, dy = (sums / hits.clamp(min=1)).split(1, dim=1)
    top = points.new_zeros(cells, 2).scatter_reduce_(
        0, cell[:, None].expand(-1, 2), torch.stack([rcs / 10, speed / 10], dim=1), "amax", include_self=False
    )
    rcs_max, speed_max = top.split(1, dim=1)
    channels = (hits.clamp(max=1), hits.log1p(), rcs_mean, rcs_max, vx, vy, speed_mean, speed_max, age, dx, dy)
    return to_map(torch.cat(channels, dim=1), size, grid)


@beartype
class RadarEncoder(nn.Module):
    """Radar branch: ``forward(batch)`` gives a map (B, channels, Y, X).

    A radar's azimuth is off by metres at range, so the first convolution is wide: a detection reaches more cells than
    its own.
    """

    def __init__(self, *, grid: BEVGrid, channels: int) -> None:
        super().__init__()
        self.grid, self.channels = grid, channels
        self.convs = nn.Sequential(ConvBlock(len(RASTER_CHANNELS), channels, kernel=5), ConvBlock(channels, channels))

    def forward(self, batch: Batch) -> Encoded:
        """The map (B, channels, Y, X)."""
        return Encoded(self.convs(rasterize(batch.radar_points, batch.radar_batch, batch.size, self.grid)))
