"""Writes the golden case of the metric's test: a random tree, a result file and the devkit's score of it.

PYTHONPATH=. .venv-devkit/bin/python tools/devkit/make_golden.py tests/fusion_net/golden/detection_metric.json
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from score import score

from tests.fixtures.random_tree import SPLIT, make_results, make_tables, write_tree


def main(path: Path) -> None:
    """Three scenes of two keyframes; no bus is predicted, no trailer labelled, the first sample has no box."""
    rng = np.random.default_rng(3)
    tables = rounded(make_tables(rng, scenes=3, keyframes=2, objects=36, absent="trailer"))
    results = rounded(make_results(tables, rng, boxes=60, unpredicted="bus", empty=1))
    with tempfile.TemporaryDirectory() as folder:
        write_tree(Path(folder), tables)
        result_file = Path(folder) / "results.json"
        result_file.write_text(json.dumps(results), encoding="utf-8")
        summary = score(Path(folder), SPLIT, result_file)
    kept = ("label_aps", "mean_ap", "label_tp_errors", "tp_errors", "nd_score")
    golden = {"tables": tables, "results": results, "summary": rounded({name: summary[name] for name in kept})}
    path.write_text(json.dumps(golden, separators=(",", ":")) + "\n", encoding="utf-8")


def rounded(value):
    """The value with nine decimals a number: what is on disk is what is scored, and the same on any processor (numpy and
    BLAS add up in an order that depends on its vector width, which changes a score's last bits)."""
    return json.loads(json.dumps(value), parse_float=lambda text: round(float(text), 9))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
