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
from fusion_net.evaluation.audits.association import audit_association, by_distance, by_probability
from fusion_net.evaluation.audits.calibration import Views, audit_calibration
from fusion_net.evaluation.audits.conditions import audit_conditions
from fusion_net.evaluation.audits.depth import audit_depth, read_depths
from fusion_net.evaluation.audits.heat import heat_of_pairs
from fusion_net.evaluation.audits.influence import influence
from fusion_net.evaluation.audits.result import Audit
from fusion_net.evaluation.bootstrap import resample_scenes
from fusion_net.evaluation.decoys import best_f1_score
from fusion_net.evaluation.drop_table import RESAMPLING_SEED, SUBSETS, DropTable
from fusion_net.evaluation.late_calibration import gather
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.evaluation.strata import condition_of
from fusion_net.models.encoders.camera_encoder import CameraEncoder
from fusion_net.models.encoders.image_network import ImageNetwork
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.late.estimates import Estimates
from fusion_net.models.late.late_fusion import LateFusion
from fusion_net.models.late.sensor_calibration import SensorCalibration
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
    association audit takes two boxes for one object, None: what fits each pair of sensors best; late fusion has its own.
    ``sound``: the folder of the same evaluation without faults, if this one
    has any."""

    def __init__(
        self,
        folder: Path,
        model: nn.Module,
        dataset: NuScenesDataset,
        truth: GroundTruth,
        table: DropTable,
        *,
        gate: float | None,
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
        copies = self.copies[:50] if len(set(self.truth.scenes)) > 1 else None
        return audit_calibration(self._views(), copies, overlay=overlay, usual=self._usual())

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
        """Of late fusion what it associates, by its own rule; else what the detector finds with one sensor at a time, above the
        score of its best F1."""
        if isinstance(self.model, LateFusion):
            lists, _ = gather(self.model, self._batches(len(self.dataset)))
            found = {name: [lists[token][name] for token in self.truth.tokens] for name in self.model.detectors}
            return audit_association(found, by_probability(self.model), self.copies)
        return audit_association({name: self._sure(name) for name in self.sensors}, by_distance(self.gate), self.copies)

    def _views(self) -> Views:
        """The views of each two sensors that are to lie on each other, sample by sample."""
        network = next((part for part in self.model.modules() if isinstance(part, ImageNetwork)), None)
        alone = {name: self.table.found[SUBSETS.index((name,))] for name in self.sensors}
        by_token: dict[str, Any] = {}
        for batch in self._batches(len(self.dataset)):
            by_token |= zip(batch.tokens, heat_of_pairs(network, batch, alone), strict=True)
        every = [by_token[token] for token in self.truth.tokens]
        return {pair: ([each[pair][0] for each in every], [each[pair][1] for each in every]) for pair in every[0]}

    def _sure(self, sensor: str) -> list[Estimates]:
        """What a sensor alone finds, sample by sample, with the variances of the head and the labels that it is of."""
        thresholds, believed = self._thresholds(sensor), SensorCalibration(sensor, num_classes=len(self.truth.classes))
        pairs = zip(self._alone(sensor), self._labels(), strict=True)
        return [believed.estimates(boxes[boxes.score >= thresholds[boxes.label]], labels) for boxes, labels in pairs]

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
