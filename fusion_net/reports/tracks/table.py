"""The figures of tracks as text, Markdown and JSON."""

import json
import math
from pathlib import Path
from typing import Any

from fusion_net.metrics.tracking import FIGURES, TrackingMetrics
from fusion_net.reports.tables import SHORT, aligned, interval_text, number, piped

SHOWN = ("recall", "mota", "motp", "ids", "frag", "mt", "ml", "fp", "fn")
COUNTS = ("ids", "frag", "mt", "ml", "fp", "fn")
NOTES = (
    "AMOTA (higher is better) and AMOTP (m, lower): means over 40 recalls; the other figures are of the score threshold of the"
    " best MOTA of each class, counts added up over classes.",
    "For what is on the BEV grid and passes nuScenes' filter, over the classes that nuScenes tracks. official: what the"
    " nuScenes devkit computes from the result file, all around the car.",
    "[95 %]: bootstrap interval over scenes; delta: of the difference from the first row's AMOTA on the same resamples.",
    "IDS: an object is followed by another track than before; FRAG: it is lost and found again; MT, ML: objects followed in at"
    " least 80 % and in less than 20 % of their keyframes.",
)


def as_row(name: str, own: TrackingMetrics, official: TrackingMetrics) -> dict[str, Any]:
    """What ``tracks.json`` holds of one set of tracks; null for what no class defines."""
    return {
        "tracks": name,
        **{figure: _plain(own.total(figure)) for figure in FIGURES},
        "AMOTA_official": _plain(official.total("amota")),
        "AMOTP_official": _plain(official.total("amotp")),
        "classes": {
            figure: {k: _plain(v) for k, v in own.of(figure).items()} for figure in ("amota", "amotp", "ids", "gt")
        },
    }


def write_tables(folder: Path, doc: dict[str, Any]) -> None:
    """Writes ``tracks.{json,md}``."""
    (folder / "tracks.json").write_text(json.dumps(doc, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    notes = [f"* {note}" for note in doc["notes"]]
    parts = [_title(doc), "", *piped(_totals(doc)), "", *piped(_classes(doc)), "", *notes]
    (folder / "tracks.md").write_text("\n".join(parts) + "\n", encoding="utf-8")


def as_text(doc: dict[str, Any]) -> str:
    """Both tables for a terminal."""
    return "\n".join([_title(doc), "", *aligned(_totals(doc)), "", *aligned(_classes(doc)), "", *doc["notes"]])


def _title(doc: dict[str, Any]) -> str:
    return f"{doc['run']}: tracks, {doc['num_scenes']} scenes, {doc['num_samples']} samples of {doc['split']}"


def _totals(doc: dict[str, Any]) -> list[list[str]]:
    head = [
        "tracks of",
        "AMOTA",
        "[95 %]",
        "delta [95 %]",
        "AMOTP m",
        *(name.upper() for name in SHOWN),
        "official AMOTA",
        "AMOTP",
    ]
    rows = [
        [
            row["tracks"],
            number(row["amota"]),
            interval_text(row["AMOTA_ci95"]),
            "" if row is doc["rows"][0] else interval_text(row["delta_AMOTA_ci95"]),
            number(row["amotp"]),
            *(_count(row[name]) if name in COUNTS else number(row[name]) for name in SHOWN),
            number(row["AMOTA_official"]),
            number(row["AMOTP_official"]),
        ]
        for row in doc["rows"]
    ]
    return [head, *rows]


def _classes(doc: dict[str, Any]) -> list[list[str]]:
    names = list(doc["rows"][0]["classes"]["amota"])
    head = ["AMOTA", *(SHORT.get(name, name) for name in names)]
    rows = [[row["tracks"], *(number(row["classes"]["amota"][name]) for name in names)] for row in doc["rows"]]
    return [head, *rows, ["labels", *(_count(doc["rows"][0]["classes"]["gt"][name]) for name in names)]]


def _count(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def _plain(value: float) -> float | None:
    return None if math.isnan(value) else value
