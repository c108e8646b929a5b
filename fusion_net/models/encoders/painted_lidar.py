"""Early fusion: the LiDAR's encoder reads points that the camera's image network has painted."""

from typing import Literal

import torch
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.models.blocks.outputs import Encoded, ImagePredictions
from fusion_net.models.encoders.image_network import ImageNetwork
from fusion_net.models.encoders.lidar_encoder import LidarEncoder
from fusion_net.models.encoders.painting import exact_scores, paint_points, with_background
from fusion_net.models.encoders.view_transforms import inverse

_CAMERA = MODALITIES.index("camera")


@beartype
class Painter(nn.Module):
    """``forward(batch)`` gives the LiDAR's points with ``columns`` more columns, and the image predictions behind them.

    The columns are the class scores, the background's, and whether no camera sees the point; in a sample without the camera
    scores of 0 and "seen by none", whatever its images hold. ``painting``: "learned", the scores of ``image_network``, which
    learns them from its dense losses alone and nothing from the boxes; or "oracle", 0 and 1 from the generated class images,
    what perfect segmentation would give, without a network.
    """

    def __init__(self, *, image_network: ImageNetwork, painting: Literal["learned", "oracle"]) -> None:
        super().__init__()
        self.classes, self.stride = image_network.classes, image_network.stride
        self.columns = self.classes + 2
        self.image_network = image_network if painting == "learned" else None

    def forward(self, batch: Batch) -> tuple[Tensor, ImagePredictions | None]:
        """Points (P, 5 + ``columns``) in the batch's order. The predictions are None where no sample has the camera."""
        there = batch.present[:, _CAMERA]
        if not there.any():
            nothing = batch.lidar_points.new_zeros(len(batch.lidar_points), self.columns - 1)
            return torch.cat([batch.lidar_points, nothing, torch.ones_like(nothing[:, :1])], dim=1), None
        predictions = None if self.image_network is None else self.image_network(batch)
        with torch.no_grad(), torch.autocast(there.device.type, enabled=False):
            painted = paint_points(
                batch.lidar_points,
                self._exact(batch) if predictions is None else _learned(predictions),
                batch.cam_K.float(),
                inverse(batch.ego_T_cam.float()),
                sample=batch.lidar_batch,
                alive=there[:, None].expand(-1, batch.cam_K.shape[1]),
                stride=self.stride,
            )
        return painted, predictions

    def _exact(self, batch: Batch) -> Tensor:
        if batch.class_map is None:
            raise ValueError(
                "painting=oracle needs the class images of generated data, which this data set does not have; use"
                " painting=learned"
            )
        return exact_scores(batch.class_map, self.classes)


def _learned(predictions: ImagePredictions) -> Tensor:
    return with_background(predictions.class_logits.float().permute(0, 1, 3, 4, 2).sigmoid())


@beartype
class PaintedLidarEncoder(nn.Module):
    """LiDAR and camera in one branch: ``forward(batch)`` gives the ``lidar`` encoder's map of painted points."""

    def __init__(self, *, painter: Painter, lidar: LidarEncoder) -> None:
        super().__init__()
        self.painter, self.lidar, self.channels = painter, lidar, lidar.channels

    def forward(self, batch: Batch) -> Encoded:
        """The map (B, channels, Y, X), with the image predictions for their dense losses."""
        points, predictions = self.painter(batch)
        return Encoded(self.lidar.encode(points, batch.lidar_batch, batch.size), image=predictions)
