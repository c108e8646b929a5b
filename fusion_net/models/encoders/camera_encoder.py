"""Images to a bird's-eye view: ``perceive`` predicts in the image plane, ``lift`` takes the predictions to the BEV map."""

from typing import Literal

import torch
import torch.nn.functional as F
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.checks import check_names
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.models.blocks.layers import ConvBlock
from fusion_net.models.blocks.outputs import Encoded, ImagePredictions
from fusion_net.models.blocks.splat import SplatIndex, flat_cells, splat, to_map
from fusion_net.models.encoders.image_network import ImageNetwork
from fusion_net.models.encoders.point_scores import point_scores
from fusion_net.models.encoders.view_transforms import ViewTransform, ego_points

DEPTH_SOURCES = ("learned", "uniform", "lidar", "oracle")


@beartype
class CameraEncoder(nn.Module):
    """Camera branch: ``forward(batch)`` gives a map (B, channels, Y, X) and the image predictions behind it.

    ``depth_source``: "learned"; "uniform" over all bins (the lower bound); "lidar": the returns of the LiDAR where it is
    present and there are any, else learned; "oracle": the exact depth (the upper bound). ``lift_class_scores``: the map is
    also made from the lifted class scores, the summed depth weights, and the class scores at the regressed depth.
    ``point_scores``: and from the class scores at the returns of the LiDAR and the radar, where those are present.
    """

    def __init__(
        self,
        *,
        image_network: ImageNetwork,
        view_transform: ViewTransform,
        channels: int,
        lift_class_scores: bool,
        point_scores: bool,
        depth_source: Literal["learned", "uniform", "lidar", "oracle"],
    ) -> None:
        super().__init__()
        for name in ("bins", "stride"):
            ours, theirs = getattr(image_network, name), getattr(view_transform, name)
            if ours != theirs:
                raise ValueError(f"camera encoder: the image network has {name}={ours}, the view transform {theirs}")
        self.image_network, self.view_transform = image_network, view_transform
        self.channels, self.lift_class_scores = channels, lift_class_scores
        self.depth_source: str = depth_source
        classes = image_network.classes
        lifted = image_network.features + (classes + 1 if lift_class_scores else 0)
        # The terms of one sum: 1x1 convolutions of the maps that are made, as far as possible before they are maps.
        self.to_layers = nn.Linear(lifted, view_transform.num_layers * channels, bias=False)
        self.from_scores = nn.Linear(classes, channels, bias=False) if lift_class_scores else None
        self.from_points = nn.Conv2d(2 * (classes + 1), channels, 1, bias=False) if point_scores else None
        self.norm = nn.BatchNorm2d(channels)
        self.refine = ConvBlock(channels, channels)

    def forward(self, batch: Batch) -> Encoded:
        """The lifted map, with the image predictions for their dense losses."""
        predictions = self.perceive(batch)
        return Encoded(self.lift(predictions, batch), image=predictions)

    def perceive(self, batch: Batch) -> ImagePredictions:
        """Predictions in the image plane: all that the dense losses, or painting points, need."""
        return self.image_network(batch)

    def lift(self, predictions: ImagePredictions, batch: Batch) -> Tensor:
        """Predictions to a map (B, channels, Y, X), by the calibration of the batch."""
        probability, depth = self.depth(predictions, batch)
        columns = predictions.features.permute(0, 1, 3, 4, 2)
        calibration = (batch.cam_K.float(), batch.ego_T_cam.float())
        # Detached: what a class score means comes from the dense losses alone, not from the detection losses.
        scores = predictions.class_logits.detach().permute(0, 1, 3, 4, 2).sigmoid()
        if self.lift_class_scores:
            columns = torch.cat([columns, scores.to(columns.dtype), torch.ones_like(columns[..., :1])], dim=-1)
        layers = self.to_layers(columns).unflatten(-1, (self.view_transform.num_layers, self.channels))
        bev = self.view_transform(layers, probability, *calibration)
        if self.from_scores is not None:
            bev = bev + self._splat_at_depth(self.from_scores(scores), depth, calibration)
        if self.from_points is not None:
            at_points = point_scores(scores, batch, grid=self.view_transform.grid, stride=self.view_transform.stride)
            bev = bev + self.from_points(at_points)
        return self.refine(F.relu(self.norm(bev.to(predictions.features.dtype)), inplace=True))

    def depth(self, predictions: ImagePredictions, batch: Batch) -> tuple[Tensor, Tensor]:
        """What lifts the features: depth probabilities (B, N, h, w, D) and one depth per cell (B, N, h, w), m, 0 where
        unknown."""
        bins = self.view_transform.bins
        learned = predictions.depth_logits.permute(0, 1, 3, 4, 2).softmax(dim=-1)
        regressed = predictions.log_depth.detach().clamp(max=6.0).exp()
        if self.depth_source == "learned":
            return learned, regressed
        if self.depth_source == "uniform":
            return torch.full_like(learned, 1 / bins.count), torch.zeros_like(regressed)
        if self.depth_source == "lidar":
            has_lidar = batch.present[:, MODALITIES.index("lidar")]
            known = batch.lidar_depth.masked_fill(~has_lidar[:, None, None, None], 0.0)
        elif batch.dense_depth is None:
            raise ValueError("camera encoder: depth_source=oracle needs dense depth, which this data set does not have")
        else:
            known = batch.dense_depth
        index = bins.index(known)
        one_hot = (torch.arange(bins.count, device=index.device) == index[..., None]).float()
        if self.depth_source == "oracle":
            return one_hot, known
        return torch.where((index >= 0)[..., None], one_hot, learned), torch.where(known > 0, known, regressed)

    def _splat_at_depth(self, columns: Tensor, depth: Tensor, calibration: tuple[Tensor, Tensor]) -> Tensor:
        """Columns (B, N, h, w, C), each summed into the one BEV cell (B, C, Y, X) at its pixel's depth."""
        grid, stride = self.view_transform.grid, self.view_transform.stride
        with torch.no_grad():
            points = ego_points(depth[..., None], *calibration, stride)[..., 0, :2]
            cell, inside = flat_cells(points, grid)
            pixel = (inside & (depth > 0)).flatten().nonzero()[:, 0]
            cells = len(depth) * grid.shape[0] * grid.shape[1]
            index = SplatIndex.of(pixel, cell.flatten()[pixel], pixels=depth.numel(), cells=cells)
            weights = torch.ones_like(pixel, dtype=depth.dtype)
        return to_map(splat(columns.flatten(0, 3), weights, index), len(depth), grid)


def lift_by(model: nn.Module, depth_source: str) -> None:
    """Has a trained detector's camera lifted by other depths than it learned with, so that what they are worth shows."""
    check_names("depth_source", [depth_source], DEPTH_SOURCES)
    cameras = [part for part in model.modules() if isinstance(part, CameraEncoder)]
    if not cameras:
        raise ValueError(f"depth_source={depth_source}: this detector has no camera whose features are lifted")
    for camera in cameras:
        camera.depth_source = depth_source
