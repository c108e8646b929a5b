"""Late fusion: a complete detector for each sensor, and one list of boxes made of theirs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Literal

import torch
from beartype import beartype
from torch import Tensor, nn

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.checks import check_probabilities
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch, Targets
from fusion_net.models.blocks.outputs import Outputs
from fusion_net.models.center_head import CenterHead
from fusion_net.models.encoders.image_network import ImageNetwork
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.late.covariance import gate_of
from fusion_net.models.late.estimates import Estimates
from fusion_net.models.late.fuse import Association, fuse, partners
from fusion_net.models.late.merging import Merge
from fusion_net.models.late.scores import Score
from fusion_net.models.late.sensor_calibration import SensorCalibration
from fusion_net.models.losses import DetectionLoss


@dataclass(frozen=True)
class LateOutputs(Outputs):
    """``by_sensor``: outputs of each detector that any sample has its sensor for; ``present`` (B, M) says which samples do.
    ``maps`` has the highest "heatmap" of any, for pictures; ``labels``: those of the batch, for the oracle association."""

    by_sensor: dict[str, Outputs] = field(default_factory=dict)
    present: Tensor = field(default_factory=lambda: torch.zeros(0, len(MODALITIES), dtype=torch.bool))
    labels: tuple[Boxes, ...] = ()


@beartype
def one_sensor(
    name: str,
    *,
    grid: BEVGrid,
    bev_channels: int,
    encoders: dict[str, nn.Module],
    fuser: Callable[..., nn.Module],
    decoder: Callable[..., nn.Module],
    head: Callable[..., CenterHead],
    losses: DetectionLoss,
    velocity: Literal["direct", "radar_residual"],
    doppler_speed: bool = True,
) -> FusionNet:
    """The detector of one sensor: its encoder, and fuser (of one map), decoder and head of its own."""
    return FusionNet(
        grid=grid,
        bev_channels=bev_channels,
        modalities=[name],
        encoders=encoders,
        fuser=fuser(modalities=[name]),
        decoder=decoder(),
        head=head(),
        losses=losses,
        velocity=velocity,
        doppler_speed=doppler_speed,
    )


@beartype
class LateFusion(nn.Module):
    """Detectors that share nothing, behind the interface of :class:`FusionNet`.

    ``detectors``: whole ones, by sensor, that were trained elsewhere: they are used as they are and learn nothing here. Those
    of the other ``modalities`` are made of the parts (:func:`one_sensor`). ``association``, ``gate`` and ``min_probability``:
    see :func:`partners`; ``merge``: one of MERGES; ``score``: one of SCORES. None of these takes part in the training.
    """

    prior: Tensor  # () fraction of the boxes of all detectors that are of an object
    built: Tensor  # (M,) which sensors there is a detector for

    def __init__(
        self,
        *,
        grid: BEVGrid,
        modalities: list[str],
        detectors: dict[str, FusionNet],
        association: Association,
        gate: float,
        min_probability: float,
        merge: Merge,
        score: Score,
        **parts,
    ) -> None:
        super().__init__()
        gate_of(gate)
        check_probabilities(min_probability=min_probability)
        made = {
            name: detectors[name] if name in detectors else one_sensor(name, grid=grid, **parts) for name in modalities
        }
        for name, detector in detectors.items():
            _check_whole(name, detector, modalities, grid, next(iter(made.values())).head.num_classes)
        self.grid, self.given = grid, tuple(detectors)
        self.detectors = nn.ModuleDict({name: made[name] for name in MODALITIES if name in made})
        num_classes = next(iter(made.values())).head.num_classes
        self.calibration = nn.ModuleDict({n: SensorCalibration(n, num_classes=num_classes) for n in self.detectors})
        self.association, self.gate, self.min_probability = association, gate, min_probability
        self.merge, self.score = merge, score
        self.register_buffer("prior", torch.tensor(0.5))
        self.register_buffer("built", torch.tensor([name in made for name in MODALITIES]), persistent=False)
        for name in self.given:
            self.detectors[name].requires_grad_(False)
        self.train()

    @property
    def encoders(self) -> dict[str, nn.Module]:
        """The encoders of all detectors, by sensor."""
        return {name: detector.encoders[name] for name, detector in self._detectors()}

    @property
    def image_network(self) -> ImageNetwork | None:
        """What predicts in the image plane; None without a camera, or where its detector is given and learns nothing."""
        return self._detector("camera").image_network if {"camera"} & {*self.detectors} - {*self.given} else None

    def output_layers(self) -> list[nn.Module]:
        """The last layers of all heads, whose rows mean different things."""
        return [layer for _, detector in self._detectors() for layer in detector.output_layers()]

    def train(self, mode: bool = True) -> "LateFusion":
        """Given detectors stay in evaluation mode: their batch norms learn nothing either."""
        super().train(mode)
        for name in self.given:
            self.detectors[name].eval()
        return self

    def forward(self, batch: Batch, present: Tensor | None = None) -> LateOutputs:
        """Outputs of each detector whose sensor any sample has. ``present`` (B, M) overrules the batch's. In training a given
        detector has nothing to do."""
        present = (batch.present if present is None else present) & self.built
        heat = torch.full((batch.size, self._num_classes, *self.grid.shape), -torch.inf, device=present.device)
        found: dict[str, Outputs] = {}
        for name, detector in self._detectors():
            own = present[:, MODALITIES.index(name)]
            if own.any() and not (self.training and name in self.given):
                found[name] = detector(batch, present)
                theirs = found[name].maps["heatmap"].masked_fill(~own[:, None, None, None], -torch.inf)
                heat = torch.maximum(heat, theirs.detach())
        image = found["camera"].image if "camera" in found else None
        return LateOutputs({"heatmap": heat}, image, by_sensor=found, present=present, labels=batch.boxes)

    def loss(self, outputs: LateOutputs, batch: Batch) -> dict[str, Tensor]:
        """The losses of all detectors by sensor and name; "loss" is their sum. A detector learns from the samples that have its
        sensor."""
        total = torch.zeros((), device=batch.present.device, requires_grad=torch.is_grad_enabled())
        terms: dict[str, Tensor] = {}
        for name, own in outputs.by_sensor.items():
            there = outputs.present[:, MODALITIES.index(name)]
            losses = self._detector(name).loss(*_of_samples(own, batch, there))
            total = total + losses.pop("loss")
            terms |= {key.replace("loss/", f"loss/{name}_"): value for key, value in losses.items()}
        return terms | {"loss": total}

    def camera_loss(self, batch: Batch) -> dict[str, Tensor]:
        """The dense losses of the camera's detector alone."""
        return self._detector("camera").camera_loss(batch)

    def estimates(self, outputs: LateOutputs, *, with_truth: bool = False) -> list[dict[str, Estimates]]:
        """Of each sample the calibrated estimates of each detector by sensor, [] where its sensor is absent. ``with_truth``:
        with the labels that the boxes are of; ValueError where the batch has none."""
        size = len(outputs.present)
        if with_truth and len(outputs.labels) != size:
            raise ValueError("late.association=oracle pairs boxes through labels, and this batch has none")
        lists: list[dict[str, Estimates]] = [{name: Estimates.empty() for name in self.detectors} for _ in range(size)]
        for name, own in outputs.by_sensor.items():
            there = outputs.present[:, MODALITIES.index(name)].tolist()
            calibration = self.calibration[name]
            assert isinstance(calibration, SensorCalibration)
            for b, boxes in enumerate(self._detector(name).decode(own)):
                if there[b]:
                    lists[b][name] = calibration.estimates(boxes, outputs.labels[b] if with_truth else None)
        return lists

    def fuse(
        self,
        lists: Mapping[str, Estimates],
        *,
        association: Association | None = None,
        merge: Merge | None = None,
        score: Score | None = None,
    ) -> Estimates:
        """One list of one sample's estimates by sensor, best first, by the model's rules where no others are given."""
        association = association or self.association
        pair = partial(partners, association=association, gate=self.gate, min_probability=self.min_probability)
        return fuse(lists, pair, merge=merge or self.merge, score=score or self.score, prior=float(self.prior))

    def decode(self, outputs: LateOutputs) -> list[Boxes]:
        """Boxes of each sample in the ego frame, best first."""
        lists = self.estimates(outputs, with_truth=self.association == "oracle")
        return [self.fuse(each).boxes for each in lists]

    @property
    def _num_classes(self) -> int:
        return len(next(iter(self.calibration.children())).matches)  # type: ignore[arg-type]

    def _detector(self, name: str) -> FusionNet:
        detector = self.detectors[name]
        assert isinstance(detector, FusionNet)
        return detector

    def _detectors(self) -> list[tuple[str, FusionNet]]:
        return [(name, self._detector(name)) for name in self.detectors]


