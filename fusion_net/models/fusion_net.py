"""The detector, as the picture in the README: encoders, one bird's-eye view, a fuser, a decoder, a head."""

from dataclasses import replace
from typing import Literal

import torch
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.models.blocks.doppler import with_doppler_speed
from fusion_net.models.blocks.layers import PRIOR_LOGIT
from fusion_net.models.blocks.mirror import mean_maps, mirrored, mirrored_maps
from fusion_net.models.blocks.outputs import Encoded, Outputs
from fusion_net.models.center_head import CenterHead
from fusion_net.models.encoders.image_network import ImageNetwork
from fusion_net.models.encoders.radar_encoder import radar_detections, radial_velocity
from fusion_net.models.losses import DetectionLoss


@beartype
class FusionNet(nn.Module):
    """Mid-level fusion. ``encoders``: by the names of MODALITIES; ``modalities`` keeps some of them. ``inputs``: the sensors
    that these may read, None for ``modalities``; more where one sensor's encoder reads another's data (early fusion).

    All BEV maps between the parts have ``bev_channels`` channels. ``velocity``: what the head regresses, the velocity or
    what is to be added to the radar's radial one, where there is radar. ``doppler_speed``: boxes with radar detections on them
    move along their axis as fast as those say, whatever the head says, and are turned round where that is backwards.
    ``mirror_test``, an attribute: in evaluation the scene is also seen mirrored (:mod:`fusion_net.models.blocks.mirror`), in
    a second pass. Where the losses weigh ``aux_heatmap``, each encoder's own map gets a heat map head for training.
    """

    built: Tensor  # (M,) which sensors the model reads

    def __init__(
        self,
        *,
        grid: BEVGrid,
        bev_channels: int,
        modalities: list[str],
        encoders: dict[str, nn.Module],
        fuser: nn.Module,
        decoder: nn.Module,
        head: CenterHead,
        losses: DetectionLoss,
        velocity: Literal["direct", "radar_residual"],
        doppler_speed: bool = True,  # runs of before this switch gain by it, too
        inputs: list[str] | None = None,
    ) -> None:
        super().__init__()
        for name in modalities:
            if name not in encoders or name not in MODALITIES:
                raise ValueError(f"fusion net: no encoder for {name!r}; this model has {', '.join(encoders)}")
        parts = {f"{name} encoder": encoders[name] for name in modalities} | {"fuser": fuser}
        for name, part in parts.items():
            if (channels := getattr(part, "channels", "no")) != bev_channels:
                raise ValueError(f"fusion net: the {name} has {channels} channels, bev_channels is {bev_channels}")
        self.grid, self.bev_channels = grid, bev_channels
        self.encoders = nn.ModuleDict({name: encoders[name] for name in MODALITIES if name in modalities})
        self.fuser, self.decoder, self.head, self.losses = fuser, decoder, head, losses
        self.adds_radar_velocity = velocity == "radar_residual" and "radar" in modalities
        self.doppler_speed = doppler_speed and "radar" in modalities
        self.mirror_test = False
        self.views = nn.ModuleDict()
        for name in self.encoders if losses.weights["aux_heatmap"] > 0 else ():
            self.views[name] = nn.Conv2d(bev_channels, head.num_classes, 1)
            nn.init.constant_(self.views[name].get_parameter("bias"), PRIOR_LOGIT)
        self.columns = [MODALITIES.index(name) for name in self.encoders]
        read = modalities if inputs is None else inputs
        self.register_buffer("built", torch.tensor([name in read for name in MODALITIES]), persistent=False)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, batch: Batch, present: Tensor | None = None) -> Outputs:
        """Maps of a batch. ``present`` (B, M) overrules the batch's: modality dropout, or a row of the drop table.

        A sensor that the model is not built with is absent, whatever the data holds: no encoder may read it.
        """
        batch = replace(batch, present=(batch.present if present is None else present) & self.built)
        maps, encoded = self._maps(batch)
        image = next((x.image for x in encoded.values() if x.image is not None), None)
        if self.training:
            return Outputs(maps, image, self._views(encoded, batch.present[:, self.columns]))
        if self.mirror_test:
            maps = mean_maps(maps, mirrored_maps(self._maps(mirrored(batch))[0]))
        return Outputs(maps, image, detections=radar_detections(batch) if self.doppler_speed else ())

    def _maps(self, batch: Batch) -> tuple[dict[str, Tensor], dict[str, Encoded]]:
        """The head's maps, and what each encoder gave."""
        present = batch.present[:, self.columns]
        encoded = {
            name: encoder(batch) if present[:, i].any() else self._absent(batch)
            for i, (name, encoder) in enumerate(self.encoders.items())
        }
        fused = self.fuser({name: x.bev for name, x in encoded.items()}, present)
        maps = self.head(self.decoder(fused))
        if self.adds_radar_velocity:
            maps["velocity"] = maps["velocity"] + radial_velocity(batch, self.grid)
        return maps, encoded

    def _views(self, encoded: dict[str, Encoded], present: Tensor) -> dict[str, tuple[Tensor, Tensor]]:
        """What each sensor that any sample has says alone."""
        return {
            name: (self.views[name](x.bev).float(), present[:, i])
            for i, (name, x) in enumerate(encoded.items())
            if name in self.views and present[:, i].any()
        }

    def _absent(self, batch: Batch) -> Encoded:
        """In place of a sensor that no sample of the batch has: the encoder's time is saved, as the drop table shows."""
        shape = (batch.size, self.bev_channels, *self.grid.shape)
        return Encoded(torch.zeros(shape, device=batch.present.device))

    def loss(self, outputs: Outputs, batch: Batch) -> dict[str, Tensor]:
        """Scalars by name, already weighted; "loss" is their sum. Without the dense losses of a camera that is frozen."""
        is_frozen = outputs.image is not None and torch.is_grad_enabled() and not outputs.image.features.requires_grad
        return self.losses(replace(outputs, image=None) if is_frozen else outputs, batch)

    @property
    def image_network(self) -> ImageNetwork | None:
        """What predicts in the image plane, whichever encoder has it; None in a model that has none."""
        return next((part for part in self.encoders.modules() if isinstance(part, ImageNetwork)), None)

    def camera_loss(self, batch: Batch) -> dict[str, Tensor]:
        """The dense losses of the image network alone, at a third of a step's cost: for the stage before fusion."""
        network = self.image_network
        assert network is not None
        return self.losses.total(self.losses.image_terms(network(batch), batch))

    def output_layers(self) -> list[nn.Module]:
        """The last layers, whose rows mean different things."""
        return [self.head.heatmap[-1], self.head.box[-1]]

    def decode(self, outputs: Outputs) -> list[Boxes]:
        """Boxes of each sample in the ego frame, best first."""
        found = self.head.decode(outputs.maps)
        if not outputs.detections:
            return found
        return [with_doppler_speed(boxes, seen) for boxes, seen in zip(found, outputs.detections, strict=True)]


def look_mirrored(model: nn.Module) -> None:
    """Has every network of a trained detector see each scene mirrored, too. ValueError where the grid's two sides differ."""
    for part in model.modules():
        if isinstance(part, FusionNet):
            left_and_right = part.grid.centers()[..., 1]
            if not torch.allclose(left_and_right, -left_and_right.flip(0), atol=1e-4):
                raise ValueError(f"mirror_test=true: the grid is not as wide to the left as to the right: {part.grid}")
            part.mirror_test = True
