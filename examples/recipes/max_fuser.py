"""A fuser of one's own: in each cell and channel the greatest value of the sensors that are there."""

import torch
from torch import Tensor, nn

from fusion_net.models.blocks.layers import ConvBlock


class MaxFuser(nn.Module):
    """Maps by sensor, each aligned by a 1x1 convolution, to their maximum."""

    def __init__(self, *, modalities: list[str], channels: int) -> None:
        super().__init__()
        self.channels = channels  # the model asks for it
        self.align = nn.ModuleDict({name: ConvBlock(channels, channels, kernel=1) for name in modalities})

    def forward(self, bev: dict[str, Tensor], present: Tensor) -> Tensor:
        """Maps (B, C, Y, X) by sensor and ``present`` (B, M) in the same order to one map.

        An absent map is filled with 0 on both sides of the convolution: before it, so that what a dead sensor holds (it may
        be NaN) does not reach the batch norm; after it, so that nothing of it is the maximum (a ConvBlock ends in a ReLU).
        """
        aligned = []
        for i, (name, features) in enumerate(bev.items()):
            absent = ~present[:, i, None, None, None]
            align = self.align[name]
            aligned.append(align(features.masked_fill(absent, 0.0)).masked_fill(absent, 0.0))
        return torch.stack(aligned).amax(dim=0)
