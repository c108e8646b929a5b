"""The committed result files, read once, and what is asked of them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusion_net.reports.tables import name_of

DEMO = "demo"
"""Folder of the default run's results: ``result.json`` and ``audits/``."""


@dataclass(frozen=True)
class Results:
    """``docs/results``. What is not there is None; a damaged file is a ValueError that names it."""

    root: Path

    def read(self, *parts: str) -> Any:
        """A JSON file below the root."""
        path = self.root.joinpath(*parts)
        if not path.is_file():
            return None
        try:
            held = json.loads(path.read_bytes())
        except ValueError as error:
            raise ValueError(f"{path} is damaged ({error}); check it out again") from error
        if not isinstance(held, dict) or not held:
            raise ValueError(f"{path} is damaged (it holds no table of results); check it out again")
        return held

    def shown(self, *parts: str) -> str:
        """A file as the page names it."""
        return "/".join(("docs/results", *parts))

    def demo_rows(self) -> dict[str, dict[str, Any]] | None:
        """The default run's drop table by sensors, C+L+R and so on."""
        result = self.read(DEMO, "result.json")
        return None if result is None else {name_of(row["sensors"]): row for row in result["rows"]}

    def audit(self, name: str, *, of: str = DEMO) -> dict[str, Any] | None:
        """An audit of a run whose results are kept in the folder ``of``."""
        found: dict[str, Any] | None = self.read(of, "audits", f"{name}.json")
        return found

    def variants(self, sweep: str) -> dict[str, dict[str, Any]] | None:
        """The variants of an ablation by label."""
        doc = self.read(sweep, "ablation.json")
        return None if doc is None else {variant["label"]: variant for variant in doc["variants"]}


def mean_sd(value: dict[str, Any], seeds: int) -> str:
    """Mean and standard deviation over seeds, as a cell of the page."""
    return f"{value['mean']:.2f}" + (f" +- {value['sd']:.2f}" if seeds > 1 else "")


def with_interval(row: dict[str, Any]) -> str:
    """mAP and its 95 % interval over scenes."""
    low, high = row["mAP_ci95"]
    return f"{row['mAP']:.2f} [{low:.2f}, {high:.2f}]"
