"""The evaluations of several runs, read from their folders, and how far they are apart."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os.path import commonpath
from pathlib import Path
from typing import Any

from fusion_net.reports.ablation.compare import difference, refuse_other_data
from fusion_net.reports.compare.folders import FILES, find_evaluations
from fusion_net.reports.run_result import read_result
from fusion_net.reports.tables import name_of

ABOUT = ("seed", "steps", "minutes", "encoders", "git", "processor", "threads")
"""What of a run's record is shown where it differs, beside its settings."""


@dataclass(frozen=True)
class Evaluation:
    """What one evaluation left. ``label``: its folder without what all have in common."""

    label: str
    folder: Path  # of result.json
    result: Mapping[str, Any]
    figures: Mapping[str, Any]
    doc: Mapping[str, Any]

    @property
    def metrics(self) -> Path:
        """The metrics.csv of its run, which may be gone."""
        return Path(self.result["run"]) / "metrics.csv"

    def row(self, name: str) -> Mapping[str, Any]:
        """The row of the drop table with these sensors."""
        return next(row for row in self.doc["rows"] if name_of(row["sensors"]) == name)


def read_evaluations(folders: Sequence[str]) -> list[Evaluation]:
    """At least two, all scored on the same samples; FileNotFoundError or ValueError where they are not."""
    places = find_evaluations(folders)
    names = [place.parent.as_posix() if place.name == "eval" else place.as_posix() for place in places]
    common = len(commonpath([str(Path(name).parent) for name in names]))
    found = []
    for place, name in zip(places, names, strict=True):
        docs = [json.loads((place / file).read_text(encoding="utf-8")) for file in FILES[1:]]
        found.append(Evaluation(name[common:].lstrip("/"), place, read_result(place / FILES[0]), *docs))
    results = {each.label: each.result for each in found}
    refuse_other_data(results, advice="score them alike, with the same split=, data.root= and bootstrap= of eval.py")
    return found


def settings_apart(evaluations: Sequence[Evaluation]) -> list[tuple[str, list[str]]]:
    """Settings, and what else is known of a run, that are not the same in all; "default" where a run kept the default."""
    keys = list(dict.fromkeys(key for each in evaluations for key in each.result["settings"]))
    rows = [(key, [_text(each.result["settings"].get(key, "default")) for each in evaluations]) for key in keys]
    rows += [(name, [_text(each.result.get(name)) for each in evaluations]) for name in ABOUT]
    rows.append(("fault", [_fault(each.doc) for each in evaluations]))
    return [(key, values) for key, values in rows if len(set(values)) > 1]


def paired(one: Evaluation, other: Evaluation, name: str) -> Mapping[str, Any]:
    """mAP of a row of ``one`` minus that of ``other``, with its interval over the same resamples of the scenes."""
    found = difference({0: one.result}, {0: other.result}, name)
    assert found is not None  # of the one seed that both have
    return found


def _text(value: Any) -> str:
    return "–" if value is None else ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _fault(doc: Mapping[str, Any]) -> str:
    return f"{doc['fault']['name']}, severity {doc['fault']['severity']}" if "fault" in doc else "none"
