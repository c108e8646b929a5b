"""Early, mid and late fusion in one table: what is missing is measured, and all of it written."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from fusion_net.evaluation.cells.plan import plan
from fusion_net.evaluation.cells.store import write_cells
from fusion_net.reports.ablation.jobs import collect
from fusion_net.reports.levels.measured import Asked, Measured, measured_cells
from fusion_net.reports.levels.pages import as_markdown, as_text
from fusion_net.reports.levels.plot import plot_levels
from fusion_net.reports.levels.runs import find_levels
from fusion_net.reports.levels.summary import summarise
from fusion_net.reports.run_result import rounded

CELLS = "cells"
"""Folder of the committed cells, beside the page."""


def write_levels(
    folder: Path,
    *,
    results: Path,
    pages: Path,
    groups: Sequence[str],
    asked: Asked,
    quick: bool = False,
    seeds: Sequence[int] = (1,),
    other_lidar: str | None = None,
    keep: bool = False,
    only_read: bool = False,
    typed: str = "",
) -> Path:
    """Measures the cells that the runs with these ``seeds`` lack, and writes ``levels.{md,json,png}`` into ``folder``, or with
    ``keep`` into ``pages``/NAME, after results and cells went to ``results``/NAME and ``pages``/NAME/cells. Returns where."""
    cells = plan(groups, quick=quick, other_lidar=other_lidar)
    committed = pages / folder.name
    runs = find_levels(folder, results / folder.name)
    if unknown := sorted({*seeds} - {run.job.seed for run in runs}):
        known = ",".join(str(seed) for seed in sorted({run.job.seed for run in runs}))
        raise ValueError(
            f"seeds={list(seeds)}: no run of {folder} has seed {unknown[0]}; write 'seeds=[{known}]', or less"
        )
    measured, notes = measured_cells(
        [run for run in runs if run.job.seed in seeds], cells, asked, committed=committed / CELLS, only_read=only_read
    )
    doc = {"sweep": folder.name, "command": typed, "quick": quick, "samples": asked.tag, "notes": notes}
    doc |= summarise(runs, measured)
    target = folder
    if keep:
        written = collect([run.job for run in runs], results / folder.name)
        _collect_cells(measured, committed / CELLS, asked.tag)
        print(f"{results / folder.name}: {len(written)} results new or changed", file=sys.stderr)
        target = committed
    target.mkdir(parents=True, exist_ok=True)
    (target / "levels.json").write_text(json.dumps(rounded(doc), indent=1) + "\n", encoding="utf-8")
    (target / "levels.md").write_text(as_markdown(doc), encoding="utf-8")
    plot_levels(target / "levels.png", doc)
    print(as_text(doc))
    print(f"\nwrote {target}/levels.{{md,json,png}}", file=sys.stderr)
    return target


def _collect_cells(measured: Sequence[Measured], committed: Path, tag: str) -> None:
    for each in measured:
        for group, cells in each.groups.items():
            write_cells(committed / each.run.job.name / tag / f"{group}.json", each.about, cells)
