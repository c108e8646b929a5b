"""Puts several runs side by side: ``python -m fusion_net.reports.compare runs/A runs/B``.

Settings are in ``configs/compare.yaml``.
"""

import shlex
import sys
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from omegaconf import DictConfig

from fusion_net.common.cli.command import command
from fusion_net.common.cli.command_line import as_override
from fusion_net.reports.compare.pages import as_html, as_markdown
from fusion_net.reports.compare.runs import read_evaluations

LONGEST = 100
"""Characters of the folder that a comparison gets by default."""


def write_comparison(folders: Sequence[str], *, out: str | None = None) -> Path:
    """Writes ``compare.html`` and ``compare.md`` and returns the page's path."""
    runs = read_evaluations(folders)
    name = "_".join(run.label.replace("/", "-") for run in runs)[:LONGEST]
    target = Path(out) if out else Path("runs/compare") / name
    target.mkdir(parents=True, exist_ok=True)
    typed = f"python -m fusion_net.reports.compare {shlex.join(folders)}"
    (target / "compare.md").write_text(as_markdown(runs, typed), encoding="utf-8")
    page = target / "compare.html"
    page.write_text(as_html(runs, typed), encoding="utf-8")
    print(f"comparison: {page}")
    return page


@command(config_name="compare")
def report(cfg: DictConfig) -> None:
    """Compares what ``cfg`` names."""
    write_comparison(list(cfg.runs), out=cfg.out)


def main() -> None:
    """Folders may be given without their key, first."""
    words = sys.argv[1:]
    folders = [word.rstrip("/") for word in takewhile(lambda word: "=" not in word and not word.startswith("-"), words)]
    if folders:
        sys.argv[1:] = [f"runs={as_override(folders)}", *words[len(folders) :]]
    report()


if __name__ == "__main__":
    main()
