"""Measures the cells that are missing, for all runs at once, and gives those that there are."""

import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tqdm import tqdm

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.evaluation.cells.cell import Cell
from fusion_net.evaluation.cells.costs import dependent_parameters, input_bytes, merged_bytes, stage_times
from fusion_net.evaluation.cells.measure import measure
from fusion_net.evaluation.cells.plan import SOUND
from fusion_net.evaluation.cells.samples import CellSamples
from fusion_net.evaluation.cells.store import ABOUT, CellStore, read_cells
from fusion_net.models.precision import autocast
from fusion_net.nuscenes.kept_files import keeping_files
from fusion_net.reports.levels.runs import LevelRun, weights_hash
from fusion_net.runs.environment import environment
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import Trained, trained_run

COSTS = "costs"
"""Group and name of what a run costs beside its scores."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """On which samples cells are measured. ``scenes``: None for all of the split."""

    split: str | None = None
    scenes: int | None = None
    batch_size: int = 8
    resamples: int = 200

    @property
    def tag(self) -> str:
        """Name of the folder of its cells."""
        return f"{self.split or 'val'}-{self.scenes or 'all'}"


@dataclass
class Measured:
    """The cells of one run: ``groups[group][name]``, and what could not be measured, a line each."""

    run: LevelRun
    groups: dict[str, dict[str, Any]] = field(default_factory=dict)
    about: dict[str, Any] = field(default_factory=dict)


def measured_cells(
    runs: Sequence[LevelRun], cells: Sequence[Cell], asked: Asked, *, committed: Path, only_read: bool = False
) -> tuple[list[Measured], list[str]]:
    """Every run's cells, those that were missing measured now, and a line for each thing that could not be. A run whose
    weights are not here has what is committed. ``only_read``: nothing is measured."""
    here = [run for run in runs if run.is_here and not only_read]
    notes = [
        f"{run.job.name}: no weights in {run.folder}, its committed cells are shown"
        for run in runs
        if run not in here and not only_read
    ]
    found = [_committed(run, committed / run.job.name / asked.tag) for run in runs if run not in here]
    benches: dict[str, list[_Bench]] = defaultdict(list)
    for run in here:
        bench = _Bench(run, asked, committed / run.job.name / asked.tag)
        benches[bench.kind].append(bench)
    for alike in benches.values():
        notes += _fill(alike, cells, asked)
    found += [
        Measured(bench.run, bench.store.groups, bench.store.about) for alike in benches.values() for bench in alike
    ]
    return sorted(found, key=lambda each: runs.index(each.run)), notes


class _Bench:
    """A run that is here: its detector, its samples and its cells."""

    def __init__(self, run: LevelRun, asked: Asked, committed: Path) -> None:
        self.run, self.trained = run, trained_run(run.folder, "best")
        self.dataset = open_samples(self.trained, split=asked.split)
        self.kind = f"{self.dataset.reader} {self.dataset.grid} {[str(nusc.root) for nusc in self.dataset.datasets]}"
        about = {
            "run": run.job.name,
            "level": run.level,
            "seed": run.job.seed,
            "weights": weights_hash(self.trained.weights),
            "data": self.dataset.fingerprint,
            "samples": asked.tag,
        } | {name: environment()[name] for name in ("git", "processor")}
        self.store = CellStore(run.folder / "cells" / asked.tag, committed=committed, about=about)
        self.model = self.trained.model()

    @property
    def precision(self) -> str:
        """In which it was trained."""
        return str(self.trained.cfg.trainer.precision)


def _fill(benches: Sequence[_Bench], cells: Sequence[Cell], asked: Asked) -> list[str]:
    """Measures what any of these runs, which read their data alike, lacks. Returns what cannot be measured."""
    first, notes = benches[0], []
    progress = _Progress(
        [cell for cell in cells if any(bench.store.get(cell.group, cell.name) is None for bench in benches)]
    )
    for scenes, root in dict.fromkeys(
        (None if cell.every_scene else asked.scenes, cell.root) for cell in progress.cells
    ):
        samples = CellSamples(
            _dataset(first.trained, asked.split, root) if root else first.dataset,
            scenes=scenes,
            batch_size=asked.batch_size,
            resamples=asked.resamples,
        )
        own = [
            cell for cell in progress.cells if (None if cell.every_scene else asked.scenes, cell.root) == (scenes, root)
        ]
        with keeping_files():
            for cell in own:
                if lacking := samples.lacks(cell):
                    notes.append(f"{cell.group}: {cell.name} is left out: the data has no {' and no '.join(lacking)}")
                    continue
                lack = {
                    bench.run.job.name: bench for bench in benches if bench.store.get(cell.group, cell.name) is None
                }
                results = measure(
                    cell,
                    {name: bench.model for name, bench in lack.items()},
                    samples,
                    context=lambda: autocast(first.precision),
                )
                for name, result in results:
                    lack[name].store.put(cell.group, cell.name, result)
                progress.done(cell, len(lack))
            _fill_costs(benches, samples)
    return notes


def _fill_costs(benches: Sequence[_Bench], samples: CellSamples) -> None:
    missing = [bench for bench in benches if bench.store.get(COSTS, COSTS) is None]
    if not missing:
        return
    batch = samples.batches(SOUND)[0]
    for bench in missing:
        with autocast(bench.precision):
            hanging = {name: dependent_parameters(bench.model, batch, name)[0] for name in MODALITIES}
            result = {
                "batch": batch.size,
                "ms": stage_times(bench.model, batch),
                "bytes_in": input_bytes(batch),
                "bytes_merged": merged_bytes(bench.model, batch),
                "parameters": sum(parameter.numel() for parameter in bench.model.parameters()),
                "hanging": hanging,
            }
        bench.store.put(COSTS, COSTS, result)


def _dataset(trained: Trained, split: str | None, root: str) -> NuScenesDataset:
    return open_samples(trained, split=split, root=root)


def _committed(run: LevelRun, folder: Path) -> Measured:
    groups: dict[str, dict[str, Any]] = {}
    about: dict[str, Any] = {}
    for place in (folder, run.folder / "cells" / folder.name):
        for path in sorted(place.glob("*.json")):
            held = read_cells(path)
            about = held.pop(ABOUT)
            groups.setdefault(path.stem, {}).update(held)
    return Measured(run, groups, about)


class _Progress:
    """A bar on a terminal, a line with the minutes that are left elsewhere: after the third cell and each half minute."""

    def __init__(self, cells: list[Cell]) -> None:
        self.cells, self._count, self._start, self._said = cells, 0, time.monotonic(), 0.0
        self._bar = tqdm(total=len(cells), unit="cell", ascii=True) if sys.stderr.isatty() and cells else None

    def done(self, cell: Cell, runs: int) -> None:
        """Notes that a cell was measured for so many runs."""
        self._count += 1
        if self._bar is not None:
            self._bar.set_postfix_str(cell.name, refresh=False)
            self._bar.update()
            return
        now = time.monotonic()
        if self._count in (3, len(self.cells)) or now - self._said > 30:
            left = (now - self._start) / self._count * (len(self.cells) - self._count) / 60
            print(
                f"{self._count}/{len(self.cells)} cells of {runs} runs, about {left:.0f} min left ({cell.name})",
                flush=True,
            )
            self._said = now
