"""How honest the covariances of late fusion are, as files beside the drop table."""

import json
from pathlib import Path
from typing import Any

from fusion_net.models.late.calibration import LEAST_MATCHES
from fusion_net.reports.tables import number, piped

NOTES = (
    "NIS: mean squared normalised innovation, 2 if the covariances are honest, above 2: overconfident. 95 %: share of the"
    " errors within the ellipse that should hold 95 %. NLL in nats. No gate but the 4 m within which boxes match labels.",
    "The rules below the sensors: boxes that several detectors share, merged by each rule. sigma: mean standard deviation that"
    " the covariances claim along and across the ray, metres.",
    "The rules of the model in the first row of the second table, then all of them but one; all sensors present.",
    f"Factors are on the head's variances, fitted on training scenes that were kept from training; a class with fewer than"
    f" {LEAST_MATCHES} matches there has the factors of all classes together.",
)


def write(folder: Path, doc: dict[str, Any]) -> None:
    """Writes ``late_calibration.{json,md}``."""
    (folder / "late_calibration.json").write_text(json.dumps(doc, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    (folder / "late_calibration.md").write_text(as_markdown(doc), encoding="utf-8")


def as_markdown(doc: dict[str, Any]) -> str:
    """The three tables, and what they mean."""
    notes = [f"* {note}" for note in NOTES]
    title = f"Covariances of late fusion against the labels of {doc['samples']} samples"
    tables = (piped(table) for table in (_consistency(doc), _rules(doc), _factors(doc)))
    return "\n".join([title, *(line for table in tables for line in ("", *table)), "", *notes]) + "\n"


def _consistency(doc: dict[str, Any]) -> list[list[str]]:
    head = ["", "range m", "matches", "NIS", "95 %", "NLL", "sigma along", "across", "velocity NIS", "95 %"]
    names = ("NIS", "coverage95", "NLL", "sigma_along", "sigma_across", "velocity_NIS", "velocity_coverage95")
    rows = [
        [
            row["of"].replace("_", " "),
            _range(*row["range"]),
            str(row["matches"]),
            *(number(row[name]) for name in names),
        ]
        for row in doc["rows"]
    ]
    return [head, *rows]


def _range(low: float, high: float | None) -> str:
    return "all" if high is None else f"{low:g} to {high:g}"


def _rules(doc: dict[str, Any]) -> list[list[str]]:
    head = ["association", "merge", "score", "mAP", "NDS", "mATE m", "mAVE m/s"]
    keys, figures = ("association", "merge", "score"), ("mAP", "NDS", "mATE", "mAVE")
    return [head] + [
        [*(row[key].replace("_", " ") for key in keys), *(number(row[key]) for key in figures)] for row in doc["rules"]
    ]


def _factors(doc: dict[str, Any]) -> list[list[str]]:
    head = ["sensor", "class", "matches", "variance along", "across", "velocity sigma along, m/s", "across"]
    return [head] + [
        [sensor, label.replace("_", " "), str(each["matches"])]
        + [f"{value:.2f}" for value in (*each["variance_factor"], *each["velocity_sigma"])]
        for sensor, found in doc["calibration"].items()
        for label, each in found["classes"].items()
    ]
