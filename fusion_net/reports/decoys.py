"""The decoy audit as plain text, Markdown and CSV."""

import csv
import io
from pathlib import Path
from typing import Any

from fusion_net.reports.tables import SHORT, aligned, name_of, number, piped

Audit = list[dict[str, Any]]

TITLE = "decoys: which sensors tell a standing object from a body that copies it"
NOTES = (
    "AUC: how often the score at a real object is above the score at its decoy; 1: always told apart, 0.5: never.",
    "found: fraction of the real objects / of the decoys with a detection of the class above the score of its best F1.",
)


def write(folder: Path, audit: Audit) -> None:
    """Writes ``decoys.{csv,md}``, or removes what an earlier evaluation left where the data has no decoys."""
    for name, render in (("decoys.csv", as_csv), ("decoys.md", as_markdown)):
        if audit:
            (folder / name).write_text(render(audit), encoding="utf-8")
        else:
            (folder / name).unlink(missing_ok=True)


def as_text(audit: Audit) -> str:
    """Both tables aligned for a terminal."""
    return "\n".join([TITLE, "", *aligned(_separation(audit)), "", *aligned(_found(audit)), "", *NOTES])


def as_markdown(audit: Audit) -> str:
    """Both tables for a README."""
    notes = [f"* {note}" for note in NOTES]
    return "\n".join([TITLE, "", *piped(_separation(audit)), "", *piped(_found(audit)), "", *notes]) + "\n"


def as_csv(audit: Audit) -> str:
    """One line per class and subset of sensors."""
    target = io.StringIO()
    writer = csv.writer(target, lineterminator="\n")
    writer.writerow(["imitates", "sensors", "AUC", "real_found", "decoys_found", "real", "decoys"])
    for kind in audit:
        for row in kind["rows"]:
            figures = [row[name] for name in ("AUC", "real_found", "decoys_found")]
            writer.writerow([kind["imitates"], name_of(row["sensors"]), *figures, kind["real"], kind["decoys"]])
    return target.getvalue()


def _separation(audit: Audit) -> list[list[str]]:
    counts = [[name, *(str(kind[name]) for kind in audit)] for name in ("real", "decoys")]
    return [_head("AUC", audit), *_rows(audit, lambda row: number(row["AUC"])), *counts]


def _found(audit: Audit) -> list[list[str]]:
    return [_head("found", audit), *_rows(audit, lambda r: f"{number(r['real_found'])}/{number(r['decoys_found'])}")]


def _head(title: str, audit: Audit) -> list[str]:
    return [title, *[str(SHORT.get(kind["imitates"], kind["imitates"])) for kind in audit]]


def _rows(audit: Audit, cell: Any) -> list[list[str]]:
    return [
        [name_of(rows[0]["sensors"]), *(cell(row) for row in rows)]
        for rows in zip(*(kind["rows"] for kind in audit), strict=True)
    ]
