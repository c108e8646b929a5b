"""The camera's verdict where another sensor measured something: class scores of the pixels that its points fall on.

The place comes from the LiDAR or the radar, the class from the image, and the camera's own depth, its weakest part, is not
asked (PointPainting, Vora et al. 2020, here as a map of the bird's-eye view instead of columns of the points).
"""

import torch
from torch import Tensor

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.models.blocks.splat import SparseRows, to_map
from fusion_net.models.encoders.view_transforms import inverse, rotated

RADAR_HEIGHTS = (0.5, 1.0, 1.5)
"""Metres above the ground at which a radar detection, whose elevation is not measured, is looked up in the image."""
_SENSORS = ("lidar", "radar")
_NEAREST = 0.1  # metres in front of the lens


def point_scores(scores: Tensor, batch: Batch, *, grid: BEVGrid, stride: int) -> Tensor:
    """Class scores (B, N, h, w, K) at ``stride`` to (B, 2 * (K + 1), Y, X): for LiDAR, then radar, the mean score over
    the points of a cell, and 1 if any of them is in an image. Zero in samples that lack the camera or that sensor."""
    rows = len(scores) * grid.shape[0] * grid.shape[1] * len(_SENSORS)
    row, pixel = _hits(batch, scores.shape[2:4], grid, stride, nowhere=rows)
    share = 1 / torch.bincount(row, minlength=rows + 1).to(scores).index_select(0, row)
    columns = torch.cat([scores, torch.ones_like(scores[..., :1])], dim=-1).flatten(0, 3)
    mean = SparseRows.of(row, pixel, rows=rows + 1).product(share, columns)[:-1]
    return to_map(mean.view(-1, len(_SENSORS) * columns.shape[1]), len(scores), grid)


@torch.no_grad()
def _hits(batch: Batch, size: torch.Size, grid: BEVGrid, stride: int, *, nowhere: int) -> tuple[Tensor, Tensor]:
    """Of every point of a present sensor in every image that shows it, the row of ``point_scores``' matrix (cell, sensor),
    ``nowhere`` off the grid, and the pixel, flat over the batch, of (h, w) feature cells."""
    camera = batch.present[:, MODALITIES.index("camera")]
    used = [(camera & batch.present[:, MODALITIES.index(name)]).tolist() for name in _SENSORS]
    points = [
        _by_sample(batch.lidar_points, batch.lidar_batch, batch.size),
        _by_sample(_raised(batch.radar_points), batch.radar_batch.repeat_interleave(len(RADAR_HEIGHTS)), batch.size),
    ]
    images = _projections(batch.cam_K.float(), batch.ego_T_cam.float(), stride)
    middle = (images.new_tensor([[size[1]], [size[0]]]) - 1) / 2  # of the columns and rows of cells
    nothing = batch.lidar_batch.new_zeros(0, dtype=torch.int32)
    hits, pixels = [nothing], [nothing]
    # Sample by sample: nothing of an absent sensor is so much as read, and what is worked on fits the cache.
    for b in range(batch.size):
        own = [points[i][b] if used[i][b] else points[i][b][:, :0] for i in range(len(_SENSORS))]
        xyz = torch.cat(own, dim=1)
        for n, (first, second, third, shift) in enumerate(images[b].mT[..., None]):
            image = first * xyz[0] + second * xyz[1] + third * xyz[2] + shift
            pixel = (image[:2] / image[2]).floor_()
            shown = (pixel - middle).abs_() <= middle
            index = (shown[0] & shown[1] & (image[2] > _NEAREST)).nonzero()[:, 0]
            row, column, inside = grid.rows_columns(xyz[:2].index_select(1, index).T)
            hit = ((b * grid.shape[0] + row) * grid.shape[1] + column) * len(_SENSORS)
            hit += index >= own[0].shape[1]  # the radar's come last
            hits.append(hit.masked_fill_(~inside, nowhere).int())
            column, row = pixel.index_select(1, index).int()
            pixels.append(((b * images.shape[1] + n) * size[0] + row) * size[1] + column)
    return torch.cat(hits), torch.cat(pixels)


def _by_sample(points: Tensor, sample: Tensor, size: int) -> tuple[Tensor, ...]:
    """Points (P, 3+) as x, y, z (3, P) of each sample."""
    if not (sample[1:] >= sample[:-1]).all():
        sample, order = torch.sort(sample, stable=True)
        points = points.index_select(0, order)
    return points[:, :3].float().T.contiguous().split(torch.bincount(sample, minlength=size).tolist(), dim=1)


def _raised(points: Tensor) -> Tensor:
    """Radar detections (R, 7) as ego points (3 R, 3), each at all RADAR_HEIGHTS."""
    raised = points[:, :3].repeat_interleave(len(RADAR_HEIGHTS), dim=0)
    raised[:, 2] = raised.new_tensor(RADAR_HEIGHTS).repeat(len(points))
    return raised


def _projections(cam_K: Tensor, ego_T_cam: Tensor, stride: int) -> Tensor:
    """(B, N, 3, 4) that take ego points to (u, v, 1) * depth, u and v in feature cells."""
    cam_R_ego = inverse(ego_T_cam[..., :3, :3])  # a general inverse: augmentation mirrors and scales
    linear = rotated(cam_K[:, :, None], cam_R_ego.mT).mT / cam_K.new_tensor([stride, stride, 1.0])[:, None]
    return torch.cat([linear, -rotated(linear, ego_T_cam[..., :3, 3])[..., None]], dim=-1)
