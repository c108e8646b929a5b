"""Images to dense predictions in the image plane: a residual backbone with a feature pyramid, and one dense head.

Depth distribution, class scores and log-depth have dense losses of their own; those are what lets a camera branch of this
size learn in minutes.
"""

import torch
from beartype import beartype
from torch import Tensor, nn

from fusion_net.data.batch import Batch
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.blocks.layers import PRIOR_LOGIT, ConvBlock, ResidualBlock, UpBlock
from fusion_net.models.blocks.outputs import ImagePredictions
from fusion_net.models.encoders.view_transforms import pixel_rays

_PIXEL_MEAN, _PIXEL_STD = 115.0, 65.0
_INITIAL_LOG_DEPTH = 3.0  # 20 m
_KEPT_BYTES = 2**31
"""Of features of a frozen backbone: 46,000 keyframes of the `nano` rig."""


class ImageBackbone(nn.Module):
    """Residual stages at strides 4, 8 and 16, and a top-down neck that merges them at ``stride`` (4 or 8)."""

    def __init__(self, *, widths: list[int], outputs: int, stride: int) -> None:
        super().__init__()
        if stride not in (4, 8) or len(widths) != 4:
            raise ValueError(
                f"image backbone: stride must be 4 or 8 and widths four numbers, got {stride} and {widths}"
            )
        stem, quarter, eighth, sixteenth = widths
        self.stem = ConvBlock(3, stem, stride=2)
        self.quarter = nn.Sequential(ConvBlock(stem, quarter, stride=2), ResidualBlock(quarter))
        self.eighth = nn.Sequential(ConvBlock(quarter, eighth, stride=2), ResidualBlock(eighth), ResidualBlock(eighth))
        deepest = [ConvBlock(eighth, sixteenth, stride=2), ResidualBlock(sixteenth), ResidualBlock(sixteenth)]
        self.sixteenth = nn.Sequential(*deepest)
        self.to_eighth = UpBlock(deep=sixteenth, shallow=eighth, outputs=outputs)
        self.to_quarter = UpBlock(deep=outputs, shallow=quarter, outputs=outputs) if stride == 4 else None

    def forward(self, images: Tensor) -> Tensor:
        """(B, 3, H, W), normalized, to (B, outputs, H / stride, W / stride)."""
        quarter = self.quarter(self.stem(images))
        eighth = self.eighth(quarter)
        merged = self.to_eighth(self.sixteenth(eighth), eighth)
        return merged if self.to_quarter is None else self.to_quarter(merged, quarter)


@beartype
class ImageNetwork(nn.Module):
    """``forward(batch)`` gives :class:`ImagePredictions` at ``stride``, with depth over ``bins``; it can be frozen."""

    def __init__(self, *, classes: list[str], bins: DepthBins, stride: int, widths: list[int], features: int) -> None:
        super().__init__()
        self.classes, self.bins, self.stride, self.features = len(classes), bins, stride, features
        self.backbone = ImageBackbone(widths=widths, outputs=features, stride=stride)
        outputs = bins.count + self.classes + 1
        self.dense_head = nn.Sequential(ConvBlock(features + 3, features), nn.Conv2d(features, outputs, 1))
        bias = self.dense_head[1].get_parameter("bias")
        nn.init.constant_(bias[bins.count : -1], PRIOR_LOGIT)
        nn.init.constant_(bias[-1:], _INITIAL_LOG_DEPTH)
        self.frozen = False
        self._kept: dict[str, Tensor] = {}  # features by sample token, while the backbone is frozen

    def freeze(self, frozen: bool) -> None:
        """Stop (or resume) training: no gradients, and batch norms use and keep their running statistics."""
        self.frozen = frozen
        self._kept = {}
        self.requires_grad_(not frozen)
        self.train(self.training)

    def train(self, mode: bool = True) -> "ImageNetwork":
        """As usual, but a frozen network stays in evaluation mode."""
        super().train(mode)
        for module in self.children():
            module.train(mode and not self.frozen)
        return self

    def forward(self, batch: Batch) -> ImagePredictions:
        """Predictions for every image of the batch."""
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self.frozen):
            # Frozen in training, a sample's features are always the same: the augmentations change the rays alone.
            is_kept = self.frozen and self.training
            features = self._kept_features(batch) if is_kept else self.backbone(normalized(batch.images, batch.colors))
            rays = self._ray_encoding(batch, features.shape[-2:]).to(features.dtype)
            dense = self.dense_head(torch.cat([features, rays], dim=1)).float()
        features, dense = (x.unflatten(0, batch.images.shape[:2]) for x in (features, dense))
        depth, classes, log_depth = dense.split([self.bins.count, self.classes, 1], dim=2)
        return ImagePredictions(features, depth, classes, log_depth[:, :, 0])

    def _kept_features(self, batch: Batch) -> Tensor:
        """The backbone's features (B * N, C, h, w) of the images as they are, computed when a sample is first seen.

        Then for the whole batch: the last bits depend on the batch's size, and a resumed run has other samples left to see.
        """
        if not all(token in self._kept for token in batch.tokens):
            features = self.backbone(normalized(batch.images))
            each = features.unflatten(0, batch.images.shape[:2])
            if len(self._kept) * each[0].numel() * each.element_size() <= _KEPT_BYTES:
                self._kept |= {token: value.clone() for token, value in zip(batch.tokens, each, strict=True)}
            return features
        kept = torch.cat([self._kept[token] for token in batch.tokens])
        return kept.contiguous(memory_format=torch.channels_last)

    def _ray_encoding(self, batch: Batch, size: torch.Size) -> Tensor:
        """Each feature cell's ray (B * N, 3, h, w): azimuth and slope in the ego frame, and log-depth at the ground.

        This makes the network aware of its camera: the same pixel means another depth under another mounting. The depth
        at which a ray meets z = 0 is only an input; nothing assumes that the ground is flat.
        """
        with torch.autocast(batch.cam_K.device.type, enabled=False):
            rays = pixel_rays(batch.cam_K.float(), size[0], size[1], self.stride)
            rays = torch.einsum("bnij,bnhwj->bnhwi", batch.ego_T_cam[..., :3, :3].float(), rays)
            slope = rays[..., 2] / rays[..., :2].norm(dim=-1).clamp(min=1e-3)
            azimuth = torch.atan2(rays[..., 1], rays[..., 0])
            height = batch.ego_T_cam[:, :, 2, 3].float()[..., None, None]
            ground = height.clamp(min=0.1) / (-rays[..., 2]).clamp(min=1e-3)
            ground = ground.clamp(self.bins.low, self.bins.high).log() - _INITIAL_LOG_DEPTH
            return torch.stack([azimuth, slope * 4, ground], dim=2).flatten(0, 1)


def normalized(images: Tensor, colors: Tensor | None = None) -> Tensor:
    """Images (B, N, 3, H, W) in 0..255, put through the colour matrices (B, 3, 4), as the backbone takes them:
    (B * N, 3, H, W), of mean 0 and deviation 1."""
    flat = images.flatten(0, 1).float()
    if colors is not None:
        each = colors.repeat_interleave(images.shape[1], dim=0)
        with torch.autocast(flat.device.type, enabled=False):
            flat = torch.baddbmm(each[:, :, 3:], each[:, :, :3], flat.flatten(2)).clamp(0, 255).view_as(flat)
    return ((flat - _PIXEL_MEAN) / _PIXEL_STD).contiguous(memory_format=torch.channels_last)
