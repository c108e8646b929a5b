"""One map from the maps of several sensors, any of which may be absent.

``present`` (B, M) is the one mechanism behind modality dropout in training, the drop table in evaluation and a dead
sensor in use: an absent sensor's *features* are dropped, so nothing that its encoder makes of a dead input leaks in.
"""

from typing import Literal

import torch
import torch.nn.functional as F
from beartype import beartype
from torch import Tensor, nn

from fusion_net.models.layers import ConvBlock


def _masked(bev: dict[str, Tensor], present: Tensor) -> list[Tensor]:
    """The maps with absent ones zeroed; filled, not multiplied, so that a dead sensor's NaN does not survive."""
    absent = ~present[:, :, None, None, None]
    return [x.masked_fill(absent[:, i], 0.0) if absent[:, i].any() else x for i, x in enumerate(bev.values())]


@beartype
class ConcatFuser(nn.Module):
    """Concatenation with one presence flag a sensor, mixed by a 1x1 convolution.

    The flags tell "absent" from "present and empty". A constant plane under a 1x1 convolution is a bias, so that is how
    they enter.
    """

    def __init__(self, *, channels: dict[str, int], outputs: int = 32) -> None:
        super().__init__()
        self.channels = channels
        self.mix = nn.Conv2d(sum(channels.values()), outputs, 1, bias=False)
        self.flags = nn.Linear(len(channels), outputs, bias=False)
        self.norm = nn.BatchNorm2d(outputs)

    def forward(self, bev: dict[str, Tensor], present: Tensor) -> Tensor:
        """Maps (B, channels, Y, X) by sensor and ``present`` (B, M) in the same order to (B, outputs, Y, X)."""
        mixed = self.mix(torch.cat(_masked(bev, present), dim=1))
        flags = self.flags(present.to(self.flags.weight.dtype))
        return F.relu(self.norm(mixed + flags[:, :, None, None].to(mixed.dtype)), inplace=True)


@beartype
class AverageFuser(nn.Module):
    """The mean over the present sensors, each first brought to the same channels; ``weighted`` learns the weights.

    Weighted: UniBEV's channel-normalised weights, a softmax over the *present* sensors for each channel; whichever is
    alone gets exactly 1.
    """

    def __init__(self, *, channels: dict[str, int], outputs: int = 32, weighted: bool = False) -> None:
        super().__init__()
        self.channels = channels
        self.align = nn.ModuleDict({name: ConvBlock(width, outputs, kernel=1) for name, width in channels.items()})
        self.logits = nn.Parameter(torch.zeros(len(channels), outputs), requires_grad=weighted)

    def weights(self, present: Tensor) -> Tensor:
        """Non-negative (B, M, outputs) that sum to 1 over the present sensors; all 0 where none is."""
        logits = self.logits.masked_fill(~present[..., None], -torch.inf)
        return logits.softmax(dim=1).nan_to_num()

    def forward(self, bev: dict[str, Tensor], present: Tensor) -> Tensor:
        """Maps (B, channels, Y, X) by sensor and ``present`` (B, M) in the same order to (B, outputs, Y, X)."""
        aligned = {name: self.align[name](x) for name, x in bev.items()}
        weights = self.weights(present)[..., None, None]
        return torch.stack([x * weights[:, i] for i, x in enumerate(_masked(aligned, present))]).sum(dim=0)


@beartype
def make_fuser(
    kind: Literal["concat", "average", "channel_weight"],
    *,
    modalities: list[str],
    channels: dict[str, int],
    outputs: int,
) -> nn.Module:
    """The fuser that a configuration names, for the sensors that it keeps."""
    wrong = [f"{name!r} is no sensor" for name in modalities if name not in channels]
    wrong += [f"{name!r} is there twice" for name in modalities if modalities.count(name) > 1]
    wrong += [] if modalities else ["no sensor is named"]
    if wrong:
        raise ValueError(f"encoders: {wrong[0]}; choose from {', '.join(channels)}")
    kept = {name: channels[name] for name in modalities}
    if kind == "concat":
        return ConcatFuser(channels=kept, outputs=outputs)
    return AverageFuser(channels=kept, outputs=outputs, weighted=kind == "channel_weight")
