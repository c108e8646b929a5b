"""What one sensor alone has to say of a sample, from above, as Gaussians.

Boxes are a poor witness of a small turn of a camera. Where in a cell of the map an object is, the head guesses from what it
learned with sound sensors: turned by 1 degree, the camera's boxes follow by 0.4. Evidence does not pass through the map. A
camera's is the class scores of its image network, at the depth that it regresses, and goes wherever its calibration goes; what
it is compared with is the points on the objects that the other sensor finds alone. Both lie on the surface that faces the car,
so neither has to guess where the middle of an object is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor

from fusion_net.common.boxes import Boxes, points_in_box
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.models.encoders.image_network import ImageNetwork
from fusion_net.models.encoders.view_transforms import ego_points
from fusion_net.models.late.covariance import ray_covariance

Array = NDArray[np.float64]

SURE = 0.3
"""Class score from which a cell of the image is one of an object."""
CELL_SIGMA, DEPTH_ERROR = 0.5, 0.1
"""Standard deviations of such a cell's place: metres across its ray, and of its depth along it, as a share."""
POINTS_SIGMA = {"lidar": 0.2, "radar": 0.5}
"""Metres by which the middle of a sensor's points on an object may be off."""
NARROWEST = 0.2
"""Metres: the least standard deviation of a box's place, whatever the head says."""
LOWEST_SCORE = 0.1
"""Boxes of a lower score take no part; of those whose points are looked for, of twice that."""
MARGIN = 0.3
"""Metres around a box within which points are of its object; its foot, where the road's points lie, gets none."""


@dataclass(frozen=True)
class Heat:
    """One sensor's view of one sample: N Gaussians in the ego frame."""

    center: Array  # (N, 2) metres
    cov: Array  # (N, 2, 2) m^2
    label: NDArray[np.int64]  # (N,) class
    weight: Array  # (N,)

    def __len__(self) -> int:
        return len(self.center)

    @staticmethod
    def empty() -> "Heat":
        """Of a sensor that says nothing."""
        return Heat(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, np.int64), np.zeros(0))

    @staticmethod
    def join(parts: "Sequence[Heat]") -> "Heat":
        """All of several views of one sample."""
        every = (Heat.empty(), *parts)
        return Heat(**{f.name: np.concatenate([getattr(each, f.name) for each in every]) for f in fields(Heat)})


def box_heat(boxes: Boxes) -> Heat:
    """The boxes' centres, each as wide as the head says that it may be off, and as high as its score."""
    boxes = boxes[boxes.score >= LOWEST_SCORE]
    cov = np.maximum(np.exp(boxes.log_variance), NARROWEST**2)[:, :, None] * np.eye(2)
    return Heat(boxes.center[:, :2], cov, boxes.label, boxes.score)


def point_heat(boxes: Boxes, points: Tensor, *, sensor: str) -> Heat:
    """The middle of the points (P, 3+) on each object that the sensor finds alone (``boxes``). A radar's points have no height
    and count at that of the box."""
    boxes = boxes[boxes.score >= 2 * LOWEST_SCORE]
    places = points[:, :3].double().cpu().numpy()
    found: list[tuple[Array, int]] = []
    for k in range(len(boxes)):
        own = places.copy() if sensor == "radar" else places
        foot = boxes.center[k, 2] - boxes.wlh[k, 2] / 2 + MARGIN
        if sensor == "radar":
            own[:, 2] = foot
        inside = points_in_box(own, boxes.center[k], boxes.wlh[k], float(boxes.yaw[k]), MARGIN)
        inside &= own[:, 2] >= foot
        if inside.any():
            found.append((own[inside, :2].mean(axis=0), k))
    rows = np.array([k for _, k in found], np.int64)
    cov = np.tile(POINTS_SIGMA[sensor] ** 2 * np.eye(2), (len(rows), 1, 1))
    center = np.array([middle for middle, _ in found]).reshape(-1, 2)
    return Heat(center, cov, boxes.label[rows], boxes.score[rows])


@torch.inference_mode()
def camera_heat(network: ImageNetwork, batch: Batch) -> list[Heat]:
    """Of each sample the image cells that are of an object, at their regressed depth."""
    if not batch.images.numel():
        return [Heat.empty()] * batch.size
    found = network(batch)
    depth = found.log_depth.clamp(max=6.0).exp()
    places = ego_points(depth[..., None], batch.cam_K.float(), batch.ego_T_cam.float(), network.stride)[..., 0, :2]
    xy, lens = (each.double().cpu().numpy() for each in (places, batch.ego_T_cam[..., :2, 3]))
    scores, labels = (each.cpu().numpy() for each in found.class_logits.sigmoid().max(dim=2))
    return [
        Heat.join([_image_heat(*each) for each in zip(scores[b], labels[b], xy[b], lens[b], strict=True)])
        for b in range(batch.size)
    ]


def _image_heat(score: NDArray[np.float32], label: NDArray[np.int64], xy: Array, lens: Array) -> Heat:
    """Of one image of (h, w) cells at ``xy`` (h, w, 2). Cells of one class that hang together share the weight of one object:
    a bus nearby has a hundred cells, a cone two."""
    sure = score >= SURE
    share = np.zeros(score.shape)
    for k in np.unique(label[sure]):
        patch, _ = ndimage.label(sure & (label == k))
        share += np.where(patch > 0, 1 / np.bincount(patch.ravel())[patch], 0.0)
    away = xy[sure] - lens
    along = DEPTH_ERROR * np.linalg.norm(away, axis=1) + NARROWEST
    variance = np.stack([along, np.full(len(away), CELL_SIGMA)], axis=1) ** 2
    return Heat(xy[sure], ray_covariance(variance, away), label[sure], score[sure] * share[sure])


def heat_of_pairs(
    network: ImageNetwork | None, batch: Batch, alone: Mapping[str, Mapping[str, Boxes]]
) -> list[dict[tuple[str, str], tuple[Heat, Heat]]]:
    """Of each sample the views of each two sensors that are to lie on each other. ``alone``: by sensor and token the boxes that
    are found with it alone. A camera is compared by its evidence, LiDAR and radar by their boxes: what a radar gets back comes
    from deeper within a body than a laser's returns."""
    there = {name: batch.present[:, MODALITIES.index(name)].tolist() for name in alone}
    images = camera_heat(network, batch) if network is not None and "camera" in alone else []
    samples = []
    for b, token in enumerate(batch.tokens):
        boxes = {name: found[token] if there[name][b] else Boxes.empty() for name, found in alone.items()}
        views: dict[tuple[str, str], tuple[Heat, Heat]] = {}
        if "camera" in alone:
            image = images[b] if images and there["camera"][b] else Heat.empty()
            if "lidar" in alone:
                points = batch.lidar_points[batch.lidar_batch == b]
                views["camera", "lidar"] = (image, point_heat(boxes["lidar"], points, sensor="lidar"))
            if "radar" in alone:
                points = batch.radar_points[batch.radar_batch == b]
                views["camera", "radar"] = (image, point_heat(boxes["radar"], points, sensor="radar"))
        if "lidar" in alone and "radar" in alone:
            views["lidar", "radar"] = (box_heat(boxes["lidar"]), box_heat(boxes["radar"]))
        samples.append(views)
    return samples
