"""A second look at test time: the scene mirrored left to right, as in training, and the mean of both answers.

What a network sees in a scene and in its mirror image errs in part independently, so the mean errs less (test-time
augmentation; CenterPoint, Yin et al. 2021, has it as "double flip").
"""

from dataclasses import replace

import torch
from torch import Tensor

from fusion_net.data.batch import Batch
from fusion_net.models.blocks.heading import axis_of, is_forwards, yaw_of

SIDEWAYS = {"offset": 1, "velocity": 1, "rot": 0}
"""Channel of each map that changes its sign in the mirror: along y, or the sine of yaw."""


def mirrored(batch: Batch) -> Batch:
    """The batch with y of the ego frame turned round. Images stay as they are: it is their ``ego_T_cam`` that is mirrored, so
    that every pixel lands on the mirrored place. Targets are left out."""
    lidar, radar = batch.lidar_points.clone(), batch.radar_points.clone()
    lidar[:, 1] *= -1
    radar[:, [1, 5]] *= -1  # y, vy
    mirror = torch.diag(batch.ego_T_cam.new_tensor([1.0, -1.0, 1.0, 1.0]))
    return replace(
        batch, lidar_points=lidar, radar_points=radar, ego_T_cam=mirror @ batch.ego_T_cam, targets=None, boxes=()
    )


def mirrored_maps(maps: dict[str, Tensor]) -> dict[str, Tensor]:
    """The head's maps (B, C, Y, X), of a grid as wide to the left as to the right, in the mirror."""
    turned = {name: values.flip(2) for name, values in maps.items()}
    for name in SIDEWAYS.keys() & turned.keys():
        turned[name][:, SIDEWAYS[name]] *= -1
    if "axis" in turned:
        yaw = -yaw_of(turned["axis"].movedim(1, -1), turned["direction"][:, 0])
        rot = torch.stack([yaw.sin(), yaw.cos()], dim=-1)
        length = turned["axis"].norm(dim=1, keepdim=True)
        turned["axis"] = axis_of(rot).movedim(-1, 1) * length
        turned["direction"] = turned["direction"].abs() * torch.where(is_forwards(rot), 1.0, -1.0)[:, None]
    return turned


def mean_maps(one: dict[str, Tensor], other: dict[str, Tensor]) -> dict[str, Tensor]:
    """The mean of two answers: of the heat maps' logits, of metres and of logarithms. Of two headings (sin, cos) that point
    away from each other the longer, surer one: their mean would point nowhere."""
    mean = {name: (one[name] + other[name]) / 2 for name in one}
    if "rot" in mean:
        agree = (one["rot"] * other["rot"]).sum(dim=1, keepdim=True) > 0
        is_surer = one["rot"].norm(dim=1, keepdim=True) > other["rot"].norm(dim=1, keepdim=True)
        mean["rot"] = torch.where(agree, mean["rot"], torch.where(is_surer, one["rot"], other["rot"]))
    return mean
