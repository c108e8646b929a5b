"""A few fixed validation samples as TensorBoard images: what the network made on its way to the boxes."""

import cv2
import lightning.pytorch as pl
import numpy as np
import torch
from lightning.pytorch.loggers import TensorBoardLogger
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.common.drawing import BEVPanel, Image, depth_colors
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.models.blocks.outputs import Encoded, ImagePredictions, Outputs
from fusion_net.models.fusion_net import FusionNet
from fusion_net.viz.picture_sheet import CAPTION, FOUND, LABEL, draw_sample, montage

GAP = 6
"""Pixels between panels."""


class ValidationPictures:
    """Draws the same ``count`` samples, spread evenly over ``dataset``, at every validation.

    A picture has, from above: the cameras with labels, those with predictions above ``min_score``, the ground with both
    beside them; the most likely depth of each image cell and the exact one; the BEV maps of the encoders, as the norm over
    their channels, and the head's heat map, as the largest score of any class, with labels and predictions. Drawing takes no
    random numbers and leaves the model as it was.
    """

    def __init__(self, dataset: NuScenesDataset, *, count: int = 4, min_score: float = 0.3) -> None:
        self.dataset, self.min_score = dataset, min_score
        self.places = sorted({(2 * k + 1) * len(dataset) // (2 * count) for k in range(count)}) if len(dataset) else []

    def write(self, model: FusionNet, trainer: pl.Trainer) -> None:
        """Hands the pictures to TensorBoard, as ``val/sample_1`` and so on."""
        boards = [logger.experiment for logger in trainer.loggers if isinstance(logger, TensorBoardLogger)]
        if not boards:
            return
        for number, picture in enumerate(self.draw(model, device=trainer.strategy.root_device), start=1):
            for board in boards:
                board.add_image(f"val/sample_{number}", picture, trainer.global_step, dataformats="HWC")

    @torch.no_grad()
    def draw(self, model: FusionNet, *, device: torch.device | str = "cpu") -> list[Image]:
        """One picture a sample. ``model`` is in evaluation mode."""
        if not self.places:
            return []
        samples = [self.dataset[place] for place in self.places]
        batch = self.dataset.collate(samples).to(device)
        outputs, norms = _observed(model, batch)
        heat = outputs.maps["heatmap"].nan_to_num().sigmoid().amax(dim=1).cpu().numpy()
        depth = _most_likely_depth(model, outputs.image)
        pictures = []
        for b, (sample, found) in enumerate(zip(samples, model.decode(outputs), strict=True)):
            found = found[found.score > self.min_score]
            tile = draw_sample(sample, found, self.dataset)
            rows = [_captioned(tile, f"{sample.token}: labels green, predictions (score > {self.min_score:g}) orange")]
            if depth is not None and len(sample.images):
                rows.append(_depth_row(depth[b], batch, b, tile.shape[1]))
            there = [name for name in norms if sample.present[MODALITIES.index(name)]]
            panels = {f"{name}, norm over channels": norms[name][b] for name in there}
            panels["heat map, all classes"] = heat[b]
            rows.append(self._bev_row(panels, sample.boxes, found, tile.shape[1]))
            pictures.append(np.concatenate(rows))
        return pictures

    def _bev_row(self, panels: dict[str, NDArray[np.float32]], labels: Boxes, found: Boxes, width: int) -> Image:
        """Maps (Y, X) side by side, each from 0 to its own largest value, with labels and predictions."""
        grid, share = self.dataset.grid, width // len(panels) - GAP
        panel = BEVPanel(grid, scale=share / (grid.y_max - grid.y_min))
        images = []
        for name, values in panels.items():
            levels = panel.of_map((255 * values / max(float(values.max()), 1e-6)).astype(np.uint8))
            image = np.array(cv2.applyColorMap(levels, cv2.COLORMAP_BONE)[..., ::-1], np.uint8, order="C")
            panel.boxes(image, labels, LABEL)
            panel.boxes(image, found, FOUND)
            images.append(_captioned(image, f"{name}: up to {values.max():.2g}"))
        return _side_by_side(images, width)


def _observed(model: FusionNet, batch: Batch) -> tuple[Outputs, dict[str, NDArray[np.float32]]]:
    """Outputs of a batch, and of each encoder that took part the norm (B, Y, X) of its map over the channels."""
    norms: dict[str, NDArray[np.float32]] = {}

    def keep(name: str, encoded: Encoded) -> None:
        norms[name] = torch.linalg.vector_norm(encoded.bev.float(), dim=1).nan_to_num().cpu().numpy()

    hooks = [
        encoder.register_forward_hook(lambda module, inputs, encoded, name=name: keep(name, encoded))
        for name, encoder in model.encoders.items()
    ]
    try:
        return model(batch), norms
    finally:
        for hook in hooks:
            hook.remove()


def _most_likely_depth(model: FusionNet, image: ImagePredictions | None) -> NDArray[np.float32] | None:
    """Metres (B, N, h, w) at the centres of the bins; None without a camera."""
    network = model.image_network
    if image is None or network is None:
        return None
    return network.bins.centers().numpy()[image.depth_logits.argmax(dim=2).cpu().numpy()]


def _depth_row(predicted: NDArray[np.float32], batch: Batch, sample: int, width: int) -> Image:
    """Predicted depth (N, h, w) beside the exact one, or beside the LiDAR's returns where that is not known."""
    labels, name = batch.dense_depth, "exact depth"
    if labels is None:
        labels, name = batch.lidar_depth, "LiDAR returns"
    both = {"most likely depth, near red to far blue": predicted, name: labels[sample].cpu().numpy()}
    images = []
    for caption, cameras in both.items():
        columns = min(len(cameras), 3)
        share = (width // 2 - GAP) // columns
        size = (share, round(share * cameras.shape[1] / cameras.shape[2]))
        enlarged = []
        for depth in cameras:
            colors = depth_colors(depth).reshape(*depth.shape, 3) * (depth > 0)[..., None]
            enlarged.append(np.asarray(cv2.resize(colors, size, interpolation=cv2.INTER_NEAREST), np.uint8))
        images.append(_captioned(montage(enlarged, columns), caption))
    return _side_by_side(images, width)


def _captioned(image: Image, text: str) -> Image:
    """The image below a line of text."""
    strip = np.zeros((20, image.shape[1], 3), np.uint8)
    cv2.putText(strip, text, (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.36, CAPTION, 1, cv2.LINE_AA)
    return np.concatenate([strip, image])


def _side_by_side(images: list[Image], width: int) -> Image:
    """Images of one height in a row that is filled up to ``width`` pixels."""
    row = np.concatenate([np.pad(image, ((0, 0), (0, GAP), (0, 0))) for image in images], axis=1)[:, :width]
    return np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0)))
