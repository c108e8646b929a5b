"""One map from the maps of several sensors, any of which may be absent.

``present`` (B, M) is the one mechanism behind modality dropout in training, the drop table in evaluation and a dead
sensor in use: an absent sensor's *features* are dropped, so that nothing its encoder makes of a dead input gets through.
Every fuser keeps the width: maps (B, ``channels``, Y, X) in, one such map out.
"""

import torch
import torch.nn.functional as F
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.checks import check_names
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.common.settings import own_object
from fusion_net.models.blocks.layers import ConvBlock


def _masked(bev: dict[str, Tensor], present: Tensor) -> list[Tensor]:
    """The maps with absent ones zeroed; filled, not multiplied, so that a dead sensor's NaN does not survive."""
    absent = ~present[:, :, None, None, None]
    return [x.masked_fill(absent[:, i], 0.0) if absent[:, i].any() else x for i, x in enumerate(bev.values())]


def _sum(maps: list[Tensor]) -> Tensor:
    return sum(maps[1:], maps[0])


def _aligned(bev: dict[str, Tensor], present: Tensor, align: nn.ModuleDict) -> list[Tensor]:
    """The maps put through ``align``, with absent ones zeroed on both sides of it: its batch norms see none of them."""
    masked = zip(bev, _masked(bev, present), strict=True)
    return _masked({name: align[name](x) for name, x in masked}, present)


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
        weights = self.weights(present)[..., None, None]
        maps = _aligned(bev, present, self.align)
        return torch.stack([x * weights[:, i] for i, x in enumerate(maps)]).sum(dim=0)


@beartype
class GatedFuser(nn.Module):
    """The sum over the present sensors, each weighted by a gate of its own in every cell.

    The gate, a sigmoid, sees all maps and which sensors are there (Kim et al. 2018, "Robust deep multi-modal learning based
    on gated information fusion network"), so one sensor may be trusted near and another far, or in fog.
    """

    def __init__(self, *, modalities: list[str], channels: int) -> None:
        super().__init__()
        self.channels = channels
        self.align = nn.ModuleDict({name: ConvBlock(channels, channels, kernel=1) for name in modalities})
        self.gate = nn.Conv2d(len(modalities) * channels, len(modalities), 1)
        self.flags = nn.Linear(len(modalities), len(modalities), bias=False)

    def weights(self, maps: list[Tensor], present: Tensor) -> Tensor:
        """Gates (B, M, Y, X) of masked maps, in [0, 1]; exactly 0 of an absent sensor."""
        flags = self.flags(present.to(self.flags.weight.dtype))[:, :, None, None]
        gates = (self.gate(torch.cat(maps, dim=1)) + flags).sigmoid()
        return gates * present[:, :, None, None]

    def forward(self, bev: dict[str, Tensor], present: Tensor) -> Tensor:
        """Maps by sensor and ``present`` (B, M) in the same order to one map."""
        maps = _aligned(bev, present, self.align)
        weights = self.weights(maps, present)
        return _sum([x * weights[:, i : i + 1] for i, x in enumerate(maps)])


@beartype
class CrossAttentionFuser(nn.Module):
    """Attention in every cell over the sensors' features there as tokens, the absent ones masked.

    The query is a learned one plus what the cell holds on average (as UniBEV's and CMT's queries gather from whichever
    sensors there are, Wang et al. 2024, Yan et al. 2023, here cell by cell); a token's key knows its sensor. With one sensor
    the weights are exactly 1, and without any the result is that of an empty sum.
    """

    def __init__(self, *, modalities: list[str], channels: int, heads: int = 4) -> None:
        super().__init__()
        if channels % heads:
            raise ValueError(f"fuser: {channels} channels do not divide into {heads} heads")
        self.channels, self.heads = channels, heads
        self.align = nn.ModuleDict({name: ConvBlock(channels, channels, kernel=1) for name in modalities})
        self.query = nn.Conv2d(channels, channels, 1)
        self.key = nn.Conv2d(channels, channels, 1, bias=False)
        self.sensor = nn.Parameter(torch.randn(len(modalities), channels) * channels**-0.5)
        self.value = nn.Conv2d(channels, channels, 1, bias=False)
        self.output = ConvBlock(channels, channels, kernel=1)

    def weights(self, maps: list[Tensor], present: Tensor) -> Tensor:
        """Attention (B, M, heads, Y, X) to masked maps; sums to 1 over the present sensors, all 0 where there is none."""
        there = present.sum(dim=1).clamp(min=1).to(maps[0].dtype)[:, None, None, None]
        query = self.query(_sum(maps) / there)
        keys = [self.key(x) + of[:, None, None] for x, of in zip(maps, self.sensor, strict=True)]
        split = (self.heads, self.channels // self.heads)
        logits = torch.stack([(query * key).unflatten(1, split).sum(dim=2) for key in keys], dim=1).float()
        logits = logits / split[1] ** 0.5
        return logits.masked_fill(~present[:, :, None, None, None], -torch.inf).softmax(dim=1).nan_to_num()

    def forward(self, bev: dict[str, Tensor], present: Tensor) -> Tensor:
        """Maps by sensor and ``present`` (B, M) in the same order to one map."""
        maps = _aligned(bev, present, self.align)
        weights = self.weights(maps, present).to(maps[0].dtype)[:, :, :, None]
        split = (self.heads, self.channels // self.heads)
        values = [self.value(x).unflatten(1, split) * weights[:, i] for i, x in enumerate(maps)]
        return self.output(_sum(values).flatten(1, 2))


KINDS = ("concat", "average", "channel_weight", "gated", "cross_attention")


@beartype
def make_fuser(kind: str, *, modalities: list[str], channels: int) -> nn.Module:
    """The fuser that a configuration names, for the sensors that it keeps: one of KINDS, or a class of one's own.

    Such a ``module.Class`` takes ``modalities`` and ``channels``, keeps ``channels``, and has a ``forward`` as the others: maps
    by sensor and ``present`` (B, M) in the same order to one map (B, channels, Y, X).
    """
    wrong = [f"{name!r} is no sensor" for name in modalities if name not in MODALITIES]
    wrong += [f"{name!r} is there twice" for name in modalities if modalities.count(name) > 1]
    wrong += [] if modalities else ["no sensor is named"]
    if wrong:
        raise ValueError(f"encoders: {wrong[0]}; choose from {', '.join(MODALITIES)}")
    if "." in kind:
        return own_object(kind, where="fuser")(modalities=modalities, channels=channels)
    check_names("fuser", [kind], KINDS)
    if kind == "concat":
        return ConcatFuser(modalities=modalities, channels=channels)
    if kind == "gated":
        return GatedFuser(modalities=modalities, channels=channels)
    if kind == "cross_attention":
        return CrossAttentionFuser(modalities=modalities, channels=channels)
    return AverageFuser(modalities=modalities, channels=channels, weighted=kind == "channel_weight")
