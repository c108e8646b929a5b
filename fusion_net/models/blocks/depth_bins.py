"""Depth along a camera's optical axis, divided into bins."""

import math
from dataclasses import dataclass
from typing import Literal

import torch
from beartype import beartype
from torch import Tensor


@beartype
@dataclass(frozen=True)
class DepthBins:
    """``count`` bins from ``low`` to ``high`` metres, equally wide in metres or in the logarithm of metres."""

    low: float
    high: float
    count: int
    spacing: Literal["linear", "log"]

    def __post_init__(self) -> None:
        if not (0 < self.low < self.high and self.count >= 1):
            raise ValueError(
                f"depth bins: need 0 < low < high and count >= 1, got {self.low}, {self.high}, {self.count}"
            )

    def coordinate(self, depth: Tensor) -> Tensor:
        """Position of ``depth`` in bins: bin i covers [i, i + 1) and its centre is at i + 0.5. NaN for depth <= 0."""
        depth = torch.where(depth > 0, depth, torch.nan)
        if self.spacing == "log":
            return torch.log(depth / self.low) * (self.count / math.log(self.high / self.low))
        return (depth - self.low) * (self.count / (self.high - self.low))

    def index(self, depth: Tensor) -> Tensor:
        """Bin (int64) of each depth; -1 outside [low, high), so also for 0, which marks "no return"."""
        bins = torch.floor(self.coordinate(depth))
        return torch.where((bins >= 0) & (bins < self.count), bins, -1.0).long()

    def centers(self) -> Tensor:
        """Metres (D,) at the centres: where a feature of bin i is placed, without the bias of a bin's near edge."""
        position = (torch.arange(self.count) + 0.5) / self.count
        if self.spacing == "log":
            return self.low * (self.high / self.low) ** position
        return self.low + (self.high - self.low) * position
