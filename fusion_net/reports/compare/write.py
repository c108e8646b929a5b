"""The page of several runs side by side, and the same as Markdown."""

import hashlib
import shlex
from collections.abc import Sequence
from pathlib import Path

from fusion_net.reports.compare.pages import as_html, as_markdown
from fusion_net.reports.compare.runs import read_evaluations

LONGEST = 100
"""Characters of the folder that a comparison gets by default."""


def write_comparison(folders: Sequence[str], *, out: str | None = None) -> Path:
    """Writes ``compare.html`` and ``compare.md`` and returns the page's path."""
    runs = read_evaluations(folders)
    target = Path(out) if out else Path("runs/compare") / folder_name([run.label for run in runs])
    target.mkdir(parents=True, exist_ok=True)
    typed = f"python -m fusion_net.reports.compare {shlex.join(folders)}"
    (target / "compare.md").write_text(as_markdown(runs, typed), encoding="utf-8")
    page = target / "compare.html"
    page.write_text(as_html(runs, typed), encoding="utf-8")
    print(f"comparison: {page}")
    return page


def folder_name(labels: Sequence[str]) -> str:
    """Of a comparison of runs with these labels, at most ``LONGEST`` characters; where some are cut off, what tells two
    comparisons apart may be among them, and a hash of all ends the name."""
    name = "_".join(label.replace("/", "-") for label in labels)
    if len(name) <= LONGEST:
        return name
    digest = hashlib.sha256(name.encode(errors="surrogateescape")).hexdigest()[:10]
    return f"{name[: LONGEST - len(digest) - 1]}-{digest}"
