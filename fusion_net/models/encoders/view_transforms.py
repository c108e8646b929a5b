"""View transforms: image features and depth distributions to a bird's-eye view, as one sparse matrix product.

Lift-splat (Philion & Fidler 2020) places every pixel's feature at every depth along its ray, weighted by the depth's
probability, and sums what falls into a cell: a product with a sparse cells x pixels matrix (``splat``) whose entries are
probabilities.
"""

from collections.abc import Sequence

import torch
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.blocks.splat import SplatIndex, flat_cells, splat, to_map


def pixel_rays(cam_K: Tensor, height: int, width: int, stride: int) -> Tensor:
    """Camera-frame rays with z = 1 (B, N, h, w, 3) through the centres of stride x stride pixel cells."""
    v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    centers = torch.stack([(u + 0.5) * stride, (v + 0.5) * stride, torch.ones_like(u)], dim=-1).to(cam_K)
    return rotated(inverse(cam_K)[:, :, None, None], centers)


def inverse(matrix: Tensor) -> Tensor:
    """Of matrices (..., 3, 3), by way of double precision."""
    return torch.linalg.inv(matrix.double()).to(matrix)


def rotated(matrix: Tensor, vectors: Tensor) -> Tensor:
    """``matrix`` (..., 3, 3) times ``vectors`` (..., 3), term by term.

    The last bits of a matrix product depend on where its operands lie in memory, and a point near the edge of a cell would
    fall on either side of it: a resumed run would not be the unbroken one.
    """
    return _dot(matrix.unbind(-1), [component[..., None] for component in vectors.unbind(-1)])


def _dot(left: Sequence[Tensor] | Tensor, right: Sequence[Tensor] | Tensor) -> Tensor:
    return left[0] * right[0] + left[1] * right[1] + left[2] * right[2]


def ego_points(depth: Tensor, cam_K: Tensor, ego_T_cam: Tensor, stride: int) -> Tensor:
    """Ego points (B, N, h, w, D, 3) of pixel cells at depths broadcastable to (B, N, h, w, D), metres along z."""
    height, width = depth.shape[-3:-1]
    rays = rotated(ego_T_cam[:, :, None, None, :3, :3], pixel_rays(cam_K, height, width, stride))
    return depth[..., None] * rays[..., None, :] + ego_T_cam[:, :, None, None, None, :3, 3]


class ViewTransform(nn.Module):
    """What all view transforms have in common: the grid, the depth bins, and the geometry of the last calibration.

    The cache key is the calibration itself, to the last bit, so that a perturbed calibration never meets a stale geometry.
    """

    num_heights = 1  # height layers stacked in the channels of the map

    def __init__(self, *, grid: BEVGrid, bins: DepthBins, stride: int) -> None:
        super().__init__()
        self.grid, self.bins, self.stride = grid, bins, stride
        self._cached: tuple = (None, None)

    def _geometry(self, cam_K: Tensor, ego_T_cam: Tensor, size: tuple[int, int]) -> tuple:
        raise NotImplementedError

    def geometry(self, cam_K: Tensor, ego_T_cam: Tensor, size: torch.Size):
        """Which pixels contribute to which cells, for cameras (B, N) with (h, w) feature cells."""
        key = (cam_K.cpu().numpy().tobytes(), ego_T_cam.cpu().numpy().tobytes(), cam_K.shape[:2], size, cam_K.device)
        if self._cached[0] != key:
            with torch.no_grad(), torch.autocast(cam_K.device.type, enabled=False):
                self._cached = (key, self._geometry(cam_K.float(), ego_T_cam.float(), (size[0], size[1])))
        return self._cached[1]


@beartype
class LiftSplat(ViewTransform):
    """Forward projection: every pixel's feature goes to the BEV cells along its ray, at the centres of the depth bins."""

    def _geometry(self, cam_K: Tensor, ego_T_cam: Tensor, size: tuple[int, int]) -> tuple[SplatIndex, Tensor]:
        depth = self.bins.centers().to(cam_K).expand(*cam_K.shape[:2], *size, -1)
        cell, inside = flat_cells(ego_points(depth, cam_K, ego_T_cam, self.stride)[..., :2], self.grid)
        entry = inside.flatten().nonzero()[:, 0]
        rows, columns = self.grid.shape
        pixel = torch.div(entry, self.bins.count, rounding_mode="floor")
        cells = len(cam_K) * rows * columns
        index = SplatIndex.of(pixel, cell.flatten()[entry], pixels=depth[..., 0].numel(), cells=cells)
        return index, entry

    def forward(self, features: Tensor, probability: Tensor, cam_K: Tensor, ego_T_cam: Tensor) -> Tensor:
        """Features (B, N, h, w, C) and depth probabilities (B, N, h, w, D) to (B, C, Y, X)."""
        index, entry = self.geometry(cam_K, ego_T_cam, features.shape[2:4])
        weights = probability.flatten().index_select(0, entry)
        return to_map(splat(features.flatten(0, 3), weights, index), len(features), self.grid)


