"""Radar detections to a bird's-eye view: named channels per cell, then convolutions."""

import numpy as np
import torch
import torch.nn.functional as F
from beartype import beartype
from numpy.typing import NDArray
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.nuscenes_format import MODALITIES
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
    dx = grid.x_axis.to_cells(x) - column - 0.5
    dy = grid.y_axis.to_cells(y) - row - 0.5
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


@torch.no_grad()
def radial_velocity(batch: Batch, grid: BEVGrid) -> Tensor:
    """The compensated radial velocity (B, 2, Y, X) around the detections, m/s in ego axes: a mean over 5 x 5 cells that
    weighs near cells more. 0 where there are no detections and in samples without radar."""
    rows, columns = grid.shape
    row, column, inside = grid.rows_columns(batch.radar_points[:, :2])
    sample = batch.radar_batch.long()
    kept = (inside & batch.present[:, MODALITIES.index("radar")].index_select(0, sample)).nonzero()[:, 0]
    cell = ((sample * rows + row) * columns + column).index_select(0, kept)
    velocity = batch.radar_points[:, 4:6].index_select(0, kept).float()
    values = torch.cat([velocity, torch.ones_like(velocity[:, :1])], dim=1)
    raster = to_map(values.new_zeros(batch.size * rows * columns, 3).index_add_(0, cell, values), batch.size, grid)
    for _ in range(2):
        raster = F.avg_pool2d(raster, 3, stride=1, padding=1)
    return torch.where(raster[:, 2:] > 0, raster[:, :2] / raster[:, 2:], 0.0)


def radar_detections(batch: Batch) -> tuple[NDArray[np.float32], ...]:
    """The detections (R_b, RADAR_CHANNELS) of each sample; none of a sample whose radar is absent."""
    present = batch.present[:, MODALITIES.index("radar")].tolist()
    points, sample = batch.radar_points.float().cpu().numpy(), batch.radar_batch.cpu().numpy()
    return tuple(points[(sample == b) & present[b]] for b in range(batch.size))


@beartype
class RadarEncoder(nn.Module):
    """Radar branch: ``forward(batch)`` gives a map (B, channels, Y, X). ``raster_channels``: which of RASTER_CHANNELS it sees.

    A radar's azimuth is off by metres at range, so the first convolution is wide: a detection reaches more cells than
    its own.
    """

    def __init__(self, *, grid: BEVGrid, channels: int, raster_channels: list[str]) -> None:
        super().__init__()
        if wrong := [name for name in raster_channels if name not in RASTER_CHANNELS]:
            raise ValueError(
                f"radar encoder: there is no channel {wrong[0]!r}; choose from {', '.join(RASTER_CHANNELS)}"
            )
        if not raster_channels or len(set(raster_channels)) < len(raster_channels):
            raise ValueError(f"radar encoder: raster_channels={raster_channels} must name channels, each once")
        self.grid, self.channels = grid, channels
        self.used = [RASTER_CHANNELS.index(name) for name in raster_channels]
        self.convs = nn.Sequential(ConvBlock(len(self.used), channels, kernel=5), ConvBlock(channels, channels))

    def forward(self, batch: Batch) -> Encoded:
        """The map (B, channels, Y, X)."""
        raster = rasterize(batch.radar_points, batch.radar_batch, batch.size, self.grid)
        return Encoded(self.convs(raster if len(self.used) == len(RASTER_CHANNELS) else raster[:, self.used]))
