"""Objects as points (CenterPoint, Yin et al. 2021): one heat map per class, and a box regressed at each peak."""

import math
from typing import Literal

import numpy as np
import torch
import torch.nn.functional as F
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.models.blocks.heading import yaw_of
from fusion_net.models.blocks.layers import PRIOR_LOGIT, ConvBlock

HEADINGS = {"sincos": {"rot": 2}, "axis": {"axis": 2, "direction": 1}}
"""Channels of the maps of a heading: sin and cos of yaw, or sin and cos of 2 yaw and a logit (``blocks.heading``)."""


def regressions(heading: str) -> dict[str, int]:
    """Channels of each map: metres from the cell's centre, z in m, log of w l h, a heading, m/s, log of m^2."""
    return {"offset": 2, "height": 1, "size": 3, **HEADINGS[heading], "velocity": 2, "log_variance": 2}


@beartype
class CenterHead(nn.Module):
    """(B, channels, Y, X) to maps: "heatmap" logits (B, K, Y, X) and ``regressions``; ``decode`` turns maps into boxes.

    ``heading``: one of HEADINGS. ``nms_radius``: metres, by class, within which a second centre of the same class is taken
    for the same object. ``variance_penalty`` k: scores are multiplied by exp(-k sigma) with the standard deviation sigma of
    the centre in metres, so that of two equally likely objects the better placed one comes first.
    """

    radius: Tensor  # (K,) metres
    centers: Tensor  # (2, Y, X) metres

    def __init__(
        self,
        *,
        grid: BEVGrid,
        classes: list[str],
        channels: int,
        hidden: int,
        heading: Literal["axis", "sincos"],
        max_boxes: int,
        min_score: float,
        nms_radius: dict[str, float],
        variance_penalty: float,
    ) -> None:
        super().__init__()
        unknown = [name for name in classes if name not in CLASSES]
        if unknown or not classes:
            raise ValueError(
                f"center head: classes {unknown or classes} are not detection classes; choose from {CLASSES}"
            )
        if missing := [name for name in classes if name not in nms_radius]:
            raise ValueError(f"center head: nms_radius has no value for {', '.join(missing)}")
        if not 0 <= variance_penalty < math.inf:
            raise ValueError(f"center head: variance_penalty={variance_penalty} must be a finite number of at least 0")
        self.grid, self.max_boxes, self.min_score = grid, max_boxes, min_score
        self.num_classes, self.variance_penalty = len(classes), variance_penalty
        self.regressions = regressions(heading)
        self.heatmap = nn.Sequential(ConvBlock(channels, hidden), nn.Conv2d(hidden, len(classes), 1))
        self.box = nn.Sequential(ConvBlock(channels, hidden), nn.Conv2d(hidden, sum(self.regressions.values()), 1))
        nn.init.constant_(self.heatmap[1].get_parameter("bias"), PRIOR_LOGIT)
        radius = torch.tensor([nms_radius[name] for name in classes])
        self.register_buffer("radius", radius, persistent=False)
        self.register_buffer("centers", grid.centers().float().permute(2, 0, 1), persistent=False)

    def forward(self, decoded: Tensor) -> dict[str, Tensor]:
        """Maps in float32, whatever autocast does around them."""
        box = self.box(decoded).float().split(list(self.regressions.values()), dim=1)
        return {"heatmap": self.heatmap(decoded).float()} | dict(zip(self.regressions, box, strict=True))

    @torch.no_grad()
    def decode(self, maps: dict[str, Tensor]) -> list[Boxes]:
        """Boxes of each sample in the ego frame, best first: peaks of 3 x 3 cells, top ``max_boxes``, circle NMS."""
        heat = maps["heatmap"].float().nan_to_num(nan=-math.inf).sigmoid()
        is_peak = F.max_pool2d(heat, 3, stride=1, padding=1) == heat
        if self.variance_penalty:
            sigma = maps["log_variance"].float().nan_to_num().clamp(-12.0, 12.0).exp().mean(dim=1, keepdim=True).sqrt()
            heat = heat * (-self.variance_penalty * sigma).exp()
        peaks = torch.where(is_peak, heat, -1.0).flatten(1)
        score, flat = peaks.topk(min(self.max_boxes, peaks.shape[1]), dim=1)  # (B, K)
        rows, columns = self.grid.shape
        label = torch.div(flat, rows * columns, rounding_mode="floor")
        cell = flat % (rows * columns)
        values = {name: _at(maps[name].float(), cell) for name in self.regressions}
        xy = self.centers.flatten(1).T[cell] + values["offset"]
        kept = (score > self.min_score) & self._unique(xy, label)
        center = torch.cat([xy, values["height"]], dim=-1)
        wlh = values["size"].clamp(-5.0, 5.0).exp()
        if "axis" in values:
            yaw = yaw_of(values["axis"], values["direction"][..., 0])
        else:
            yaw = torch.atan2(values["rot"][..., 0], values["rot"][..., 1])
        columns_of_box = (center, wlh, yaw, values["velocity"], label, score, values["log_variance"].clamp(-12.0, 12.0))
        arrays = [x.cpu().numpy() for x in columns_of_box]
        return [_boxes(*(x[b][kept[b].cpu().numpy()] for x in arrays)) for b in range(len(heat))]

    def _unique(self, xy: Tensor, label: Tensor) -> Tensor:
        """Greedy circle NMS over candidates (B, K) sorted by score: True where no better kept one of the class is near.

        The loop is over ranks, for all samples at once.
        """
        near = torch.cdist(xy, xy) < self.radius[label][..., None]
        same_object = near & (label[..., None] == label[:, None])  # (B, K, K)
        kept = torch.ones_like(label, dtype=torch.bool)
        for rank in range(1, label.shape[1]):
            kept[:, rank] = ~(same_object[:, rank, :rank] & kept[:, :rank]).any(dim=1)
        return kept


def _at(values: Tensor, cell: Tensor) -> Tensor:
    """Values (B, C, Y, X) at flat cells (B, K), as (B, K, C)."""
    return values.flatten(2).gather(2, cell[:, None].expand(-1, values.shape[1], -1)).transpose(1, 2)


def _boxes(center, wlh, yaw, velocity, label, score, log_variance) -> Boxes:
    center, wlh, yaw, velocity, score, log_variance = (
        np.asarray(x, np.float64) for x in (center, wlh, yaw, velocity, score, log_variance)
    )
    return Boxes(center, wlh, yaw, velocity, label.astype(np.int64), score, log_variance)
