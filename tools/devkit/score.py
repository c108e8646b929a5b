"""Scores a result file with the official nuScenes devkit; run it inside the environment that setup.sh makes.

.venv-devkit/bin/python tools/devkit/score.py --root data/nano --split nano_val --results results_nusc.json
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

from nuscenes.eval.common.config import config_factory
from nuscenes.eval.detection.evaluate import DetectionEval
from tree import open_tree


def score(root: Path, split: str, results: Path) -> dict:
    """The devkit's ``metrics_summary`` with ``seconds``: loading the tree, loading the boxes, evaluating."""
    start = time.perf_counter()
    tree = open_tree(root)
    loaded = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        evaluation = DetectionEval(
            tree, config_factory("detection_cvpr_2019"), str(results), split, folder, verbose=False
        )
        read = time.perf_counter()
        metrics, _ = evaluation.evaluate()
    seconds = {"tree": loaded - start, "boxes": read - loaded, "metric": time.perf_counter() - read}
    return json.loads(json.dumps(metrics.serialize())) | {"seconds": seconds}


def main() -> None:
    """Prints the score, or writes it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, required=True, help="nuScenes tree")
    parser.add_argument("--split", required=True, help="name in splits.json, such as nano_val")
    parser.add_argument("--results", type=Path, required=True, help="results_nusc.json")
    parser.add_argument("--json", type=Path, help="where to write all figures")
    arguments = parser.parse_args()
    summary = score(arguments.root, arguments.split, arguments.results)
    if arguments.json:
        arguments.json.write_text(json.dumps(summary), encoding="utf-8")
    print(f"mAP {summary['mean_ap']:.6f}  NDS {summary['nd_score']:.6f}")
    print("  ".join(f"{name} {value:.4f}" for name, value in summary["tp_errors"].items()))
    print("  ".join(f"{name} {value:.3f}" for name, value in summary["mean_dist_aps"].items()))


if __name__ == "__main__":
    main()
