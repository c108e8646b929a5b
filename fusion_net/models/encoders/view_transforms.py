"""What view transforms have in common: rays through pixels, points on them, and the geometry of the last calibration.

A view transform takes image features and depth distributions to a bird's-eye view as a product with a sparse cells x pixels
matrix (``splat``). ``LiftSplat`` pushes pixels into cells, ``BackwardProjection`` lets cells sample pixels,
``PillarAttention`` lets them choose among their samples.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.blocks.depth_bins import DepthBins


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
    return dot(matrix.unbind(-1), [component[..., None] for component in vectors.unbind(-1)])


def dot(left: Sequence[Tensor] | Tensor, right: Sequence[Tensor] | Tensor) -> Tensor:
    """The sum of three products, term by term."""
    return left[0] * right[0] + left[1] * right[1] + left[2] * right[2]


def ego_points(depth: Tensor, cam_K: Tensor, ego_T_cam: Tensor, stride: int) -> Tensor:
    """Ego points (B, N, h, w, D, 3) of pixel cells at depths broadcastable to (B, N, h, w, D), metres along z."""
    height, width = depth.shape[-3:-1]
    rays = rotated(ego_T_cam[:, :, None, None, :3, :3], pixel_rays(cam_K, height, width, stride))
    return depth[..., None] * rays[..., None, :] + ego_T_cam[:, :, None, None, None, :3, 3]


class ViewTransform(nn.Module):
    """What all view transforms have in common: the grid, the depth bins, and the geometry of the last calibration.

    ``forward(features, probability, cam_K, ego_T_cam)`` takes features (B, N, h, w, L, C), those of a pixel in each of
    ``num_layers`` layers, and depth probabilities (B, N, h, w, D) to the sum over the layers, a map (B, C, Y, X). A map per
    layer under a 1x1 convolution would be the same (both are linear), but the features are projected where they are few:
    at the pixels, before the product. The cache key is the calibration itself, to the last bit, so that a perturbed
    calibration never meets a stale geometry.
    """

    num_layers = 1  # heights, or heads, that have features of their own

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
            # Not in inference mode: what was made in it could not serve a later backward pass with the same calibration.
            with torch.inference_mode(False), torch.no_grad(), torch.autocast(cam_K.device.type, enabled=False):
                self._cached = (key, self._geometry(cam_K.float(), ego_T_cam.float(), (size[0], size[1])))
        return self._cached[1]
