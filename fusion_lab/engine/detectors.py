"""The trained detectors that the lab offers, and what can be seen of one while it runs."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from fusion_net.common.boxes import Boxes
from fusion_net.common.cli.command import build
from fusion_net.common.cli.command_line import command_line
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.models.bev_decoder import BEVDecoder
from fusion_net.models.blocks.outputs import Encoded, ImagePredictions
from fusion_net.models.center_head import CenterHead
from fusion_net.models.encoders.camera_encoder import CameraEncoder
from fusion_net.models.encoders.image_network import ImageNetwork
from fusion_net.models.precision import autocast
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.runs.sources import SHIPPED
from fusion_net.runs.trained import Trained, shipped, trained_run

PARTS: dict[str, type[nn.Module]] = {"image": ImageNetwork, "decoder": BEVDecoder, "head": CenterHead}
"""What is watched of a detector, at whatever level it fuses, beside the encoder of each modality. An encoder's time includes
that of the image network that it asks."""


@dataclass
class Seen:
    """What was seen of one run: milliseconds in each part, BEV maps (C, Y, X) by modality, the camera's predictions."""

    ms: dict[str, float] = field(default_factory=dict)
    maps: dict[str, Tensor] = field(default_factory=dict)
    image: ImagePredictions | None = None


class Detector:
    """A trained model, run on one keyframe at a time."""

    def __init__(self, trained: Trained) -> None:
        self.trained, self.model = trained, trained.model()
        self.cameras = [module for module in self.model.modules() if isinstance(module, CameraEncoder)]
        images = [module for module in self.model.modules() if isinstance(module, ImageNetwork)]
        self.bins = images[0].bins if images else None
        self._seen, self._began = Seen(), dict[int, float]()
        for path, module in self.model.named_modules():
            if name := _watched(path, module):
                module.register_forward_pre_hook(self._begin)
                module.register_forward_hook(lambda module, _, output, name=name: self._end(name, module, output))

    def samples(self, nusc: NuScenes) -> NuScenesDataset:
        """The keyframes of a data set as this detector reads them."""
        settings = self.trained.cfg.dataset.val.copy()
        settings.root, settings.version, settings.split, settings.cache = str(nusc.root), None, "all", "none"
        dataset: NuScenesDataset = build(settings, datasets=[nusc])
        return dataset

    @torch.inference_mode()
    def run(self, batch: Batch, depth: str) -> tuple[Boxes, Seen]:
        """Boxes of a batch of one keyframe, best first, and what was seen. ``depth``: a ``depth_source`` of the camera."""
        self._seen = Seen()
        for camera in self.cameras:
            camera.depth_source = depth  # type: ignore[assignment]
        with autocast(self.trained.cfg.trainer.precision):
            (found,) = self.model.decode(self.model(batch, batch.present))
        return found, self._seen

    def _begin(self, module: nn.Module, inputs: Any) -> None:
        self._began[id(module)] = time.perf_counter()

    def _end(self, name: str, module: nn.Module, output: Any) -> None:
        took = 1e3 * (time.perf_counter() - self._began[id(module)])
        self._seen.ms[name] = self._seen.ms.get(name, 0.0) + took
        if isinstance(output, ImagePredictions):
            self._seen.image = output
        elif isinstance(output, Encoded):
            self._seen.maps[name] = output.bev[0].float()


def _watched(path: str, module: nn.Module) -> str:
    """The name of a part that is watched; "" for others. The encoders of every level are called encoders.MODALITY."""
    owner, _, name = path.rpartition(".")
    if name in MODALITIES and owner.rpartition(".")[2] == "encoders":
        return name
    return next((name for name, kind in PARTS.items() if isinstance(module, kind)), "")


def level_of(trained: Trained) -> str:
    """Where a detector fuses: early, mid or late, by the module of its model."""
    target = str(trained.cfg.model._target_)
    return next((level for level in ("early", "late") if level in target.lower()), "mid")


def offered(runs: Sequence[str], checkpoint: str) -> dict[str, Trained]:
    """Detectors by the name that the page shows: runs, if any are named, then the shipped one of each level that is trained
    for the same sensors. A second run of a level goes by the name of its folder. FileNotFoundError when there is none,
    ValueError for weights of another version or runs for other sensors."""
    found: dict[str, Trained] = {}
    for run in runs:
        trained = trained_run(Path(run), checkpoint)
        first = next(iter(found.values()), trained)
        if trained.cfg.data.name != first.cfg.data.name:
            both = f"{first.folder} on {first.cfg.data.name}, {run} on {trained.cfg.data.name}"
            raise ValueError(f"run: detectors for other sensors cannot be compared: {both}; name runs of one data set")
        level = level_of(trained)
        found[trained.folder.name if level in found else level] = trained
    for path in _shipped_files():
        trained = shipped(str(path))
        rig = next(iter(found.values()), trained).cfg.data.name
        if trained.cfg.data.name == rig:
            found.setdefault(level_of(trained), trained)
    if not found:
        train, show = command_line("train.py", name="mine"), command_line("-m fusion_lab", run="runs/mine")
        raise FileNotFoundError(
            f"there is no trained detector to break: {SHIPPED} holds no weights; train one ({train}) and show it ({show})"
        )
    levels = [level for level in ("early", "mid", "late") if level in found]
    return {name: found[name] for name in dict.fromkeys([*levels, *found])}


def _shipped_files() -> Sequence[Path]:
    """Files of shipped weights, those of the default rig first."""
    return sorted(SHIPPED.glob("*.pt"), key=lambda path: (path.stem != "nano", path.stem))
