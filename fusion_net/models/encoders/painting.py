"""Points painted with what cameras see at their place (PointPainting, Vora et al. 2020, arXiv 1911.10150).

A point keeps its columns and gets the scores of the pixel that it falls on: it knows where it is and of what.
"""

import torch
import torch.nn.functional as F
from torch import Tensor

from fusion_net.models.encoders.view_transforms import rotated


def paint_points(
    points: Tensor,
    scores: Tensor,
    cam_K: Tensor,
    cam_T_ego: Tensor,
    *,
    sample: Tensor | None = None,
    alive: Tensor | None = None,
    stride: int = 1,
) -> Tensor:
    """Points (P, C + K + 1) from points (P, C): their own columns, K scores, and a flag, 1 where no camera sees the point.

    ``points``: x, y, z in metres first, the others as they are. ``scores`` (B, N, h, w, K): of cells of ``stride`` pixels of
    N cameras in B samples. ``cam_K`` (B, N, 3, 3): pinhole matrices in pixels; ``cam_T_ego`` (B, N, 4, 4): from the points'
    frame to each camera's (x right, y down, z forward), any affine motion. ``sample`` (P,): the sample of each point; None:
    all are of the first. ``alive`` (B, N): which cameras gave an image; None: all.

    A point is at u = f x / z + c of the image, in the cell of the pixel floor(u / stride), if z > 0 and the cell is in the
    image. Two cameras that see it: the mean of their scores. None: scores of 0. A point that is NaN is seen by none.

    Time: a point belongs into an image at the time at which *the image* was taken. What stands still comes out right if
    ``cam_T_ego`` holds the car's motion from the points' reference time to that of the image, as the inverse of
    ``Batch.ego_T_cam`` does for points that are at the reference time, as ``Batch.lidar_points`` are. What moves at v is
    painted with what the image shows v (t_image - t_point) beside it. ValueError where scores and matrices are of unequal
    numbers of samples or cameras.
    """
    if not cam_K.shape[:2] == cam_T_ego.shape[:2] == scores.shape[:2]:
        samples_and_cameras = ", ".join(str((*each.shape[:2],)) for each in (scores, cam_K, cam_T_ego))
        raise ValueError(f"scores, cam_K and cam_T_ego are of unequal samples and cameras: {samples_and_cameras}")
    sample = torch.zeros(len(points), dtype=torch.long, device=points.device) if sample is None else sample.long()
    cameras, height, width, channels = scores.shape[1:]
    # Beside the scores a column that counts the cameras, and below them a row of zeros for points that a camera does not see.
    table = F.pad(F.pad(scores, (0, 1), value=1.0).flatten(0, 3), (0, 0, 0, 1))
    matrices = _pixel_matrices(cam_K, cam_T_ego, stride).flatten(2)
    x, y, z = points[:, :3].to(matrices).unbind(dim=1)
    total = table.new_zeros(len(points), channels + 1)
    for n in range(cameras):
        of_point = matrices[:, n].index_select(0, sample).view(-1, 3, 4)
        u, v, depth = (a * x + b * y + c * z + d for a, b, c, d in (each.unbind(1) for each in of_point.unbind(1)))
        column, row = (u / depth).floor(), (v / depth).floor()
        seen = (depth > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        if alive is not None:
            seen = seen & alive[:, n].index_select(0, sample)
        row, column = (torch.where(seen, place, 0.0).long() for place in (row, column))
        cell = ((sample * cameras + n) * height + row) * width + column
        total = total + table.index_select(0, torch.where(seen, cell, len(table) - 1))
    views = total[:, -1:]
    painted = (total[:, :-1] / views.clamp(min=1), views == 0)
    return torch.cat([points, *(columns.to(points.dtype) for columns in painted)], dim=1)


def with_background(scores: Tensor) -> Tensor:
    """Class scores (..., K), each in [0, 1] by itself, and the probability that none of the classes is there: (..., K + 1)."""
    return torch.cat([scores, (1 - scores).prod(dim=-1, keepdim=True)], dim=-1)


def exact_scores(class_map: Tensor, classes: int) -> Tensor:
    """What perfect segmentation says of cells that show class (..., h, w), -1 for none: 0 and 1, (..., h, w, K + 1)."""
    return F.one_hot(torch.where(class_map >= 0, class_map, classes).long(), classes + 1).float()


def _pixel_matrices(cam_K: Tensor, cam_T_ego: Tensor, stride: int) -> Tensor:
    """(B, N, 3, 4) that take (x, y, z, 1) of the points' frame to (u, v, 1) * depth, u and v in cells of ``stride`` pixels."""
    matrices = rotated(cam_K[:, :, None], cam_T_ego[..., :3, :].mT).mT
    return matrices / matrices.new_tensor([stride, stride, 1.0])[:, None]
