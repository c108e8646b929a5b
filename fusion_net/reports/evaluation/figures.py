"""Every figure of a report as plain values: what ``report.json`` holds, and what several runs are compared by."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.evaluation.audits.shapley import shapley
from fusion_net.evaluation.bootstrap import over_scenes, resample_scenes
from fusion_net.evaluation.breakdown.confusion import confusion
from fusion_net.evaluation.breakdown.curves import precision_at_recall
from fusion_net.evaluation.breakdown.error_budget import error_budget
from fusion_net.evaluation.breakdown.operating_point import OperatingPoint, operating_point, pose_errors
from fusion_net.evaluation.decoys import read_bodies
from fusion_net.evaluation.drop_table import RESAMPLING_SEED, SUBSETS, DropTable
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.evaluation.strata import Grouping, by_condition, by_range, by_visibility, score_groups
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.reports.tables import NAMES

Figures = dict[str, Any]
RESAMPLES = 50
"""Of the scenes behind the intervals of groups and of the error budget, which are many: a quarter of the drop table's."""
SAMPLES_OF_A_CURVE = slice(0, 101, 4)
"""Recalls 0, 0.04, ... 1 of a stored curve."""


@dataclass(frozen=True)
class Scored:
    """A detector's seven rows on a split: what all figures are computed from."""

    truth: GroundTruth
    samples: Sequence[tuple[NuScenes, str]]
    table: DropTable
    points: list[OperatingPoint]  # of each row

    @staticmethod
    def of(truth: GroundTruth, samples: Sequence[tuple[NuScenes, str]], table: DropTable) -> "Scored":
        """Each row at its own thresholds of the best F1."""
        points = [
            operating_point(truth.labels, truth.counted(each), metric=truth.metric, num_samples=len(truth.tokens))
            for each in table.tables
        ]
        return Scored(truth, samples, table, points)


def figures(scored: Scored, *, resamples: int) -> Figures:
    """All of them. ``resamples``: of the scenes behind the drop table's intervals; groups take RESAMPLES of them at most."""
    truth, table = scored.truth, scored.table
    rng = np.random.default_rng(RESAMPLING_SEED)
    copies = resample_scenes(truth.scenes, resamples=resamples, rng=rng)[:RESAMPLES]
    first, bodies = truth.counted(table.tables[0]), read_bodies(truth, scored.samples)
    decoys = bodies[bodies.is_decoy & bodies.is_compared]
    metric, count, scenes = truth.metric, len(truth.tokens), len(set(truth.scenes))
    groupings = (by_range(truth), by_condition(truth, scored.samples), by_visibility(truth))
    groups = {each.axis: _groups(scored, each, copies) for each in groupings}
    return {
        "worth": _worth(table, scenes)
        | {axis: [each["worth"] for each in of_axis] for axis, of_axis in groups.items()},
        "groups": groups,
        "curves": _curves(scored),
        "confusion": confusion(truth.labels, first, decoys, metric=metric, num_samples=count),
        "pose": {name: pose_errors(point, truth.classes) for name, point in zip(NAMES, scored.points, strict=True)},
        "budget": error_budget(truth.labels, first, decoys, metric=metric, copies=copies, scenes=scenes),
        "resamples": {"groups": len(copies), "drop_table": resamples},
    }


def _worth(table: DropTable, scenes: int) -> Figures:
    """The Shapley value of each sensor: of mAP, with its interval on the drop table's resamples, and of each class's AP."""
    value = shapley({subset: row["mAP"] for subset, row in zip(SUBSETS, table.rows, strict=True)})
    spread = shapley(dict(zip(SUBSETS, table.resampled, strict=True)))
    by_class = []
    for name in table.rows[0]["AP"]:
        found = shapley({subset: row["AP"][name] for subset, row in zip(SUBSETS, table.rows, strict=True)})
        labels = table.rows[0]["num_gt"][name]
        by_class.append({"name": name, "labels": labels} | {sensor: float(each) for sensor, each in found.items()})
    return {
        "mAP": {
            sensor: {"value": float(each), "ci95": over_scenes(spread[sensor], scenes)}
            for sensor, each in value.items()
        },
        "class": by_class,
    }


def _groups(scored: Scored, grouping: Grouping, copies: NDArray[np.int64]) -> list[Figures]:
    """Of each group that has labels: their number, and mAP of each row with its interval."""
    truth = scored.truth
    of_row = [score_groups(truth, each, grouping, copies) for each in scored.table.tables]
    found = []
    for place, scores in enumerate(zip(*of_row, strict=True)):
        labels = sum(scores[0].num_gt.values())
        if not labels:
            continue
        of_sample = np.bincount(truth.labels.sample[grouping.label == place], minlength=len(truth.tokens))
        is_there = copies @ of_sample > 0  # a resample may have no scene of the group, and no score then
        value = shapley({subset: each.mAP for subset, each in zip(SUBSETS, scores, strict=True)})
        resampled = [each.resampled[is_there] if is_there.any() else each.resampled for each in scores]
        spread = shapley(dict(zip(SUBSETS, resampled, strict=True)))
        name = scores[0].name
        found.append(
            {
                "name": name,
                "labels": labels,
                "mAP": {row: each.mAP for row, each in zip(NAMES, scores, strict=True)},
                "ci95": {row: over_scenes(each, scores[0].scenes) for row, each in zip(NAMES, resampled, strict=True)},
                "AP": scores[0].AP,
                "worth": {"name": name, "labels": labels}
                | {s: float(each) for s, each in value.items()}
                | {f"{s}_ci95": over_scenes(each, scores[0].scenes) for s, each in spread.items()},
            }
        )
    return found


def _curves(scored: Scored) -> Mapping[str, Mapping[str, list[float | None]]]:
    """By class and row: precision at the stored recalls, at the distance at which errors are measured."""
    truth = scored.truth
    nearest = int(np.argmin(np.abs(np.array(truth.metric.distances) - truth.metric.tp_distance)))
    found: dict[str, dict[str, list[float | None]]] = {name: {} for name in truth.classes}
    for row, boxes in zip(NAMES, scored.table.tables, strict=True):
        for name, match in zip(truth.classes, truth.matches(boxes), strict=True):
            curve = precision_at_recall(match, nearest)[SAMPLES_OF_A_CURVE]
            found[name][row] = [None if np.isnan(value) else float(value) for value in curve]
    return found
