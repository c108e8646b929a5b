"""What the camera sees, placed on the ground by the calibration alone: its class scores at its depths, before anything learned
works on the bird's-eye view.

A detector that was trained with one mount has learned where on the ground what it sees at a place in the image belongs: when
the calibration turns, its boxes follow by half, these points wholly.
"""

from collections.abc import Iterable

import numpy as np
import torch

from fusion_net.common.boxes import Boxes
from fusion_net.data.batch import Batch
from fusion_net.models.encoders.camera_encoder import CameraEncoder
from fusion_net.models.encoders.view_transforms import ego_points

LOWEST_SCORE = 0.3
"""Cells whose likeliest class has a lower score are left out."""
DEPTH_ERROR = 0.1
"""Standard deviation along the ray, as a share of the depth."""


@torch.inference_mode()
def lifted_cells(camera: CameraEncoder, batches: Iterable[Batch]) -> dict[str, Boxes]:
    """By sample, every image cell that shows an object as a box without size in the ego frame: where the object's surface is,
    with its likeliest class and that one's score. Cells without a depth are left out."""
    found: dict[str, Boxes] = {}
    stride = camera.view_transform.stride
    for batch in batches:
        predictions = camera.perceive(batch)
        depth = camera.depth(predictions, batch)[1].float()
        calibration = (batch.cam_K.float(), batch.ego_T_cam.float())
        points = ego_points(depth[..., None], *calibration, stride)[..., 0, :].double()
        score, label = predictions.class_logits.float().sigmoid().max(dim=2)
        ray = points[..., :2] - batch.ego_T_cam[:, :, None, None, :2, 3].double()
        reach = ray.norm(dim=-1, keepdim=True).clamp(min=1e-6)
        along = (DEPTH_ERROR * ray).square()
        across = (ray.flip(-1) * stride / batch.cam_K[:, :, 0, 0, None, None, None] / 12**0.5).square()
        variance = (along + across).clamp(min=1e-4)
        kept = (score >= LOWEST_SCORE) & (depth > 0) & (reach[..., 0] > 1)
        for place, token in enumerate(batch.tokens):
            own = kept[place]
            n = int(own.sum())
            found[token] = Boxes(
                center=points[place][own].cpu().numpy(),
                wlh=np.zeros((n, 3)),
                yaw=np.zeros(n),
                velocity=np.zeros((n, 2)),
                label=label[place][own].cpu().numpy(),
                score=score[place][own].double().cpu().numpy(),
                log_variance=variance[place][own].log().cpu().numpy(),
            )
    return found
