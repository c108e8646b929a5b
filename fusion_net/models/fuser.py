"""One map from the maps of several sensors, any of which may be absent.

``present`` (B, M) is the one mechanism behind modality dropout in training, the drop table in evaluation and a dead
sensor in use: an absent sensor's *features* are dropped, so that nothing its encoder makes of a dead input gets through.
Every fuser keeps the width: maps (B, ``channels``, Y, X) in, one such map out.
"""

from typing import Literal

import torch
import torch.nn.functional as F
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.blocks.layers import ConvBlock


def _masked(bev: dict[str, Tensor], present: Tensor) -> list[Tensor]:
    """The maps with absent ones zeroed; filled, not multiplied, so that a dead sensor's NaN does not survive."""
    absent = ~present[:, :, None, None, None]
    return [x.masked_fill(absent[:, i], 0.0) if absent[:, i].any() else x for i, x in enumerate(bev.values())]


@beartype
class ConcatFuser(nn.Module):
    """Concatenation with one presence flag per sensor, mixed by a 1x1 convolution.

    The flags tell "absent" from "present and empty". A constant plane under a 1x1 convolution is a bias, so that is how
    they enter.
    """

    def __init__(self, *, modalities: list[str], channels: int) -> None:
        super().__init__()
        self.channels = channels
        self.mix = nn.Conv2d(len(modalities) * channels, channels, 1, bias=False)
        self.flags = nn.Linear(len(modalities), channels, bias=False)
        self.norm = nn.BatchNorm2d(channels)

    def forward(self, bev: dict[str, Tensor], present: Tensor) -> Tensor:
        """Maps by sensor and ``present`` (B, M) in the same order to one map."""
        mixed = self.mix(torch.cat(_masked(bev, present), dim=1))
        flags = self.flags(present.to(self.flags.weight.dtype))
        return F.relu(self.norm(mixed + flags[:, :, None, None].to(mixed.dtype)), inplace=True)


@beartype
class AverageFuser(nn.Module):
    """The mean over the present sensors, each map first aligned by a 1x1 convolution; ``weighted`` learns the weights.

    Weighted: UniBEV's channel-normalized weights, a softmax over the *present* sensors for each channel; a sensor that is
    the only one gets exactly 1.
    """

    def __init__(self, *, modalities: list[str], channels: int, weighted: bool) -> None:
        super().__init__()
        self.channels = channels
        self.align = nn.ModuleDict({name: ConvBlock(channels, channels, kernel=1) for name in modalities})
        self.logits = nn.Parameter(torch.zeros(len(modalities), channels), requires_grad=weighted)

    def weights(self, present: Tensor) -> Tensor:
        """Non-negative (B, M, channels) that sum to 1 over the present sensors; all 0 where none is."""
        logits = self.logits.masked_fill(~present[..., None], -torch.inf)
        return logits.softmax(dim=1).nan_to_num()

    def forward(self, bev: dict[str, Tensor], present: Tensor) -> Tensor:
        """Maps by sensor and ``present`` (B, M) in the same order to one map."""
        aligned = {name: self.align[name](x) for name, x in bev.items()}
        weights = self.weights(present)[..., None, None]
        return torch.stack([x * weights[:, i] for i, x in enumerate(_masked(aligned, present))]).sum(dim=0)


@beartype
def make_fuser(
    kind: Literal["concat", "average", "channel_weight"], *, modalities: list[str], channels: int
) -> ConcatFuser | AverageFuser:
    """The fuser that a configuration names, for the sensors that it keeps."""
    wrong = [f"{name!r} is no sensor" for name in modalities if name not in MODALITIES]
    wrong += [f"{name!r} is there twice" for name in modalities if modalities.count(name) > 1]
    wrong += [] if modalities else ["no sensor is named"]
    if wrong:
        raise ValueError(f"encoders: {wrong[0]}; choose from {', '.join(MODALITIES)}")
    if kind == "concat":
        return ConcatFuser(modalities=modalities, channels=channels)
    return AverageFuser(modalities=modalities, channels=channels, weighted=kind == "channel_weight")
