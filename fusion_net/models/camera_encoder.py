"""Images to a bird's-eye view: a small residual trunk, depth distributions, an injected view transform.

The trunk also predicts class scores and a regressed log-depth a cell. Their dense losses are what lets a camera branch
of this size learn in minutes, and as "evidence" in the view they tell the detector where the camera saw what.
"""

from dataclasses import dataclass
from typing import Literal

import torch
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.data.batch import Batch
from fusion_net.models.layers import ConvBlock, ResidualBlock, UpBlock
from fusion_net.models.lift_splat import (
    LiftSplat,
    PullLift,
    SplatIndex,
    ego_points,
    flat_cells,
    pixel_rays,
    splat,
    to_map,
)


@dataclass(frozen=True)
class Perception:
    """What the camera says in the image plane, before anything is lifted. ``depth_logits`` over the encoder's bins."""

    features: Tensor  # (B, N, C, h, w)
    depth_logits: Tensor  # (B, N, D, h, w)
    class_logits: Tensor  # (B, N, K, h, w)
    log_depth: Tensor  # (B, N, h, w)


class ImageTrunk(nn.Module):
    """Residual stages at strides 4, 8 and 16, merged upward to ``stride`` (4 or 8)."""

    def __init__(self, *, widths: list[int], outputs: int, stride: int) -> None:
        super().__init__()
        if stride not in (4, 8) or len(widths) != 4:
            raise ValueError(f"image trunk: stride must be 4 or 8 and widths four numbers, got {stride} and {widths}")
        stem, quarter, eighth, sixteenth = widths
        self.stem = ConvBlock(3, stem, stride=2)
        self.quarter = nn.Sequential(ConvBlock(stem, quarter, stride=2), ResidualBlock(quarter))
        self.eighth = nn.Sequential(ConvBlock(quarter, eighth, stride=2), ResidualBlock(eighth), ResidualBlock(eighth))
        deepest = [ConvBlock(eighth, sixteenth, stride=2), ResidualBlock(sixteenth), ResidualBlock(sixteenth)]
        self.sixteenth = nn.Sequential(*deepest)
        self.to_eighth = UpBlock(deep=sixteenth, shallow=eighth, outputs=outputs)
        self.to_quarter = UpBlock(deep=outputs, shallow=quarter, outputs=outputs) if stride == 4 else None

    def forward(self, images: Tensor) -> Tensor:
        """(B, 3, H, W), normalised, to (B, outputs, H / stride, W / stride)."""
        quarter = self.quarter(self.stem(images))
        eighth = self.eighth(quarter)
        merged = self.to_eighth(self.sixteenth(eighth), eighth)
        return merged if self.to_quarter is None else self.to_quarter(merged, quarter)