def _check_whole(name: str, detector: FusionNet, modalities: list[str], grid: BEVGrid, num_classes: int) -> None:
    """ValueError unless a detector that was made elsewhere is one of this sensor, grid and number of classes."""
    where = f"late.detectors.{name}"
    if name not in modalities:
        raise ValueError(f"{where}: this model has no {name}; its sensors are {', '.join(modalities)}")
    if list(detector.encoders) != [name]:
        raise ValueError(f"{where}: a detector of {', '.join(detector.encoders)}, where the {name}'s alone is needed")
    if detector.grid != grid:
        raise ValueError(f"{where}: its grid is {detector.grid}, that of this model {grid}")
    if detector.head.num_classes != num_classes:
        raise ValueError(f"{where}: it knows {detector.head.num_classes} classes, this model {num_classes}")


def _of_samples(outputs: Outputs, batch: Batch, there: Tensor) -> tuple[Outputs, Batch]:
    """Maps and targets of the samples ``there`` (B,) alone. The image's dense losses know by themselves what they lack."""
    if there.all() or batch.targets is None:
        return outputs, batch
    maps = {name: x[there] for name, x in outputs.maps.items()}
    views = {name: (logits[there], seen[there]) for name, (logits, seen) in outputs.views.items()}
    targets = Targets(**{f.name: getattr(batch.targets, f.name)[there] for f in fields(Targets)})
    return replace(outputs, maps=maps, views=views), replace(batch, targets=targets)
