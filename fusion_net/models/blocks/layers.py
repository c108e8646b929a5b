"""Convolution blocks shared by the encoders, the decoder and the head."""

import torch.nn.functional as F
from torch import Tensor, nn

PRIOR_LOGIT = -2.19
"""Initial bias of class logits: a probability of 0.1. Nearly all cells are empty, and the focal loss starts low there."""


class ConvBlock(nn.Sequential):
    """Convolution, batch norm, ReLU: (B, in, H, W) to (B, out, H / stride, W / stride)."""

    def __init__(self, inputs: int, outputs: int, *, kernel: int = 3, stride: int = 1) -> None:
        super().__init__(
            nn.Conv2d(inputs, outputs, kernel, stride=stride, padding=kernel // 2, bias=False),
            nn.BatchNorm2d(outputs),
            nn.ReLU(inplace=True),
        )


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions around an identity (He et al., 2016), at constant width and resolution."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = ConvBlock(width, width)
        self.second = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.norm = nn.BatchNorm2d(width)

    def forward(self, x: Tensor) -> Tensor:
        """(B, width, H, W) to the same shape."""
        return F.relu(x + self.norm(self.second(self.first(x))), inplace=True)


class UpBlock(nn.Module):
    """Doubles a deep map and merges it with a shallow one: the upward step of a U-Net or a feature pyramid.

    Both are first brought to ``outputs`` channels by 1x1 convolutions, which commute with the nearest-neighbour
    enlargement: the product is made at the small size.
    """

    def __init__(self, *, deep: int, shallow: int, outputs: int) -> None:
        super().__init__()
        self.lateral = nn.Conv2d(shallow, outputs, 1)
        self.deep = nn.Conv2d(deep, outputs, 1)
        self.merge = ConvBlock(outputs, outputs)

    def forward(self, deep: Tensor, shallow: Tensor) -> Tensor:
        """(B, deep, H / 2, W / 2) and (B, shallow, H, W) to (B, outputs, H, W); odd sizes are allowed."""
        return self.merge(self.lateral(shallow) + F.interpolate(self.deep(deep), size=shallow.shape[-2:]))
