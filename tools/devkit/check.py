"""Opens a tree with the official nuScenes devkit, holds its tables, boxes, sweeps and maps against each other, and draws it.

Run it inside the environment that setup.sh makes:

    .venv-devkit/bin/python tools/devkit/check.py --root data/nano --out devkit_check
"""

import argparse
import contextlib
import io
import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
from check_boxes import check_boxes
from check_counts import check_counts
from check_map import check_map
from check_radar import check_radar
from check_radar_motion import check_mounts, check_radar_motion
from check_radar_rcs import check_radar_rcs
from check_sweeps import check_sweeps
from check_tables import check_tables
from findings import Finding, report
from nuscenes import NuScenes
from pictures import draw
from radar_scans import radar_scans
from tree import open_tree


def check(tree: NuScenes, samples: int) -> list[Finding]:
    """Every finding; boxes and sweeps in at most ``samples`` keyframes, spread evenly over the tree."""
    chosen = np.unique(np.linspace(0, len(tree.sample) - 1, samples).round().astype(int))
    looked_at = [tree.sample[i] for i in chosen]
    scans = list(radar_scans(tree, looked_at))
    return [
        *check_tables(tree), *check_boxes(tree, looked_at), *check_counts(tree, looked_at),
        *check_sweeps(tree, looked_at), *check_map(tree),
        *check_mounts(tree), *check_radar_motion(tree, scans), *check_radar(scans), *check_radar_rcs(scans),
    ]  # fmt: skip


def main() -> None:
    """Prints one line a finding; anything that fails, or that the devkit refuses, ends with exit code 1."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, required=True, help="nuScenes tree")
    parser.add_argument("--samples", type=int, default=40, help="keyframes in which boxes and sweeps are looked at")
    parser.add_argument("--sample", type=int, default=0, help="which keyframe to draw, by its place in the table")
    parser.add_argument("--out", type=Path, help="folder for pictures, none by default")
    parser.add_argument("--json", type=Path, help="where to write the findings")
    arguments = parser.parse_args()
    try:
        tree = open_tree(arguments.root)
        if not 0 <= arguments.sample < len(tree.sample):
            raise SystemExit(f"error: --sample {arguments.sample} is not in 0..{len(tree.sample) - 1}")
        counts = ", ".join(f"{len(getattr(tree, name))} {name}" for name in tree.table_names)
        print(f"{arguments.root}: the devkit opens it: {counts}")
        print(_listed(tree, tree.sample[arguments.sample]["token"]))
        findings = check(tree, arguments.samples)
        print("\n".join(report(findings)))
        if arguments.out:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):  # its own bars
                paths = list(draw(tree, tree.sample[arguments.sample], arguments.out))
            print("\n".join(f"wrote {path}" for path in paths))
    except (AssertionError, KeyError, OSError, ValueError) as error:
        sys.exit(f"error: the devkit refused {arguments.root}: {type(error).__name__}: {error}")
    if arguments.json:
        arguments.json.write_text(
            json.dumps([asdict(finding) for finding in findings], indent=1) + "\n", encoding="utf-8"
        )
    failed = [finding for finding in findings if not finding.passed]
    if failed:
        sys.exit(f"error: {len(failed)} of {len(findings)} checks failed on {arguments.root}: {failed[0].what}")
    few = sum(finding.is_open for finding in findings)
    print(f"all {len(findings)} checks passed" + (f", {few} of them left open: too few cases" if few else ""))


def _listed(tree: NuScenes, token: str) -> str:
    """What ``list_sample`` prints, in short."""
    with contextlib.redirect_stdout(io.StringIO()) as text:
        tree.list_sample(token)
    return f"list_sample {token}: {len(text.getvalue().splitlines())} lines"


if __name__ == "__main__":
    main()
