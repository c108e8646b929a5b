"""Early fusion (PointPainting, Vora et al. 2020): the detector of mid-level fusion, with the camera in the LiDAR's points."""

from collections.abc import Callable
from typing import Any, Literal

from beartype import beartype
from torch import nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.models.center_head import CenterHead
from fusion_net.models.encoders.painted_lidar import PaintedLidarEncoder
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.losses import DetectionLoss


@beartype
def early_fusion(
    *,
    grid: BEVGrid,
    bev_channels: int,
    modalities: list[str],
    encoders: dict[str, Any],
    fuser: Callable[..., nn.Module],
    decoder: nn.Module,
    head: CenterHead,
    losses: DetectionLoss,
    velocity: Literal["direct", "radar_residual"],
    doppler_speed: bool = True,
) -> FusionNet:
    """A ``FusionNet`` in which the camera has no map of its own: it paints the LiDAR's points, and LiDAR and radar are fused.

    ``encoders``: "camera" a ``Painter``, "lidar" what makes a ``LidarEncoder`` of a number of ``extra_channels``, "radar" an
    encoder. ``fuser``: what makes one of the ``modalities`` that have a map. ``modalities`` (of the model, as ``encoders=``
    names them) must have camera and LiDAR, else ValueError.
    """
    if missing := [name for name in ("camera", "lidar") if name not in modalities]:
        raise ValueError(
            f"early fusion paints LiDAR points with what the camera sees, but encoders={modalities} has no"
            f" {' and no '.join(missing)}; add it, or take model=mid"
        )
    painter = encoders["camera"]
    painted = PaintedLidarEncoder(painter=painter, lidar=encoders["lidar"](extra_channels=painter.columns))
    with_map = [name for name in modalities if name != "camera"]
    return FusionNet(
        grid=grid,
        bev_channels=bev_channels,
        modalities=with_map,
        inputs=modalities,
        encoders=encoders | {"lidar": painted},
        fuser=fuser(modalities=with_map),
        decoder=decoder,
        head=head,
        losses=losses,
        velocity=velocity,
        doppler_speed=doppler_speed,
    )