@beartype
class CameraEncoder(nn.Module):
    """Camera branch: ``forward(batch)`` gives (B, channels, Y, X) and the :class:`Perception` behind it.

    ``depth_source``: "learned"; "uniform" spreads over all bins (the floor); "lidar" uses the returns where there are
    any; "oracle" the exact depth (the ceiling).
    """

    def __init__(
        self,
        *,
        view: LiftSplat | PullLift,
        classes: list[str],
        channels: int = 32,
        widths: list[int] | tuple[int, ...] = (24, 48, 96, 144),
        features: int = 48,
        evidence: bool = True,
        depth_source: Literal["learned", "uniform", "lidar", "oracle"] = "learned",
        frozen: bool = False,
    ) -> None:
        super().__init__()
        self.view, self.classes, self.channels, self.evidence = view, len(classes), channels, evidence
        self.depth_source = depth_source
        self.trunk = ImageTrunk(widths=list(widths), outputs=features, stride=view.stride)
        count, bins = len(classes), view.bins.count
        self.dense = nn.Sequential(ConvBlock(features + 3, features), nn.Conv2d(features, bins + count + 1, 1))
        bias = self.dense[1].get_parameter("bias")
        nn.init.constant_(bias[bins:-1], -2.19)  # classes start at 0.1, as in the head
        nn.init.constant_(bias[-1:], 3.0)  # log of 20 m
        lifted = view.layers * (features + (count + 1) * evidence) + count * evidence
        self.reduce = ConvBlock(lifted, channels, kernel=1)
        self.refine = ConvBlock(channels, channels)
        self.freeze(frozen)

    def freeze(self, frozen: bool) -> None:
        """Stop (or resume) training what works in the image plane; the part after the lift keeps learning."""
        self.frozen = frozen
        for module in (self.trunk, self.dense):
            module.requires_grad_(not frozen)
        self.train(self.training)

    def train(self, mode: bool = True) -> "CameraEncoder":
        """As usual, but a frozen trunk keeps its batch statistics."""
        super().train(mode)
        if self.frozen:
            self.trunk.eval()
            self.dense.eval()
        return self

    def forward(self, batch: Batch) -> tuple[Tensor, Perception]:
        """(B, channels, Y, X) and what was seen in the image plane."""
        seen = self.perceive(batch)
        return self.lift(seen, batch), seen

    def perceive(self, batch: Batch) -> Perception:
        """The image plane only: all that the dense losses need."""
        images = batch.images.flatten(0, 1).to(memory_format=torch.channels_last)
        images = (images.float() - 115.0) / 65.0
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self.frozen):
            features = self.trunk(images)
            hints = self._ray_hints(batch, features.shape[-2:])
            dense = self.dense(torch.cat([features, hints.to(features.dtype)], dim=1)).float()
        features, dense = (x.unflatten(0, batch.images.shape[:2]) for x in (features, dense))
        depth, classes, log_depth = dense.split([self.view.bins.count, self.classes, 1], dim=2)
        return Perception(features, depth, classes, log_depth[:, :, 0])

    def _ray_hints(self, batch: Batch, size: torch.Size) -> Tensor:
        """Per cell (B * N, 3, h, w): the ray's bearing and slope in the ego frame, and where it would meet the ground.

        This is how the network knows its camera: the same pixel means another depth under another mount. The ground is
        only a hint (log of the depth where a ray meets z = 0); nothing assumes that it is flat.
        """
        with torch.autocast(batch.cam_K.device.type, enabled=False):
            rays = pixel_rays(batch.cam_K.float(), size[0], size[1], self.view.stride)
            rays = torch.einsum("bnij,bnhwj->bnhwi", batch.ego_T_cam[..., :3, :3].float(), rays)
            slope = rays[..., 2] / rays[..., :2].norm(dim=-1).clamp(min=1e-3)
            bearing = torch.atan2(rays[..., 1], rays[..., 0])
            height = batch.ego_T_cam[:, :, 2, 3].float()[..., None, None]
            ground = height.clamp(min=0.1) / (-rays[..., 2]).clamp(min=1e-3)
            ground = ground.clamp(self.view.bins.low, self.view.bins.high).log() - 3.0
            return torch.stack([bearing, slope * 4, ground], dim=2).flatten(0, 1)

    def lift(self, seen: Perception, batch: Batch) -> Tensor:
        """(B, channels, Y, X) from what was seen in the image plane."""
        probability, depth = self._depth(seen, batch)
        features = seen.features.permute(0, 1, 3, 4, 2).float()
        calibration = (batch.cam_K.float(), batch.ego_T_cam.float())
        if not self.evidence:
            return self.refine(self.reduce(self.view(features, probability, *calibration)))
        # Scores are evidence, not features: their meaning comes from the dense losses alone.
        scores = seen.class_logits.detach().permute(0, 1, 3, 4, 2).sigmoid()
        lifted = self.view(
            torch.cat([features, scores, torch.ones_like(scores[..., :1])], -1), probability, *calibration
        )
        placed = self._place(scores, depth, calibration, self.view.grid)
        # Joined with the channels last, as they lie in memory, and already in the convolutions' precision.
        parts = [x.permute(0, 2, 3, 1).to(seen.features.dtype) for x in (lifted, placed)]
        return self.refine(self.reduce(torch.cat(parts, dim=-1).permute(0, 3, 1, 2)))

    def _depth(self, seen: Perception, batch: Batch) -> tuple[Tensor, Tensor]:
        """Probabilities (B, N, h, w, D) and one depth a cell (B, N, h, w; 0: none), by ``depth_source``."""
        bins = self.view.bins
        learned = seen.depth_logits.permute(0, 1, 3, 4, 2).softmax(dim=-1)
        regressed = seen.log_depth.detach().clamp(max=6.0).exp()
        if self.depth_source == "learned":
            return learned, regressed
        if self.depth_source == "uniform":
            return torch.full_like(learned, 1 / bins.count), torch.zeros_like(regressed)
        known = batch.lidar_depth if self.depth_source == "lidar" else batch.dense_depth
        if known is None:
            raise ValueError("camera encoder: depth_source=oracle needs dense depth, which this data set does not have")
        index = bins.index(known)
        exact = (torch.arange(bins.count, device=index.device) == index[..., None]).float()
        if self.depth_source == "oracle":
            return exact, known
        return torch.where((index >= 0)[..., None], exact, learned), torch.where(known > 0, known, regressed)

    def _place(self, scores: Tensor, depth: Tensor, calibration: tuple[Tensor, Tensor], grid: BEVGrid) -> Tensor:
        """Class scores (B, N, h, w, K) summed into the one cell (B, K, Y, X) where each pixel's depth puts it."""
        with torch.no_grad():
            points = ego_points(depth[..., None], *calibration, self.view.stride)[..., 0, :2]
            cell, inside = flat_cells(points, grid)
            pixel = (inside & (depth > 0)).flatten().nonzero()[:, 0]
            cells = len(depth) * grid.shape[0] * grid.shape[1]
            index = SplatIndex.of(pixel, cell.flatten()[pixel], pixels=depth.numel(), cells=cells)
            return to_map(
                splat(scores.flatten(0, 3), torch.ones_like(pixel, dtype=scores.dtype), index), len(depth), grid
            )
