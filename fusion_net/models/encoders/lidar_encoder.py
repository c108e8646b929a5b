"""A point cloud to a bird's-eye view: dynamic pillars, no point is dropped (Lang et al. 2019; Zhou et al. 2020)."""

import torch
import torch.nn.functional as F
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.data.batch import LIDAR_CHANNELS, Batch
from fusion_net.models.blocks.layers import ConvBlock
from fusion_net.models.blocks.outputs import Encoded
from fusion_net.models.blocks.splat import to_map


class _SegmentMax(torch.autograd.Function):
    """Maximum of rows (P, C) over segments, none of them empty; every row that equals it gets the whole gradient.

    The backward of ``scatter_reduce`` divides the gradient among ties by counting them, which costs as much again.
    """

    @staticmethod
    def forward(ctx, rows: Tensor, segment: Tensor, count: int) -> Tensor:
        index = segment[:, None].expand_as(rows)
        top = rows.new_zeros(count, rows.shape[1]).scatter_reduce(0, index, rows, "amax", include_self=False)
        ctx.save_for_backward(rows, segment, top)
        return top

    @staticmethod
    def backward(ctx, *grads: Tensor) -> tuple[Tensor, None, None]:
        rows, segment, top = ctx.saved_tensors
        grad = grads[0].index_select(0, segment)
        return grad.masked_fill_(rows != top.index_select(0, segment), 0.0), None, None


@beartype
class LidarEncoder(nn.Module):
    """LiDAR branch: ``forward(batch)`` gives a map (B, channels, Y, X); an empty point cloud gives a constant map.

    ``pillar`` is the pillar's side in metres: the grid's cell, a half (None) or a quarter (where cells grow with the distance,
    those at the car, and every cell is divided alike). ``extra_channels`` counts columns that follow LIDAR_CHANNELS (painted
    class scores).
    """

    def __init__(
        self, *, grid: BEVGrid, channels: int, pillar: float | None, features: int, extra_channels: int = 0
    ) -> None:
        super().__init__()
        pillar = grid.cell / 2 if pillar is None else pillar
        ratio = round(grid.cell / pillar)
        if ratio not in (1, 2, 4) or abs(ratio * pillar - grid.cell) > 1e-6:
            nearest = min((grid.cell, grid.cell / 2, grid.cell / 4), key=lambda side: abs(side - pillar))
            raise ValueError(
                f"lidar encoder: a pillar of {pillar} m does not halve into the {grid.cell} m cell; use {nearest}"
            )
        self.channels, self.grid, self.pillars = channels, grid, grid.refined(ratio)
        self.point = nn.Linear(len(LIDAR_CHANNELS) + 5 + extra_channels, features)
        self.norm = nn.BatchNorm1d(features)
        steps = [ConvBlock(features, features, stride=2) for _ in range(ratio.bit_length() - 1)]
        self.convs = nn.Sequential(*steps, ConvBlock(features, channels))

    def forward(self, batch: Batch) -> Encoded:
        """The map (B, channels, Y, X)."""
        return Encoded(self.encode(batch.lidar_points, batch.lidar_batch, batch.size))

    def encode(self, points: Tensor, sample: Tensor, size: int) -> Tensor:
        """The map from points (P, 5 + extra_channels) and the index (P,) of each point's sample among ``size``."""
        rows, columns = self.pillars.shape
        row, column, inside = self.pillars.rows_columns(points[:, :2])
        kept = inside.nonzero()[:, 0]
        points, sample, row, column = (x.index_select(0, kept) for x in (points, sample, row, column))
        pillar = (sample.long() * rows + row) * columns + column
        counts = torch.bincount(pillar, minlength=size * rows * columns)
        occupied = counts.nonzero()[:, 0]
        segment = (counts > 0).cumsum(0).index_select(0, pillar) - 1
        features = self.point(self._decorate(points, row, column, segment, counts.index_select(0, occupied)))
        # ReLU and maximum commute, and there are ten times as many points as pillars.
        top = F.relu(_SegmentMax.apply(features, segment, len(occupied)))
        # Batch norm over the occupied pillars only: the many empty ones say nothing about the scale.
        top = self.norm(top) if len(occupied) > 1 or not self.training else top
        canvas = top.new_zeros(size * rows * columns, top.shape[1]).index_copy(0, occupied, top)
        return self.convs(to_map(canvas, size, self.pillars))

    def _decorate(self, points: Tensor, row: Tensor, column: Tensor, segment: Tensor, counts: Tensor) -> Tensor:
        """Point features (P, 10 + extra) of order one, with offsets from the pillar's mean and centre. ``counts``: points
        of each occupied pillar."""
        axes, xyz = (self.pillars.x_axis, self.pillars.y_axis), points[:, :3]
        mean = xyz.new_zeros(len(counts), 3).index_add_(0, segment, xyz) / counts[:, None]
        scale = xyz.new_tensor([0.05, 0.05, 0.5])  # tens of metres across, metres up
        from_center = [
            ((xyz[:, i] - axis.to_metres(index + 0.5)) / axis.size(index)).to(xyz)[:, None]
            for i, (axis, index) in enumerate(zip(axes, (column, row), strict=True))
        ]
        return torch.cat([xyz * scale, points[:, 3:], xyz - mean.index_select(0, segment), *from_center], dim=1)