@beartype
class BackwardProjection(ViewTransform):
    """Depth-weighted backward projection: every BEV cell, at a few ``heights`` (metres), samples the image features where
    it projects to.

    The samples are bilinear, weighted by the probability, interpolated between bin centres, that the pixel's depth is
    that of the cell. No cell between two rays stays empty, and near cells gain nothing from the many rays that cross them.
    """

    points: Tensor  # (Y * X * heights, 3) ego metres

    def __init__(self, *, grid: BEVGrid, bins: DepthBins, stride: int, heights: list[float]) -> None:
        super().__init__(grid=grid, bins=bins, stride=stride)
        self.num_heights = len(heights)
        xy = grid.centers().float()
        points = [torch.cat([xy, torch.full_like(xy[..., :1], height)], dim=-1) for height in heights]
        self.register_buffer("points", torch.stack(points, dim=-2).reshape(-1, 3), persistent=False)

    def _geometry(
        self, cam_K: Tensor, ego_T_cam: Tensor, size: tuple[int, int]
    ) -> tuple[SplatIndex, tuple[Tensor, ...]]:
        (batch, cameras), (height, width), count = cam_K.shape[:2], size, self.bins.count
        rotation, origin = ego_T_cam[..., :3, :3], ego_T_cam[..., :3, 3]
        cam_R_ego = inverse(rotation)  # a general inverse: augmentation mirrors and scales
        projection = rotated(cam_K[:, :, None], cam_R_ego.mT).mT  # cam_K @ cam_R_ego
        # cam_K @ cam_R_ego @ (point - origin), with the points last so that the camera axes are contiguous planes
        axes = self.points.T.to(cam_K)
        image = _dot(projection[..., None].unbind(-2), axes) - rotated(projection, origin)[..., None]
        forward = cam_R_ego[:, :, 2, :, None].unbind(-2)  # the optical axis
        depth = _dot(forward, [axis - start for axis, start in zip(axes, origin[..., None].unbind(-2), strict=True)])
        column = image[:, :, 0] / depth / self.stride - 0.5
        row = image[:, :, 1] / depth / self.stride - 0.5
        position = self.bins.coordinate(depth) - 0.5  # in bins, between their centres
        visible = (column > -0.5) & (column < width - 0.5) & (row > -0.5) & (row < height - 0.5)
        visible = visible & (position >= -0.5) & (position < count - 0.5)  # NaN, behind the camera, compares false
        index = visible.flatten().nonzero()[:, 0]
        column, row, position = (value.flatten()[index] for value in (column, row, position))
        image_index = torch.div(index, len(self.points), rounding_mode="floor")
        cell = torch.div(image_index, cameras, rounding_mode="floor") * len(self.points) + index % len(self.points)

        left, top, near_bin = column.floor(), row.floor(), position.floor()
        dx, dy, between = column - left, row - top, position - near_bin
        bilinear = [(1 - dy) * (1 - dx), (1 - dy) * dx, dy * (1 - dx), dy * dx]
        columns = [(left + i).clamp(0, width - 1).int() for i in (0, 1)]
        rows = [(image_index * height + (top + i).clamp(0, height - 1)).int() * width for i in (0, 1)]
        pixel = torch.stack([r + c for r in rows for c in columns], dim=1)  # (V visible points, 4)
        splat_index = SplatIndex.of(
            pixel.flatten(),
            cell.int().repeat_interleave(4),
            pixels=batch * cameras * height * width,
            cells=batch * len(self.points),
        )
        near = pixel * count + near_bin.clamp(min=0).int()[:, None]  # index of the near bin's probability
        to_far = ((near_bin < count - 1) & (near_bin >= 0)).int()[:, None]  # 0: no bin beyond, take the same again
        return splat_index, (near, to_far, torch.stack(bilinear, dim=1), between[:, None])

    def forward(self, features: Tensor, probability: Tensor, cam_K: Tensor, ego_T_cam: Tensor) -> Tensor:
        """Features (B, N, h, w, C) and depth probabilities (B, N, h, w, D) to (B, heights * C, Y, X)."""
        index, (near, to_far, bilinear, between) = self.geometry(cam_K, ego_T_cam, features.shape[2:4])
        flat = probability.flatten()
        at_near, at_far = (flat.index_select(0, i.flatten()).view_as(bilinear) for i in (near, near + to_far))
        weights = bilinear * torch.lerp(at_near, at_far, between.expand_as(bilinear))
        cells = splat(features.flatten(0, 3), weights.flatten(), index)
        return to_map(cells.view(-1, self.num_heights * features.shape[-1]), len(features), self.grid)
