"""Images to a bird's-eye view: ``perceive`` predicts in the image plane, ``lift`` takes the predictions to the BEV map."""

from typing import Literal

import torch
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.models.blocks.layers import ConvBlock
from fusion_net.models.blocks.outputs import Encoded, ImagePredictions
from fusion_net.models.blocks.splat import SplatIndex, flat_cells, splat, to_map
from fusion_net.models.encoders.image_network import ImageNetwork
from fusion_net.models.encoders.point_scores import point_scores
from fusion_net.models.encoders.view_transforms import ViewTransform, ego_points


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
        self.channels, self.depth_source = channels, depth_source
        self.lift_class_scores, self.point_scores = lift_class_scores, point_scores
        classes = image_network.classes if lift_class_scores else 0
        lifted = image_network.features + (classes + 1 if lift_class_scores else 0)
        inputs = view_transform.num_layers * lifted + classes
        inputs += 2 * (image_network.classes + 1) if point_scores else 0
        self.reduce = ConvBlock(inputs, channels, kernel=1)
        self.refine = ConvBlock(channels, channels)

    @property
    def frozen(self) -> bool:
        """Whether the image network is frozen."""
        return self.image_network.frozen

    def freeze(self, frozen: bool) -> None:
        """Stop (or resume) training the image network; the part after the lift keeps learning."""
        self.image_network.freeze(frozen)

    def forward(self, batch: Batch) -> Encoded:
        """The lifted map, with the image predictions for their dense losses."""
        predictions = self.perceive(batch)
        return Encoded(self.lift(predictions, batch), image=predictions)

    def perceive(self, batch: Batch) -> ImagePredictions:
        """Predictions in the image plane: all that the dense losses, or painting points, need."""
        return self.image_network(batch)

    def lift(self, predictions: ImagePredictions, batch: Batch) -> Tensor:
        """Predictions to a map (B, channels, Y, X), by the calibration of the batch."""
        probability, depth = self._depth(predictions, batch)
        features = predictions.features.permute(0, 1, 3, 4, 2).float()
        calibration = (batch.cam_K.float(), batch.ego_T_cam.float())
        # Detached: what a class score means comes from the dense losses alone, not from the detection losses.
        scores = predictions.class_logits.detach().permute(0, 1, 3, 4, 2).sigmoid()
        if self.lift_class_scores:
            columns = torch.cat([features, scores, torch.ones_like(scores[..., :1])], dim=-1)
            maps = [self.view_transform(columns, probability, *calibration)]
            maps.append(self._splat_at_depth(scores, depth, calibration))
        else:
            maps = [self.view_transform(features, probability, *calibration)]
        if self.point_scores:
            maps.append(point_scores(scores, batch, grid=self.view_transform.grid, stride=self.view_transform.stride))
        # Concatenated channels last, as they lie in memory, and already in the precision of the convolutions.
        parts = [x.permute(0, 2, 3, 1).to(predictions.features.dtype) for x in maps]
        return self.refine(self.reduce(torch.cat(parts, dim=-1).permute(0, 3, 1, 2)))

    def _depth(self, predictions: ImagePredictions, batch: Batch) -> tuple[Tensor, Tensor]:
        """Depth probabilities (B, N, h, w, D) and one depth per feature cell (B, N, h, w), metres, 0 where unknown."""
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

    def _splat_at_depth(self, scores: Tensor, depth: Tensor, calibration: tuple[Tensor, Tensor]) -> Tensor:
        """Class scores (B, N, h, w, K), each summed into the one BEV cell (B, K, Y, X) at its pixel's depth."""
        grid, stride = self.view_transform.grid, self.view_transform.stride
        with torch.no_grad():
            points = ego_points(depth[..., None], *calibration, stride)[..., 0, :2]
            cell, inside = flat_cells(points, grid)
            pixel = (inside & (depth > 0)).flatten().nonzero()[:, 0]
            cells = len(depth) * grid.shape[0] * grid.shape[1]
            index = SplatIndex.of(pixel, cell.flatten()[pixel], pixels=depth.numel(), cells=cells)
            weights = torch.ones_like(pixel, dtype=scores.dtype)
            return to_map(splat(scores.flatten(0, 3), weights, index), len(depth), grid)
