"""Our detection metric against the official devkit's on the same result file: the same numbers, and how long each takes.

python -m benchmarks.metric                                                     a random tree of 320 samples
python -m benchmarks.metric --root data/nano --split nano_val --results runs/demo/eval/results_nusc.json
"""

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.evaluation.bootstrap import bootstrap_map, resample_scenes
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.metrics.detection import DetectionMetric, DetectionMetrics
from fusion_net.metrics.matching import TP_ERRORS
from fusion_net.metrics.results import read_results
from fusion_net.metrics.sample_boxes import labelled
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.random_tree import SPLIT, make_results, make_tables, write_tree

DEVKIT = Path(__file__).parents[1] / ".venv-devkit/bin/python"
DEVKIT_ERRORS = ("trans_err", "scale_err", "orient_err", "vel_err", "attr_err")
TOLERANCE = 1e-6
RESAMPLES = 200
GRID = BEVGrid(-51.2, 51.2, -51.2, 51.2, 0.8)  # the official score does not depend on it


def ours(root: Path, split: str, results: Path) -> tuple[DetectionMetrics, dict[str, float]]:
    """Our official score of a result file, and seconds: the tree, the boxes, the metric, the bootstrap of its mAP."""
    DetectionMetric()(labelled([]), labelled([]), 0)  # compiles the matcher
    clock = [time.perf_counter()]
    tree = NuScenes(root)
    clock.append(time.perf_counter())
    truth = GroundTruth([(tree, token) for token in tree.split(split)], classes=CLASSES, grid=GRID)
    found = read_results(results, tokens=truth.tokens, classes=CLASSES)
    clock.append(time.perf_counter())
    matches = truth.official_matches(found)
    score = truth.official_metric.summarise(matches)
    clock.append(time.perf_counter())
    draws = resample_scenes(truth.scenes, resamples=RESAMPLES, rng=np.random.default_rng(0))
    bootstrap_map(truth.official_metric, matches, draws)
    clock.append(time.perf_counter())
    names = ("tree", "boxes", "metric", f"bootstrap_{RESAMPLES}")
    return score, dict(zip(names, np.diff(clock).tolist(), strict=True))


def devkit(root: Path, split: str, results: Path) -> dict:
    """The devkit's score of the same file, from its own environment."""
    if not DEVKIT.exists():
        raise SystemExit(f"error: no {DEVKIT}; make it with tools/devkit/setup.sh")
    script = Path(__file__).parents[1] / "tools/devkit/score.py"
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "summary.json"
        command = [DEVKIT, script, "--root", root, "--split", split, "--results", results, "--json", target]
        done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"error: the devkit refused {results}: {done.stderr.strip().splitlines()[-1]}")
        return json.loads(target.read_text(encoding="utf-8"))


def largest_difference(score: DetectionMetrics, summary: dict) -> float:
    """Over AP by class and distance, errors by class, mAP, mean errors and NDS. NaN must meet NaN."""
    differences = [abs(score.mAP - summary["mean_ap"]), abs(score.NDS - summary["nd_score"])]
    for k, name in enumerate(score.classes):
        theirs = [summary["label_tp_errors"][name][error] for error in DEVKIT_ERRORS]
        undefined = np.isnan(np.array(theirs, float))
        if (undefined != np.isnan(score.errors[k])).any():
            return np.inf
        differences += [np.abs(score.ap[k] - list(summary["label_aps"][name].values())).max()]
        differences += [np.abs(score.errors[k] - theirs)[~undefined].max()]
    differences += [np.abs(score.mean_errors - [summary["tp_errors"][error] for error in DEVKIT_ERRORS]).max()]
    return float(max(differences))


def main() -> None:
    """Compares and prints; exit code 1 when the two differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, help="nuScenes tree")
    parser.add_argument("--split", default=SPLIT, help="name in its splits.json")
    parser.add_argument("--results", type=Path, help="results_nusc.json")
    arguments = parser.parse_args()
    if (arguments.root is None) != (arguments.results is None):
        parser.error("--root and --results go together")
    with tempfile.TemporaryDirectory() as folder:
        root, results = arguments.root or Path(folder), arguments.results or Path(folder) / "results.json"
        if arguments.root is None:
            rng = np.random.default_rng(0)
            tables = make_tables(rng, scenes=80, keyframes=4, objects=25)
            write_tree(root, tables)
            results.write_text(json.dumps(make_results(tables, rng, boxes=100)), encoding="utf-8")
        score, seconds = ours(root, arguments.split, results)
        summary = devkit(root, arguments.split, results)
    _report(score, seconds, summary)


def _report(score: DetectionMetrics, seconds: dict[str, float], summary: dict) -> None:
    theirs, difference = summary["seconds"], largest_difference(score, summary)
    print(f"{'':14}{'ours':>12}{'devkit':>12}")
    rows = [("mAP", score.mAP, summary["mean_ap"]), ("NDS", score.NDS, summary["nd_score"])]
    mean_errors = [summary["tp_errors"][error] for error in DEVKIT_ERRORS]
    for name, mine, official in [*rows, *zip(TP_ERRORS, score.mean_errors, mean_errors, strict=True)]:
        print(f"{name:14}{mine:12.6f}{official:12.6f}")
    for name, value in seconds.items():
        print(f"{name + ' s':14}{value:12.3f}" + (f"{theirs[name]:12.3f}" if name in theirs else ""))
    print(f"largest difference of any figure {difference:.1e}")
    ratio = {name: theirs[name] / seconds[name] for name in theirs}
    same = difference < TOLERANCE
    print(
        json.dumps(
            {"seconds": seconds, "devkit_seconds": theirs, "ratio": ratio, "difference": difference, "same": same}
        )
    )
    raise SystemExit(0 if same else 1)


if __name__ == "__main__":
    main()
