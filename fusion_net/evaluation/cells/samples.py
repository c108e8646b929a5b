"""The keyframes that cells are measured on: decoded once, read again with each fault."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from fusion_net.common.faults import FaultPlan
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.data.datamodule import NuScenesDataset, collate
from fusion_net.data.samples import Sample
from fusion_net.evaluation.bootstrap import resample_scenes
from fusion_net.evaluation.cells.cell import Cell
from fusion_net.evaluation.cells.delays import delayed
from fusion_net.evaluation.drop_table import RESAMPLING_SEED
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.evaluation.strata import condition_of
from fusion_net.nuscenes.nuscenes import NuScenes

Index = Sequence[tuple[NuScenes, str]]


class CellSamples:
    """The samples of ``dataset``, or of ``scenes`` of its scenes, their labels, and the ``resamples`` sets of resampled scenes
    that every cell is scored on: differences between cells, and between detectors, are paired."""

    def __init__(
        self, dataset: NuScenesDataset, *, scenes: int | None, batch_size: int = 8, resamples: int = 200
    ) -> None:
        self.dataset, self.batch_size = dataset, batch_size
        self.index = thinned(dataset.index, scenes)
        self.truth = GroundTruth(self.index, classes=dataset.classes, grid=dataset.grid)
        if not len(self.truth.labels):
            raise ValueError(f"cells: nothing to score against; {dataset.why_no_labels()}")
        self.copies = resample_scenes(
            self.truth.scenes, resamples=resamples, rng=np.random.default_rng(RESAMPLING_SEED)
        )
        self.rig = {name for nusc in dataset.datasets for name in nusc.modalities.values()}
        self.scenes = len(set(self.truth.scenes))

    def lacks(self, cell: Cell) -> list[str]:
        """The sensors that something is to happen to in ``cell`` and that the rig does not have."""
        known = self.rig | {channel for nusc in self.dataset.datasets for channel in nusc.modalities}
        return sorted(cell.sensors - known)

    def batches(self, cell: Cell) -> list[Batch]:
        """Everything once, with the fault of a cell. Within ``keeping_files`` no file is decoded twice."""
        faults = list(cell.faults)
        for nusc in self.dataset.datasets:
            FaultPlan(faults).check(nusc.modalities, nusc.beams)
        reader = replace(self.dataset.reader, faults=faults, fault_seed=0)
        samples = []
        for nusc, token in self.index:
            sample = reader.read(nusc, token)
            samples.append(delayed(sample, nusc, cell.delay) if cell.delay else sample)
        return [self._batch(samples[at : at + self.batch_size], cell) for at in range(0, len(samples), self.batch_size)]

    def _batch(self, samples: list[Sample], cell: Cell) -> Batch:
        batch = collate(samples)
        if not cell.silent:
            return batch
        there = torch.tensor([name in self.rig and name in self.dataset.reader.modalities for name in MODALITIES])
        return replace(batch, present=there.expand_as(batch.present).clone())


def thinned(index: Index, scenes: int | None) -> list[tuple[NuScenes, str]]:
    """The samples of so many scenes, evenly spread over the conditions; of all where it is None or there are no more."""
    of_scene = {nusc.scene(token)["token"]: nusc.scene(token) for nusc, token in index}
    if scenes is None or scenes >= len(of_scene):
        return list(index)
    if scenes < 1:
        raise ValueError(f"scenes={scenes} is no number of scenes; use 1 to {len(of_scene)}, or null for all")
    ordered = sorted(
        of_scene, key=lambda token: (condition_of(of_scene[token], by_severity=True), of_scene[token]["name"])
    )
    chosen = {ordered[place] for place in (2 * np.arange(scenes) + 1) * len(ordered) // (2 * scenes)}
    return [(nusc, token) for nusc, token in index if nusc.scene(token)["token"] in chosen]
