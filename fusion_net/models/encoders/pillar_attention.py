"""Attention of BEV cells to the image: each cell weighs what it sees along its pillar."""

import torch
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.blocks.splat import SplatIndex, splat, to_map
from fusion_net.models.encoders.backward_projection import BackwardProjection, Samples


@beartype
class PillarAttention(BackwardProjection):
    """Every BEV cell attends to the image features at its ``heights``, in all cameras that show them.

    The weight of a sample is the softmax, over the cell's samples, of the product of a learned query of the cell and height
    and a key made of the feature, times the probability that the pixel's depth is the cell's (BEVFormer's spatial
    cross-attention, Li et al. 2022, at fixed reference points). What is summed is still one sparse product for each of the
    ``heads``, the layers of this transform: only keys of ``key_channels`` are sampled, never the features. ``channels``: those
    of the features. Queries start at zero, as a plain mean over the pillar.
    """

    def __init__(
        self,
        *,
        grid: BEVGrid,
        bins: DepthBins,
        stride: int,
        heights: list[float],
        channels: int,
        heads: int,
        key_channels: int,
    ) -> None:
        super().__init__(grid=grid, bins=bins, stride=stride, heights=heights, depth_weighted=True)
        self.heights, self.num_layers = len(heights), heads
        self.key = nn.Parameter(torch.randn(heads, key_channels, channels) * channels**-0.5)
        self.cell_query = nn.Parameter(torch.zeros(grid.shape[0] * grid.shape[1], heads, key_channels))
        self.height_query = nn.Parameter(torch.zeros(len(heights), heads, key_channels))

    def _geometry(
        self, cam_K: Tensor, ego_T_cam: Tensor, size: tuple[int, int]
    ) -> tuple[SplatIndex, SplatIndex, Samples]:
        """The patterns of the product into cells and of the one that samples the keys, and the samples."""
        samples = self._samples(cam_K, ego_T_cam, size)
        cell = torch.div(samples.point, self.heights, rounding_mode="floor").repeat_interleave(4)
        pixels = cam_K.shape[0] * cam_K.shape[1] * size[0] * size[1]
        into_cells = SplatIndex.of(
            samples.pixel.flatten(), cell, pixels=pixels, cells=len(cam_K) * len(self.points) // self.heights
        )
        one_each = torch.arange(len(samples.point), device=cell.device, dtype=torch.int32).repeat_interleave(4)
        return into_cells, into_cells.with_cells(one_each, cells=len(samples.point)), samples

    def forward(self, features: Tensor, probability: Tensor, cam_K: Tensor, ego_T_cam: Tensor) -> Tensor:
        """Features (B, N, h, w, heads, C) and depth probabilities (B, N, h, w, D) to (B, C, Y, X)."""
        into_cells, sampling, samples = self.geometry(cam_K, ego_T_cam, features.shape[2:4])
        keys = torch.einsum("plc,lkc->plk", features.flatten(0, 3), self.key.to(features.dtype)).flatten(1)
        keys = splat(keys, samples.bilinear.flatten(), sampling)
        attention = self._attention(keys, samples.point, len(features))
        weights = samples.depth_weights(probability)
        heads = [
            splat(of_head.flatten(0, 3), (weights * chosen[:, None]).flatten(), into_cells)
            for of_head, chosen in zip(features.unbind(4), attention.unbind(1), strict=True)
        ]
        return to_map(torch.stack(heads).sum(dim=0), len(features), self.grid)

    def _attention(self, keys: Tensor, point: Tensor, batch: int) -> Tensor:
        """(V, heads) from sampled keys (V, heads * key_channels); of each cell they sum to 1."""
        height = point % self.heights
        cell = torch.div(point, self.heights, rounding_mode="floor")
        count = len(self.cell_query)
        query = self.cell_query.index_select(0, cell % count) + self.height_query.index_select(0, height)
        logits = (query * keys.view_as(query)).sum(dim=-1) * query.shape[-1] ** -0.5
        return segment_softmax(logits, cell.long(), batch * count)


def segment_softmax(logits: Tensor, segment: Tensor, count: int) -> Tensor:
    """Softmax of logits (V, C) over the rows of each of ``count`` segments (V,)."""
    index = segment[:, None].expand_as(logits)
    top = logits.detach().new_full((count, logits.shape[1]), -torch.inf)
    top = top.scatter_reduce(0, index, logits.detach(), "amax")
    raised = (logits - top.index_select(0, segment)).exp()
    total = raised.new_zeros(count, logits.shape[1]).index_add(0, segment, raised)
    return raised / total.index_select(0, segment)
