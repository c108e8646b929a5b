"""The folders of the evaluations that a comparison names, found without torch: what lacks is answered before it is imported."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from fusion_net.common.cli.command_line import command_line
from fusion_net.reports.run_result import RESULT
from fusion_net.runs.run_dir import load_config
from fusion_net.runs.sources import EVALUATIONS, shipped_path

FILES = (Path(RESULT).name, "report.json", "drop_table.json")
"""What an evaluation leaves and a comparison reads."""


def find_evaluations(folders: Sequence[str]) -> list[Path]:
    """The folder of each evaluation, by itself or by its run. ValueError for fewer than two, FileNotFoundError, with the
    command that makes it, for one that is not there."""
    if len(set(folders)) < 2:
        raise ValueError("name two runs at least: python -m fusion_net.reports.compare runs/A runs/B")
    return [_place(Path(folder)) for folder in folders]


def _place(folder: Path) -> Path:
    for place in (folder, folder / "eval"):
        if (place / FILES[0]).exists():
            if missing := [file for file in FILES if not (place / file).exists()]:
                raise FileNotFoundError(f"{place} has no {missing[0]}; score it again: {_scoring(folder)}")
            return place
    scoring = _scoring(folder)
    below = sorted(path.parent.as_posix() for path in folder.rglob(FILES[0]))
    known = f"there are {', '.join(shlex.quote(place) for place in below)}: name one of them, or " if below else ""
    raise FileNotFoundError(f"no evaluation in {folder}; {known}score it: {scoring}")


def _scoring(folder: Path) -> str:
    """The command that scores what a folder is of: shipped weights, or a run that it is or lies in. FileNotFoundError, with
    what there is instead, where there is no such thing."""
    if folder.is_relative_to(EVALUATIONS) and folder != EVALUATIONS:
        name = folder.relative_to(EVALUATIONS).parts[0]
        shipped_path(name)
        return command_line("eval.py", checkpoint=name)
    run = next((each for each in (folder, *folder.parents) if (each / "config.yaml").exists()), folder)
    load_config(run)
    return command_line("eval.py", run=run)
