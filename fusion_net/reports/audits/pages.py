"""``audits/NAME.{json,png}`` and ``audits.md``: what the audits found, for people and for other reports."""

import json
from pathlib import Path
from typing import Any

from fusion_net.evaluation.audits.result import Audit
from fusion_net.reports.audits.plots import draw
from fusion_net.reports.run_result import rounded, write_result

FOLDER, PAGE, OVERLAY = "audits", "audits.md", "overlay.jpg"


def write_audit(folder: Path, audit: Audit) -> None:
    """Writes ``FOLDER/NAME.json`` and its picture below an evaluation's ``folder``."""
    target = folder / FOLDER
    target.mkdir(parents=True, exist_ok=True)
    picture = f"{audit.name}.png"
    if not draw(audit, target / picture):
        (target / picture).unlink(missing_ok=True)
        picture = ""
    doc = {
        "name": audit.name,
        "title": audit.title,
        "verdict": audit.verdict,
        "ok": audit.ok,
        "numbers": rounded(audit.numbers),
        "picture": picture,
        "explanation": audit.explanation,
    }
    write_result(target / f"{audit.name}.json", doc)


def read_audits(folder: Path) -> list[dict[str, Any]]:
    """The audits below an evaluation's ``folder``, by name. ValueError for a damaged file."""
    found = []
    for path in sorted((folder / FOLDER).glob("*.json")):
        try:
            doc = json.loads(path.read_bytes())
            doc["name"], doc["verdict"], doc["ok"], doc["numbers"]
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{path} is no audit ({type(error).__name__}: {error}); delete it") from error
        found.append(doc)
    return found


def write_page(folder: Path) -> None:
    """Writes ``audits.md`` from all audits below ``folder``, those of an earlier command included."""
    lines = ["# Audits", ""]
    for doc in read_audits(folder):
        said = "not judged" if doc["ok"] is None else "ok" if doc["ok"] else "**wrong**"
        lines += [f"## {doc['title']}", "", f"{said}: {doc['verdict']}", ""]
        lines += [f"![{doc['name']}]({FOLDER}/{doc['picture']})", ""] if doc["picture"] else []
        if doc["name"] == "calibration" and (folder / FOLDER / OVERLAY).exists():
            lines += [f"![overlay]({FOLDER}/{OVERLAY})", ""]
        lines += [doc["explanation"], ""]
    (folder / PAGE).write_text("\n".join(lines), encoding="utf-8")
