"""Writes the golden case of the tracking metric's test: a random tree, a tracking result file and the devkit's score of it.

PYTHONPATH=. .venv-devkit/bin/python tools/devkit/make_golden_tracks.py tests/fusion_net/golden/tracking_metric.json
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from make_golden import rounded
from score_tracks import score

from tests.fixtures.random_tree import SPLIT, make_tables, make_tracks, write_tree


def main(path: Path) -> None:
    """Two scenes of eight keyframes; no bus is predicted, no trailer labelled."""
    rng = np.random.default_rng(3)
    tables = rounded(make_tables(rng, scenes=2, keyframes=8, objects=32, absent="trailer"))
    results = rounded(make_tracks(tables, rng, unpredicted="bus"))
    with tempfile.TemporaryDirectory() as folder:
        write_tree(Path(folder), tables)
        result_file = Path(folder) / "tracks.json"
        result_file.write_text(json.dumps(results), encoding="utf-8")
        summary = score(Path(folder), SPLIT, result_file)
    kept = {name: value for name, value in summary.items() if name not in ("cfg", "eval_time", "seconds")}
    golden = {"tables": tables, "results": results, "summary": kept}
    path.write_text(json.dumps(golden, separators=(",", ":")) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
