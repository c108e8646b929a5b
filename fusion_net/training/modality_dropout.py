"""Modality dropout: training with the sensors missing that may fail in service."""

import torch
from torch import Tensor

from fusion_net.common.nuscenes_format import MODALITIES

PROPER_SUBSETS = torch.tensor(
    [[bool(bits >> m & 1) for m in range(len(MODALITIES))] for bits in range(1, 2 ** len(MODALITIES) - 1)]
)
"""The six subsets (6, M) that keep at least one modality and drop at least one."""


def sample_present(batch_size: int, probability: float, generator: torch.Generator) -> Tensor:
    """Which modalities each sample keeps (B, M): with ``probability`` one of the six proper subsets, else all.

    Sampled per sample, not per batch, and never empty (UniBEV and CMT drop one of two; with three, a uniform proper subset).
    """
    dropped = torch.rand(batch_size, generator=generator) < probability
    subset = PROPER_SUBSETS[torch.randint(len(PROPER_SUBSETS), (batch_size,), generator=generator)]
    return torch.where(dropped[:, None], subset, torch.ones_like(subset))
