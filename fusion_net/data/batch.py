"""What flows between reader, model and evaluation.

Axes: B batch, N cameras, P LiDAR points of the whole batch, R radar points, M modalities, K classes, Y/X BEV rows and
columns, H/W image, h/w image at the label stride.
"""

from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

from fusion_net.common.boxes import Boxes

LIDAR_CHANNELS = ("x", "y", "z", "intensity", "dt")
"""Metres in the reference ego frame, intensity in [0, 1], dt = reference time - point time in seconds (>= 0 for the past)."""

RADAR_CHANNELS = ("x", "y", "z", "rcs", "vx", "vy", "dt")
"""Ego metres, dBsm, ego-motion compensated radial velocity as a vector in reference ego axes in m/s, dt in seconds."""


@dataclass(frozen=True)
class Targets:
    """What the head is trained on, dense over the BEV grid. ``mask`` marks the cells that hold an object's centre."""

    heatmap: Float[Tensor, "B K Y X"]
    mask: Bool[Tensor, "B Y X"]
    offset: Float[Tensor, "B 2 Y X"]  # metres from the cell's centre to the box's, (x, y)
    height: Float[Tensor, "B 1 Y X"]  # z of the box's centre in the ego frame, metres
    size: Float[Tensor, "B 3 Y X"]  # log of w, l, h in metres
    rot: Float[Tensor, "B 2 Y X"]  # sin, cos of yaw
    velocity: Float[Tensor, "B 2 Y X"]  # m/s, ego axes; NaN where the label has none


@dataclass(frozen=True)
class Batch:
    """B samples. Points of all samples lie in one array with the sample's index beside them, so any may be empty."""

    tokens: list[str]
    images: UInt8[Tensor, "B N 3 H W"]
    cam_K: Float[Tensor, "B N 3 3"]  # of the image as the network sees it
    ego_T_cam: Float[Tensor, "B N 4 4"]  # camera at its own time to ego at the reference time
    lidar_points: Float[Tensor, "P 5"]  # LIDAR_CHANNELS
    lidar_batch: Int[Tensor, "P"]
    radar_points: Float[Tensor, "R 7"]  # RADAR_CHANNELS
    radar_batch: Int[Tensor, "R"]
    present: Bool[Tensor, "B M"]  # MODALITIES; False: the sensor is dead or dropped
    lidar_depth: Float[Tensor, "B N h w"]  # nearest LiDAR return per cell, metres along z; 0 where none
    dense_depth: Float[Tensor, "B N h w"] | None = None  # nearest exact depth per cell, 0 where sky; None on real data
    class_map: Int[Tensor, "B N h w"] | None = None  # class index per cell, -1 for no object; None on real data
    colors: Float[Tensor, "B 3 4"] | None = None  # colour augmentation: (R, G, B, 1) in 0..255 to the RGB to learn from
    targets: Targets | None = None
    boxes: tuple[Boxes, ...] = ()

    @property
    def size(self) -> int:
        """B."""
        return len(self.tokens)

    def to(self, device: torch.device | str) -> "Batch":
        """The batch with its tensors on a device."""
        return replace(self, **{f.name: _to(getattr(self, f.name), device) for f in fields(self)})


def _to(value, device):
    if isinstance(value, Tensor):
        return value.to(device)
    if isinstance(value, Targets):
        return Targets(**{f.name: _to(getattr(value, f.name), device) for f in fields(value)})
    return value
