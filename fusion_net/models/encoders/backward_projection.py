"""Backward projection: every BEV cell looks into the images for what stands on it."""

from dataclasses import dataclass, replace

import torch
from beartype import beartype
from torch import Tensor

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.blocks.splat import SplatIndex, splat, to_map
from fusion_net.models.encoders.view_transforms import ViewTransform, dot, inverse, rotated


@dataclass(frozen=True)
class Samples:
    """V visible points, each in one image: the four pixels around its projection and the two depth bins around its depth."""

    point: Tensor  # (V,) int32: b * points + point
    pixel: Tensor  # (V, 4) int32, flat over the batch
    bilinear: Tensor  # (V, 4) shares of the pixels
    near: Tensor  # (V, 4) index of each pixel's probability of the nearer bin
    far: Tensor  # (V, 4) and of the farther
    between: Tensor  # (V, 1) share of the farther

    def depth_weights(self, probability: Tensor) -> Tensor:
        """The shares (V, 4) times the probability (B, N, h, w, D) that the pixel's depth is the point's."""
        flat = probability.flatten()
        near, far = (flat.index_select(0, i.flatten()).view_as(self.bilinear) for i in (self.near, self.far))
        return self.bilinear * torch.lerp(near, far, self.between.expand_as(self.bilinear))


@beartype
class BackwardProjection(ViewTransform):
    """Depth-weighted backward projection: every BEV cell, at a few ``heights`` (metres), samples the image features where
    it projects to.

    The samples are bilinear and, ``depth_weighted``, weighted by the probability, interpolated between bin centres, that the
    pixel's depth is that of the cell. No cell between two rays stays empty, and near cells gain nothing from the many rays
    that cross them. Without the weights a feature is smeared along its whole ray, and a cell has the mean over the cameras
    that see it (Simple-BEV, Harley et al. 2023).
    """

    points: Tensor  # (Y * X * heights, 3) ego metres

    def __init__(
        self, *, grid: BEVGrid, bins: DepthBins, stride: int, heights: list[float], depth_weighted: bool = True
    ) -> None:
        super().__init__(grid=grid, bins=bins, stride=stride)
        if not heights:
            raise ValueError("heights=[]: a cell is seen at one height at least; write heights=[1.0]")
        self.num_layers, self.depth_weighted = len(heights), depth_weighted
        xy = grid.centers().float()
        points = [torch.cat([xy, torch.full_like(xy[..., :1], height)], dim=-1) for height in heights]
        self.register_buffer("points", torch.stack(points, dim=-2).reshape(-1, 3), persistent=False)

    def _geometry(self, cam_K: Tensor, ego_T_cam: Tensor, size: tuple[int, int]) -> tuple:
        samples = self._samples(cam_K, ego_T_cam, size)
        height = samples.point % self.num_layers
        index = SplatIndex.of(
            (samples.pixel * self.num_layers + height[:, None]).flatten(),
            torch.div(samples.point, self.num_layers, rounding_mode="floor").repeat_interleave(4),
            pixels=cam_K.shape[0] * cam_K.shape[1] * size[0] * size[1] * self.num_layers,
            cells=len(cam_K) * len(self.points) // self.num_layers,
        )
        if self.depth_weighted:
            return index, samples
        views = torch.bincount(samples.point, minlength=len(cam_K) * len(self.points)).index_select(0, samples.point)
        return index, replace(samples, bilinear=samples.bilinear / views[:, None])

    def _samples(self, cam_K: Tensor, ego_T_cam: Tensor, size: tuple[int, int]) -> Samples:
        """Every visible point in every image that shows it."""
        cameras, (height, width), count = cam_K.shape[1], size, self.bins.count
        rotation, origin = ego_T_cam[..., :3, :3], ego_T_cam[..., :3, 3]
        cam_R_ego = inverse(rotation)  # a general inverse: augmentation mirrors and scales
        projection = rotated(cam_K[:, :, None], cam_R_ego.mT).mT  # cam_K @ cam_R_ego
        # cam_K @ cam_R_ego @ (point - origin), with the points last so that the camera axes are contiguous planes
        axes = self.points.T.to(cam_K)
        image = dot(projection[..., None].unbind(-2), axes) - rotated(projection, origin)[..., None]
        forward = cam_R_ego[:, :, 2, :, None].unbind(-2)  # the optical axis
        depth = dot(forward, [axis - start for axis, start in zip(axes, origin[..., None].unbind(-2), strict=True)])
        column = image[:, :, 0] / depth / self.stride - 0.5
        row = image[:, :, 1] / depth / self.stride - 0.5
        position = self.bins.coordinate(depth) - 0.5  # in bins, between their centres
        visible = (column > -0.5) & (column < width - 0.5) & (row > -0.5) & (row < height - 0.5)
        visible = visible & (position >= -0.5) & (position < count - 0.5)  # NaN, behind the camera, compares false
        index = visible.flatten().nonzero()[:, 0]
        column, row, position = (value.flatten()[index] for value in (column, row, position))
        image_index = torch.div(index, len(self.points), rounding_mode="floor")
        point = torch.div(image_index, cameras, rounding_mode="floor") * len(self.points) + index % len(self.points)

        left, top, near_bin = column.floor(), row.floor(), position.floor()
        dx, dy, between = column - left, row - top, position - near_bin
        bilinear = [(1 - dy) * (1 - dx), (1 - dy) * dx, dy * (1 - dx), dy * dx]
        columns = [(left + i).clamp(0, width - 1).int() for i in (0, 1)]
        rows = [(image_index * height + (top + i).clamp(0, height - 1)).int() * width for i in (0, 1)]
        pixel = torch.stack([r + c for r in rows for c in columns], dim=1)  # (V visible points, 4)
        near = pixel * count + near_bin.clamp(min=0).int()[:, None]  # index of the near bin's probability
        to_far = ((near_bin < count - 1) & (near_bin >= 0)).int()[:, None]  # 0: no bin beyond, take the same again
        return Samples(point.int(), pixel, torch.stack(bilinear, dim=1), near, near + to_far, between[:, None])

    def forward(self, features: Tensor, probability: Tensor, cam_K: Tensor, ego_T_cam: Tensor) -> Tensor:
        """Features (B, N, h, w, heights, C) and depth probabilities (B, N, h, w, D) to (B, C, Y, X)."""
        index, samples = self.geometry(cam_K, ego_T_cam, features.shape[2:4])
        weights = samples.depth_weights(probability) if self.depth_weighted else samples.bilinear
        return to_map(splat(features.flatten(0, 4), weights.flatten(), index), len(features), self.grid)
