"""``eval.py run=... audits=all``: the audits of a run, from its drop table, its weights and its data."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import nn
from torch.utils.data import DataLoader, Subset

from fusion_net.common.boxes import Boxes
from fusion_net.common.checks import check_names
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.evaluation.audits.ablation import audit_ablation
from fusion_net.evaluation.audits.association import audit_association
from fusion_net.evaluation.audits.calibration import audit_calibration
from fusion_net.evaluation.audits.conditions import audit_conditions
from fusion_net.evaluation.audits.depth import audit_depth, read_depths
from fusion_net.evaluation.audits.influence import influence
from fusion_net.evaluation.audits.result import Audit
from fusion_net.evaluation.bootstrap import resample_scenes
from fusion_net.evaluation.decoys import best_f1_score
from fusion_net.evaluation.drop_table import RESAMPLING_SEED, SUBSETS, DropTable
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.evaluation.strata import condition_of
from fusion_net.models.encoders.camera_encoder import CameraEncoder
from fusion_net.models.fusion_net import FusionNet
from fusion_net.reports.audits.pages import FOLDER, OVERLAY, write_audit, write_page
from fusion_net.viz.overlay import measure_overlay, overlay_picture

AUDITS = ("calibration", "depth", "ablation", "conditions", "association")
OVERLAYS, LISTENED, LOOKED = 24, 64, 160
"""Samples, spread over the split, of the overlay, of the gradients, and of the depths."""


def chosen_audits(audits: str | Sequence[str]) -> tuple[str, ...]:
    """The names that ``audits=`` means: ``all``, ``none``, one of AUDITS, or a list of them. ValueError for another."""
    names = [audits] if isinstance(audits, str) else [*audits]
    if names in (["all"], ["none"]):
        return AUDITS if names == ["all"] else ()
    check_names("audits", names, AUDITS)
    return tuple(name for name in AUDITS if name in names)


class Auditor:
    """What the audits of one evaluation share. ``folder``: where the evaluation is written. ``gate``: metres within which the
    association audit takes two boxes for one object. ``sound``: the folder of the same evaluation without faults, if this one
    has any."""

    def __init__(
        self,
        folder: Path,
        model: nn.Module,
        dataset: NuScenesDataset,
        truth: GroundTruth,
        table: DropTable,
        *,
        gate: float,
        resamples: int,
        sound: Path | None,
    ) -> None:
        self.folder, self.model, self.dataset, self.truth, self.table = folder, model, dataset, truth, table
        self.gate, self.sound = gate, sound
        self.copies = resample_scenes(truth.scenes, resamples=resamples, rng=np.random.default_rng(RESAMPLING_SEED))
        self.sensors = tuple(name for name in MODALITIES if name in dataset.reader.modalities)

    def write(self, names: Sequence[str]) -> list[Audit]:
        """Makes, writes and returns the audits of these names."""
        make: dict[str, Callable[[], Audit]] = {
            "calibration": self.calibration,
            "depth": self.depth,
            "ablation": self.ablation,
            "conditions": self.conditions,
            "association": self.association,
        }
        audits = [make[name]() for name in names]
        for audit in audits:
            write_audit(self.folder, audit)
        write_page(self.folder)
        return audits

    def calibration(self) -> Audit:
        """The overlay is also drawn, beside the audit's picture."""
        overlay = None
        places = self._places(OVERLAYS)
        if {"camera", "lidar"} <= set(self.sensors):
            overlay = measure_overlay(self.dataset, places)
            (self.folder / FOLDER).mkdir(parents=True, exist_ok=True)
            picture = overlay_picture(self.dataset, places[0])
            cv2.imwrite(str(self.folder / FOLDER / OVERLAY), picture[..., ::-1])
        views = {name: self._alone(name) for name in self.sensors}
        return audit_calibration(views, self.copies[:50], overlay=overlay, usual=self._usual())

    @property
    def _camera(self) -> CameraEncoder | None:
        """The model's camera encoder, in whichever of its parts it is."""
        if "camera" not in self.sensors:
            return None
        return next((part for part in self.model.modules() if isinstance(part, CameraEncoder)), None)

    def depth(self) -> Audit:
        """Of models with a camera encoder."""
        condition = {token: condition_of(nusc.scene(token)) for nusc, token in self.dataset.index}
        cells, objects = read_depths(self._camera, self._batches(LOOKED))
        return audit_depth(cells, objects, condition=condition, classes=self.truth.classes)

    def ablation(self) -> Audit:
        """With gradients where the model has one map per sensor."""
        heard = influence(self.model, self._batches(LISTENED)) if isinstance(self.model, FusionNet) else None
        return audit_ablation(self.table, self.truth, encoders=self.sensors, influence=heard)

    def conditions(self) -> Audit:
        """From the drop table's boxes."""
        return audit_conditions(self.truth, self.dataset.index, self.table.tables, self.copies)

    def association(self) -> Audit:
        """Between the boxes that the detector finds with one sensor at a time."""
        boxes = {name: self._alone(name) for name in self.sensors}
        thresholds = {name: self._thresholds(name) for name in self.sensors}
        return audit_association(boxes, self._labels(), thresholds=thresholds, gate=self.gate)

    def _alone(self, sensor: str) -> list[Boxes]:
        """The boxes found with one sensor, sample by sample."""
        found = self.table.found[SUBSETS.index((sensor,))]
        return [found[token] for token in self.truth.tokens]

    def _thresholds(self, sensor: str) -> NDArray[np.float64]:
        """(K,) of each class the score of the best F1 of the sensor alone."""
        matches = self.truth.matches(self.table.tables[SUBSETS.index((sensor,))])
        return np.array([best_f1_score(match) for match in matches])

    def _labels(self) -> list[Boxes]:
        """The labels that count, sample by sample in the ego frame."""
        labels = self.truth.labels
        boxes = replace(labels.boxes, center=self.truth.in_ego(labels))
        return [boxes[labels.sample == sample] for sample in range(len(self.truth.tokens))]

    def _places(self, count: int) -> list[int]:
        """Of ``count`` samples spread evenly over the split."""
        return np.unique(np.linspace(0, len(self.dataset) - 1, count).round().astype(int)).tolist()

    def _batches(self, count: int) -> DataLoader:
        samples: Subset = Subset(self.dataset, self._places(count))
        return DataLoader(samples, batch_size=8, collate_fn=self.dataset.collate)

    def _usual(self) -> dict[str, Any] | None:
        """What the calibration audit of the sound sensors measured, if there is one."""
        path = (self.sound or self.folder) / FOLDER / "calibration.json"
        if self.sound is None or not path.is_file():
            return None
        pairs: dict[str, Any] = json.loads(path.read_bytes())["numbers"]["pairs"]
        return pairs
