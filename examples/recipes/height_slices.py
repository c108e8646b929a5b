"""A LiDAR encoder of one's own: counts of points in slices of height, then convolutions (after PIXOR, Yang et al. 2018)."""

import torch
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.data.batch import Batch
from fusion_net.models.blocks.layers import ConvBlock
from fusion_net.models.blocks.outputs import Encoded
from fusion_net.models.blocks.splat import to_map


class HeightSlices(nn.Module):
    """``forward(batch)`` gives a map (B, channels, Y, X). ``edges``: heights in metres that divide a cell's points."""

    edges: Tensor

    def __init__(self, *, grid: BEVGrid, channels: int, edges: list[float]) -> None:
        super().__init__()
        self.grid, self.channels = grid, channels  # the model asks for channels
        self.register_buffer("edges", torch.tensor(edges), persistent=False)
        self.convs = nn.Sequential(ConvBlock(len(edges) + 1, channels), ConvBlock(channels, channels))

    def forward(self, batch: Batch) -> Encoded:
        """The map; an empty cloud gives a constant one."""
        rows, columns = self.grid.shape
        slices = len(self.edges) + 1
        row, column, inside = self.grid.rows_columns(batch.lidar_points[:, :2])
        slice_ = torch.bucketize(batch.lidar_points[:, 2].contiguous(), self.edges)
        cell = (batch.lidar_batch.long() * rows + row) * columns + column
        counts = torch.bincount((cell * slices + slice_)[inside], minlength=batch.size * rows * columns * slices)
        return Encoded(self.convs(to_map(counts.view(-1, slices).float().log1p(), batch.size, self.grid)))
