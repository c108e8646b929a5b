"""Scores a tracking result file with the official nuScenes devkit; run it inside the environment that setup.sh makes.

.venv-devkit/bin/python tools/devkit/score_tracks.py --root data/sequence --split sequence_val --results tracks_nusc.json
"""

import argparse
import json
import tempfile
import time
import warnings
from pathlib import Path

from nuscenes.eval.common.config import config_factory
from nuscenes.eval.tracking.evaluate import TrackingEval
from tree import version_of

SHOWN = ("amota", "amotp", "mota", "motp", "recall", "ids", "frag", "tp", "fp", "fn", "mt", "ml", "faf", "tid", "lgd")


def score(root: Path, split: str, results: Path) -> dict:
    """The devkit's ``metrics_summary`` with ``seconds``: reading and filtering, evaluating."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        evaluation = TrackingEval(
            config_factory("tracking_nips_2019"),
            str(results),
            split,
            folder,
            version_of(root),
            str(root),
            verbose=False,
        )
        read = time.perf_counter()
        metrics, _ = evaluation.evaluate()
        summary = json.loads(json.dumps(metrics.serialize()))
    return summary | {"seconds": {"boxes": read - start, "metric": time.perf_counter() - read}}


def main() -> None:
    """Prints the score, or writes it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, required=True, help="nuScenes tree")
    parser.add_argument("--split", required=True, help="name in splits.json, such as sequence_val")
    parser.add_argument("--results", type=Path, required=True, help="tracks_nusc.json")
    parser.add_argument("--json", type=Path, help="where to write all figures")
    arguments = parser.parse_args()
    summary = score(arguments.root, arguments.split, arguments.results)
    if arguments.json:
        arguments.json.write_text(json.dumps(summary), encoding="utf-8")
    print("  ".join(f"{name} {summary[name]:.6g}" for name in SHOWN))
    for name, amota in summary["label_metrics"]["amota"].items():
        print(f"{name:12} AMOTA {amota:.3f}  ids {summary['label_metrics']['ids'][name]:.0f}")


if __name__ == "__main__":
    main()
