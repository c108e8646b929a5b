"""From image features and depth distributions to a bird's-eye view, as one sparse product.

Lift-splat (Philion & Fidler 2020) places every pixel's feature at every depth along its ray, weighted by the depth's
probability, and sums what falls into a cell. That is ``bev = S @ features`` with a sparse cells x pixels matrix S whose
entries are probabilities: the outer product pixels x depths x channels never has to exist. ``embedding_bag`` is that
product; its gradient to the features is the transposed one, its gradient to the entries a dot product each.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.depth_bins import DepthBins


@dataclass(frozen=True)
class Walk:
    """The entries of S in the order of their rows (or columns). ``order`` is None where they are stored in that order."""

    order: Tensor | None  # (E,)
    other: Tensor  # (E,) int32: in this order, the pixel of each entry of a cell (or the cell of each of a pixel)
    starts: Tensor  # (cells,) or (pixels,) int32: where each one's entries begin

    @staticmethod
    def along(key: Tensor, other: Tensor, count: int) -> "Walk":
        """By ascending ``key`` in [0, count)."""
        order = None
        if not (key[1:] >= key[:-1]).all():
            key, order = torch.sort(key, stable=True)
            other = other.index_select(0, order)
        many = torch.bincount(key, minlength=count)
        return Walk(order, other, (many.cumsum(0) - many).int())

    def product(self, table: Tensor, weights: Tensor) -> Tensor:
        """For each row of S the weighted sum of the rows of ``table`` that it names."""
        if not len(self.other):
            return table.new_zeros(len(self.starts), table.shape[1])
        weights = weights if self.order is None else weights.index_select(0, self.order)
        return F.embedding_bag(self.other, table, self.starts, mode="sum", per_sample_weights=weights)


@dataclass(frozen=True)
class SplatIndex:
    """The pattern of S: entry e joins pixel ``pixel[e]`` to cell ``cell[e]``; ``forward`` and ``backward`` walk it."""

    pixel: Tensor  # (E,) int32
    cell: Tensor  # (E,) int32
    forward: Walk
    backward: Walk

    @staticmethod
    def of(pixel: Tensor, cell: Tensor, *, pixels: int, cells: int) -> "SplatIndex":
        """From the two ends of each entry, integers (E,) in any order; E may be 0."""
        pixel, cell = pixel.int(), cell.int()
        return SplatIndex(pixel, cell, Walk.along(cell, pixel, cells), Walk.along(pixel, cell, pixels))


class _Splat(torch.autograd.Function):
    @staticmethod
    def forward(ctx, features: Tensor, weights: Tensor, index: SplatIndex) -> Tensor:
        ctx.save_for_backward(features, weights)
        ctx.index = index
        return index.forward.product(features, weights)

    @staticmethod
    def backward(ctx, *grads: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        features, weights = ctx.saved_tensors
        index, grad = ctx.index, grads[0].contiguous()
        grad_features = grad_weights = None
        if ctx.needs_input_grad[0]:
            grad_features = index.backward.product(grad, weights)
        if ctx.needs_input_grad[1]:
            # d bev / d weight is the feature: a dot product an entry. Our pixels play the operator's bags and the
            # gradient of the view its table, so that push's entries, stored by pixel, are walked in memory's order.
            none = index.pixel.new_empty(0)
            dots = torch.ops.aten._embedding_bag_per_sample_weights_backward
            grad_weights = dots(features, grad, index.cell, none, index.pixel, 0)
        return grad_features, grad_weights, None


def splat(features: Tensor, weights: Tensor, index: SplatIndex) -> Tensor:
    """Sum over the entries of each cell of weight x feature: (P, C) and (E,) to (cells, C), in float32 or float64.

    Sums of hundreds of entries lose too much in bfloat16, so autocast ends here.
    """
    dtype = torch.promote_types(features.dtype, torch.float32)
    with torch.autocast(features.device.type, enabled=False):
        return _Splat.apply(features.contiguous().to(dtype), weights.contiguous().to(dtype), index)


def pixel_rays(cam_K: Tensor, height: int, width: int, stride: int) -> Tensor:
    """Camera-frame rays with z = 1 (B, N, h, w, 3) through the centres of stride x stride pixel cells."""
    v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    centers = torch.stack([(u + 0.5) * stride, (v + 0.5) * stride, torch.ones_like(u)], dim=-1).to(cam_K)
    return torch.einsum("bnij,hwj->bnhwi", torch.linalg.inv(cam_K), centers)


def ego_points(depth: Tensor, cam_K: Tensor, ego_T_cam: Tensor, stride: int) -> Tensor:
    """Ego points (B, N, h, w, D, 3) of pixel cells at depths broadcastable to (B, N, h, w, D), metres along z."""
    height, width = depth.shape[-3:-1]
    rays = torch.einsum("bnij,bnhwj->bnhwi", ego_T_cam[..., :3, :3], pixel_rays(cam_K, height, width, stride))
    return depth[..., None] * rays[..., None, :] + ego_T_cam[:, :, None, None, None, :3, 3]


def flat_cells(xy: Tensor, grid: BEVGrid) -> tuple[Tensor, Tensor]:
    """Cell numbers of ego points (B, ..., 2) in the batch's maps, b * Y * X + row * X + column, and an inside mask."""
    row, column, inside = grid.rows_columns(xy)
    sample = torch.arange(len(xy), device=xy.device).view(-1, *[1] * (row.dim() - 1))
    return (sample * grid.shape[0] + row) * grid.shape[1] + column, inside


