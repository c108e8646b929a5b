"""Statistics of a data set in the nuScenes format, as one page to look at and as JSON.

    python -m fusion_net.reports.statistics data/nano [split=all] [samples=300] [out=DIR] [version=NAME]

Labels are counted in every keyframe; sensor files are opened in at most ``samples`` of them, spread evenly. Writes
``statistics.html`` (one file, pictures inside) and ``statistics.json`` into DIR, by default the data set's own folder.
"""

import json
import os
import sys
from pathlib import Path

from fusion_net.common.cli.terminal import print_any_text
from fusion_net.nuscenes.datasets import open_trees, split_of
from fusion_net.reports.dataset_page import render_page
from fusion_net.reports.dataset_summary import summarize
from fusion_net.reports.dataset_survey import survey

USAGE = "ROOT [split=NAME] [samples=N] [out=DIR] [version=NAME]"
OPTIONS = {"split": "all", "samples": "300", "out": "", "version": ""}


def main(arguments: list[str]) -> None:
    """Reads the arguments, surveys, writes."""
    root = next((a for a in arguments if "=" not in a), None)
    given = dict(a.split("=", 1) for a in arguments if "=" in a)
    wrong = sorted(given.keys() - OPTIONS.keys())
    if root is None or wrong:
        raise ValueError(f"{f'unknown {wrong[0]}=; ' if wrong else ''}usage: {USAGE}")
    options = OPTIONS | given
    if not options["samples"].isdecimal() or int(options["samples"]) < 1:
        raise ValueError(f"samples={options['samples']} is not a number of keyframes: 1 or more")
    trees = open_trees(root, options["version"] or None)
    found = survey(split_of(trees, options["split"]), files=int(options["samples"]))
    name = os.fsencode(root).decode("utf-8", errors="replace")  # whatever the locale made of it
    summary = {"root": name, "split": options["split"]} | summarize(found)
    folder = Path(options["out"] or root)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "statistics.json").write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    (folder / "statistics.html").write_text(render_page(found, summary), encoding="utf-8")
    print(
        f"{folder / 'statistics.html'}: {summary['scenes']} scenes, {summary['keyframes']} keyframes,"
        f" {summary['objects']} objects"
    )


if __name__ == "__main__":
    print_any_text()
    try:
        main(sys.argv[1:])
    except (ValueError, OSError) as error:
        sys.exit(f"error: {error}")
