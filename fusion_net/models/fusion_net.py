"""The detector, as the picture in the README: encoders, one bird's-eye view, a fuser, a decoder, a head."""

from dataclasses import dataclass

import torch
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.data.batch import MODALITIES, Batch
from fusion_net.models.camera_encoder import CameraEncoder, Perception
from fusion_net.models.center_head import CenterHead
from fusion_net.models.fuser import AverageFuser, ConcatFuser
from fusion_net.models.losses import DetectionLoss


@dataclass(frozen=True)
class Outputs:
    """Maps of the head (see ``center_head.REGRESSIONS``) and, if the camera was looked at, its image plane."""

    maps: dict[str, Tensor]
    camera: Perception | None = None


@beartype
class FusionNet(nn.Module):
    """Mid-level fusion. ``encoders``: by the names of MODALITIES; ``modalities`` keeps some of them (default: all)."""

    def __init__(
        self,
        *,
        grid: BEVGrid,
        encoders: dict[str, nn.Module],
        fuser: ConcatFuser | AverageFuser,
        decoder: nn.Module,
        head: CenterHead,
        losses: DetectionLoss,
        modalities: list[str] | None = None,
    ) -> None:
        super().__init__()
        names = list(encoders) if modalities is None else modalities
        for name in names:
            if name not in encoders or name not in MODALITIES:
                raise ValueError(f"fusion net: no encoder for {name!r}; this model has {', '.join(encoders)}")
            if fuser.channels.get(name) != encoders[name].channels:
                raise ValueError(
                    f"fusion net: the {name} encoder makes {encoders[name].channels} channels,"
                    f" the fuser expects {fuser.channels.get(name)}"
                )
        self.grid = grid
        self.encoders = nn.ModuleDict({name: encoders[name] for name in MODALITIES if name in names})
        self.fuser, self.decoder, self.head, self.losses = fuser, decoder, head, losses
        self.columns = [MODALITIES.index(name) for name in self.encoders]
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, batch: Batch, present: Tensor | None = None) -> Outputs:
        """Maps of a batch. ``present`` (B, M) overrules the batch's: modality dropout, or a row of the drop table."""
        present = (batch.present if present is None else present)[:, self.columns]
        bev, camera = {}, None
        for i, (name, encoder) in enumerate(self.encoders.items()):
            if not present[:, i].any():  # the time saved is part of the drop table
                bev[name] = torch.zeros(batch.size, self.fuser.channels[name], *self.grid.shape, device=present.device)
            elif name == "camera":
                bev[name], camera = encoder(batch)
            else:
                bev[name] = encoder(batch)
        fused = self.fuser(bev, present)
        return Outputs(maps=self.head(self.decoder(fused)), camera=camera)

    def loss(self, outputs: Outputs, batch: Batch) -> dict[str, Tensor]:
        """Scalars by name, already weighted; "loss" is their sum."""
        return self.losses(outputs.maps, outputs.camera, batch)

    def camera_loss(self, batch: Batch) -> dict[str, Tensor]:
        """The camera's dense losses alone, at a third of a step's cost: for the minutes before fusion begins."""
        camera = self.encoders["camera"]
        assert isinstance(camera, CameraEncoder)
        return self.losses.total(self.losses.camera(camera.perceive(batch), batch))

    def decode(self, outputs: Outputs) -> list[Boxes]:
        """Boxes of each sample in the ego frame, best first."""
        return self.head.decode(outputs.maps)