def to_map(cells: Tensor, batch: int, grid: BEVGrid) -> Tensor:
    """(B * Y * X, C) to (B, C, Y, X), without a copy: the memory already is in channels_last order."""
    return cells.view(batch, *grid.shape, -1).permute(0, 3, 1, 2)


class _View(nn.Module):
    """What both view transforms share: the grid, the bins, and one remembered geometry.

    The key is the calibration itself, to the last bit, so that a perturbed calibration never meets a stale geometry.
    """

    layers = 1

    def __init__(self, *, grid: BEVGrid, bins: DepthBins, stride: int) -> None:
        super().__init__()
        self.grid, self.bins, self.stride = grid, bins, stride
        self._remembered: tuple = (None, None)

    def _geometry(self, cam_K: Tensor, ego_T_cam: Tensor, size: tuple[int, int]) -> tuple:
        raise NotImplementedError

    def geometry(self, cam_K: Tensor, ego_T_cam: Tensor, size: torch.Size):
        """Which pixels feed which cells for cameras (B, N) with (h, w) feature cells."""
        key = (cam_K.cpu().numpy().tobytes(), ego_T_cam.cpu().numpy().tobytes(), cam_K.shape[:2], size, cam_K.device)
        if self._remembered[0] != key:
            with torch.no_grad(), torch.autocast(cam_K.device.type, enabled=False):
                self._remembered = (key, self._geometry(cam_K.float(), ego_T_cam.float(), (size[0], size[1])))
        return self._remembered[1]


