"""The drop table as plain text, Markdown, CSV and JSON."""

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fusion_net.common.modalities import letters
from fusion_net.evaluation.drop_table import SUBSETS, DropTable
from fusion_net.evaluation.scoring import FOOTNOTES
from fusion_net.metrics.matching import TP_ERRORS

SHORT = {"construction_vehicle": "constr", "pedestrian": "person", "motorcycle": "motorc", "traffic_cone": "cone"}
UNITS = {"mATE": "m", "mAOE": "rad", "mAVE": "m/s"}
NOTES = (
    *FOOTNOTES,
    "[..]: 95 % bootstrap interval over scenes; delta: difference from the first row on the same resamples.",
    "ms: forward and decoding of one sample. random: boxes of the labels' own classes and sizes at random places.",
)
ENOUGH = 5
"""Scenes that an interval needs to be printed without a word about it."""

Row = dict[str, Any]


def document(
    table: DropTable, *, run: str, split: str, num_samples: int, seed: int, command: str, git: str
) -> dict[str, Any]:
    """What ``drop_table.json`` holds: the seven rows, and the random guess beside them."""
    head = {"run": run, "split": split, "num_samples": num_samples, "seed": seed, "command": command, "git": git}
    return head | {"rows": table.rows, "random": table.random, "notes": list(NOTES)}


def write_drop_table(folder: Path, doc: dict[str, Any]) -> None:
    """Writes ``drop_table.{json,csv,md}``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "drop_table.json").write_text(json.dumps(doc, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    (folder / "drop_table.csv").write_text(as_csv(doc), encoding="utf-8")
    (folder / "drop_table.md").write_text(as_markdown(doc), encoding="utf-8")


def name_of(sensors: Sequence[str]) -> str:
    """C+L+R and so on; "random" for no sensor at all."""
    return letters(sensors) or "random"


NAMES = tuple(name_of(subset) for subset in SUBSETS)
"""Of the rows of a drop table, in its order."""


def as_text(doc: dict[str, Any]) -> str:
    """Both tables aligned for a terminal, with what the figures mean below."""
    return "\n".join([_title(doc), "", *aligned(_scores(doc)), "", *aligned(_classes(doc)), "", *doc["notes"]])


def as_markdown(doc: dict[str, Any]) -> str:
    """Both tables for a README."""
    notes = [f"* {note}" for note in doc["notes"]]
    return "\n".join([_title(doc), "", *piped(_scores(doc)), "", *piped(_classes(doc)), "", *notes]) + "\n"


def as_csv(doc: dict[str, Any]) -> str:
    """One line per row with every figure at full precision."""
    target = io.StringIO()
    lines = [_flat(row) for row in _all_rows(doc)]
    writer = csv.DictWriter(target, fieldnames=list(lines[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return target.getvalue()


def _all_rows(doc: dict[str, Any]) -> list[Row]:
    return [*doc["rows"], doc["random"]]


def _title(doc: dict[str, Any]) -> str:
    return f"{doc['run']}: what each sensor is worth, {doc['num_samples']} samples of {doc['split']}"


def _scores(doc: dict[str, Any]) -> list[list[str]]:
    errors = [f"{name} {UNITS[name]}" if name in UNITS else name for name in TP_ERRORS]
    head = ["sensors", "mAP", "[95 %]", "delta", "[95 %]", "NDS", *errors, "official mAP", "NDS", "ms"]
    return [head] + [
        [
            name_of(row["sensors"]),
            number(row["mAP"]),
            interval_text(row["mAP_ci95"]),
            "" if row is doc["rows"][0] else f"{row['delta_mAP']:+.3f}",
            "" if row is doc["rows"][0] else interval_text(row["delta_mAP_ci95"]),
            number(row["NDS"]),
            *(number(row[name]) for name in TP_ERRORS),
            number(row["mAP_official"]),
            number(row["NDS_official"]),
            f"{row['ms_per_sample']:.1f}" if row["sensors"] else "",
        ]
        for row in _all_rows(doc)
    ]


def _classes(doc: dict[str, Any]) -> list[list[str]]:
    """AP by class, and how many labels each figure rests on."""
    num_gt = doc["rows"][0]["num_gt"]
    head = ["AP", *(SHORT.get(name, name) for name in num_gt)]
    rows = [[name_of(row["sensors"]), *(number(value) for value in row["AP"].values())] for row in _all_rows(doc)]
    return [head, *rows, ["labels", *(str(count) for count in num_gt.values())]]


def _flat(row: Row) -> Row:
    flat: Row = {"sensors": name_of(row["sensors"])}
    for key, value in row.items():
        if isinstance(value, dict):
            flat |= {f"{key}_{name}": inner for name, inner in value.items()}
        elif key.endswith("_ci95"):
            flat |= {f"{key}_low": value and value[0], f"{key}_high": value and value[1]}
        elif key != "sensors":
            flat[key] = value
    return flat


def number(value: float | None) -> str:
    """Three decimals, a dash for what is not known."""
    return "-" if value is None else f"{value:.3f}"


def interval_text(ends: Sequence[float] | None, sign: str = "") -> str:
    """Both ends with three decimals, a dash where there is no interval. ``sign``: "+" shows it."""
    return f"[{ends[0]:{sign}.3f}, {ends[1]:{sign}.3f}]" if ends else "-"


def of_scenes(scenes: int) -> list[str]:
    """What to say beside intervals over so few scenes; [] where there are enough."""
    if scenes < 2:
        return ["one scene: no interval"]
    return [f"{scenes} scenes: such intervals are rough, and mostly too narrow"] if scenes < ENOUGH else []


def aligned(cells: list[list[str]]) -> list[str]:
    """Lines of a table for a terminal, the first row as its head."""
    widths = [max(len(row[i]) for row in cells) for i in range(len(cells[0]))]
    lines = [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        for row in cells
    ]
    return [lines[0], "-" * len(lines[0]), *lines[1:]]


def piped(cells: list[list[str]]) -> list[str]:
    """Lines of a Markdown table."""
    lines = [f"| {' | '.join(row)} |" for row in cells]
    return [lines[0], "|---" + "|---:" * (len(cells[0]) - 1) + "|", *lines[1:]]
