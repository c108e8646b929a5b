"""Damages copies of a tree, one fault of its radars at a time, and lists which checks catch each.

.venv-devkit/bin/python tools/devkit/mutations.py --root data/nano --root data/surround --docs docs/oracle.md
"""

import argparse
import json
import re
import sys
import tempfile
from pathlib import Path

from check_radar import check_radar
from check_radar_motion import check_mounts, check_radar_motion
from check_radar_rcs import check_radar_rcs
from check_tables import check_tables
from faulty_copy import FaultyCopy
from findings import Finding
from radar_faults import FAULTS
from radar_scans import radar_scans
from tree import open_tree

BEGIN, END = "<!-- mutations: begin -->", "<!-- mutations: end -->"


def findings_of(root: Path) -> list[Finding]:
    """What the tables and the radars of a tree show."""
    tree = open_tree(root)
    scans = radar_scans(tree, tree.sample)
    return [
        *check_tables(tree), *check_mounts(tree), *check_radar_motion(tree, scans), *check_radar(scans),
        *check_radar_rcs(scans),
    ]  # fmt: skip


def caught(root: Path, chosen: str) -> dict[str, dict]:
    """By fault, the check that was made for it, and the radars and ages at which each check that failed did; the tree itself is
    "nothing"."""
    found = {"nothing": {"check": "", "failed": _failed(root)}}
    for name, (damage, check) in FAULTS.items():
        if re.search(chosen, name):
            with tempfile.TemporaryDirectory(dir=root.parent, prefix=".mutation-") as folder:
                copy = FaultyCopy(root, Path(folder) / "tree")
                damage(copy)
                failed = _failed(copy.root)
            found[name] = {"check": check, "failed": failed}
            print(f"{root.name}: {name}: {', '.join(failed) or 'not caught'}", file=sys.stderr)
    return found


def _failed(root: Path) -> dict[str, list[str]]:
    failed: dict[str, list[str]] = {}
    for finding in findings_of(root):
        if not finding.passed:
            what, _, first = finding.what.partition(" (first: ")
            failed.setdefault(what, []).append(finding.case or first.rstrip(")"))
    return failed


def _table(found: dict[str, dict]) -> str:
    """Markdown: the check that was made for the fault, how many others fail too, by tree."""
    lines = [
        "| fault | check that catches it | " + " | ".join(f"`{name}`" for name in found) + " |",
        "|---|---|" + "---|" * len(found),
    ]
    for name, (_, check) in FAULTS.items():
        cells = []
        for faults in found.values():
            failed = faults[name]["failed"] if name in faults else None
            others = 0 if failed is None else len(failed) - (check in failed)
            verdict = "not tried" if failed is None else "yes" if check in failed else "no"
            cells.append(verdict + (f", {others} more" if others else ""))
        lines.append(f"| {name} | {check} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Prints the table, or writes it into a document between its marks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, action="append", required=True, help="nuScenes tree; may be given again")
    parser.add_argument("--only", default="", help="faults whose name this regular expression finds")
    parser.add_argument("--docs", type=Path, help="document to write the table into")
    parser.add_argument("--json", type=Path, help="where to write all that failed")
    arguments = parser.parse_args()
    found = {root.name: caught(root, arguments.only) for root in arguments.root}
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if arguments.docs:
        marked = re.compile(f"{BEGIN}.*{END}", re.DOTALL)
        text = arguments.docs.read_text(encoding="utf-8")
        arguments.docs.write_text(marked.sub(lambda _: f"{BEGIN}\n{_table(found)}\n{END}", text), encoding="utf-8")
    elif not arguments.json:
        print(_table(found))


if __name__ == "__main__":
    main()