@beartype
class LiftSplat(_View):
    """Push: every pixel cell gives its feature to the BEV cells along its ray, at the centres of the depth bins."""

    def __init__(self, *, grid: BEVGrid, bins: DepthBins, stride: int = 8) -> None:
        super().__init__(grid=grid, bins=bins, stride=stride)

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
class PullLift(_View):
    """Pull: every BEV cell, at a few heights, takes the features of the pixels where it is seen.

    They are weighted bilinearly and by the probability, interpolated between bin centres, that the pixel's depth is the
    cell's. No cell between two rays stays empty, and the near cells do not win by the number of rays that cross them.
    """

    points: Tensor  # (Y * X * heights, 3) ego metres

    def __init__(
        self,
        *,
        grid: BEVGrid,
        bins: DepthBins,
        stride: int = 8,
        heights: tuple[float, ...] | list[float] = (0.4, 1.1, 2.0),
    ) -> None:
        super().__init__(grid=grid, bins=bins, stride=stride)
        self.layers = len(heights)
        xy = grid.centers().float()
        points = [torch.cat([xy, torch.full_like(xy[..., :1], height)], dim=-1) for height in heights]
        self.register_buffer("points", torch.stack(points, dim=-2).reshape(-1, 3), persistent=False)

    def _geometry(
        self, cam_K: Tensor, ego_T_cam: Tensor, size: tuple[int, int]
    ) -> tuple[SplatIndex, tuple[Tensor, ...]]:
        (batch, cameras), (height, width), count = cam_K.shape[:2], size, self.bins.count
        rotation, origin = ego_T_cam[..., :3, :3], ego_T_cam[..., :3, 3]
        # cam_K @ cam_R_ego @ (point - origin), with the points last so that the camera axes are contiguous planes
        cam_R_ego = torch.linalg.inv(rotation)  # augmentation mirrors and scales, so it is no mere rotation
        projection = cam_K @ cam_R_ego
        offset = torch.einsum("bnij,bnj->bni", projection, origin)
        image = torch.einsum("bnij,pj->bnip", projection, self.points.to(cam_K)) - offset[..., None]
        depth = (cam_R_ego[..., 2, :] @ self.points.T.to(cam_K)) - (cam_R_ego[..., 2, :] * origin).sum(-1, keepdim=True)
        column = image[:, :, 0] / depth / self.stride - 0.5
        row = image[:, :, 1] / depth / self.stride - 0.5
        plane = self.bins.coordinate(depth) - 0.5
        seen = (column > -0.5) & (column < width - 0.5) & (row > -0.5) & (row < height - 0.5)
        seen = seen & (plane >= -0.5) & (plane < count - 0.5)  # NaN, behind the camera, compares false
        where = seen.flatten().nonzero()[:, 0]
        column, row, plane = (value.flatten()[where] for value in (column, row, plane))
        view = torch.div(where, len(self.points), rounding_mode="floor")
        cell = torch.div(view, cameras, rounding_mode="floor") * len(self.points) + where % len(self.points)

        left, top, near = column.floor(), row.floor(), plane.floor()
        right, low, far = column - left, row - top, plane - near
        corners = [(1 - low) * (1 - right), (1 - low) * right, low * (1 - right), low * right]
        columns = [(left + i).clamp(0, width - 1).int() for i in (0, 1)]
        rows = [(view * height + (top + i).clamp(0, height - 1)).int() * width for i in (0, 1)]
        pixel = torch.stack([r + c for r in rows for c in columns], dim=1)  # (seen, 4)
        index = SplatIndex.of(
            pixel.flatten(),
            cell.int().repeat_interleave(4),
            pixels=batch * cameras * height * width,
            cells=batch * len(self.points),
        )
        first = pixel * count + near.clamp(min=0).int()[:, None]
        beyond = (near < count - 1) & (near >= 0)
        return index, (first, beyond.int()[:, None], torch.stack(corners, dim=1), far[:, None])

    def forward(self, features: Tensor, probability: Tensor, cam_K: Tensor, ego_T_cam: Tensor) -> Tensor:
        """Features (B, N, h, w, C) and depth probabilities (B, N, h, w, D) to (B, heights * C, Y, X)."""
        index, (near, step, corner, far) = self.geometry(cam_K, ego_T_cam, features.shape[2:4])
        flat = probability.flatten()
        near_share, far_share = (flat.index_select(0, i.flatten()).view_as(corner) for i in (near, near + step))
        weights = corner * torch.lerp(near_share, far_share, far.expand_as(corner))
        cells = splat(features.flatten(0, 3), weights.flatten(), index)
        return to_map(cells.view(-1, self.layers * features.shape[-1]), len(features), self.grid)
