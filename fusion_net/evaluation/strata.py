"""Labels and predictions divided by condition, range or visibility, and the score of each part.

Everything is matched once, as the metric does it. A prediction that takes a label then counts in the label's group, so that
one at 20.3 m that takes a label at 19.7 m is no miss in one range and a false alarm in the next; a false alarm counts where
it lies itself, and, since nobody knows how visible it would be, in every group of visibility (as KITTI counts false alarms
in each of its difficulties, Geiger et al. 2012).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.nuscenes_format import VISIBILITY_LEVELS
from fusion_net.evaluation.bootstrap import bootstrap_map, over_scenes
from fusion_net.evaluation.scoring import GroundTruth, table_order
from fusion_net.metrics.matching import ClassMatches
from fusion_net.metrics.sample_boxes import SampleBoxes
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.table_fields import Record

RANGES = (20.0, 35.0)
"""Metres from the car at which one range ends and the next begins."""
FARTHEST = 51
"""Metres: what the last range is said to end at. Nothing is scored farther away than 50 m."""
NOWHERE, EVERYWHERE = -2, -1
"""Group of a label that belongs to none; of a false alarm that counts in each."""


@dataclass(frozen=True)
class Grouping:
    """One way to divide the N labels of a :class:`GroundTruth`, and any predictions."""

    axis: str  # condition | range | visibility
    names: tuple[str, ...]
    label: NDArray[np.int64]  # (N,) index into names, or NOWHERE
    of_found: Callable[[SampleBoxes], NDArray[np.int64]]  # (P,) index into names, or EVERYWHERE


@dataclass(frozen=True)
class GroupScore:
    """The score of one group. Means are over the classes that have a label there."""

    name: str
    mAP: float
    AP: dict[str, float]
    num_gt: dict[str, int]
    resampled: NDArray[np.float64]  # (R,) mAP on each resample of the scenes; NaN on one without a label of the group
    scenes: int  # that have a label of the group

    @property
    def interval(self) -> list[float] | None:
        """The 95 % interval of mAP; None where only one scene has labels."""
        return known_interval(self.resampled, self.scenes)

    def row(self) -> dict[str, Any]:
        """Plain values for a table, with the 95 % interval."""
        return {
            "group": self.name,
            "mAP": self.mAP,
            "mAP_ci95": self.interval,
            "AP": self.AP,
            "num_gt": self.num_gt,
            "labels": sum(self.num_gt.values()),
        }


def known_interval(values: NDArray[np.float64], scenes: int) -> list[float] | None:
    """The 95 % interval of those values (R,) that are known, on resamples of so many scenes; None where there is none."""
    known = values[np.isfinite(values)]
    return over_scenes(known, scenes) if len(known) else None


def condition_of(scene: Record, *, by_severity: bool = False) -> str:
    """Condition of a scene, "fog" or "fog 2"; of a recorded one what its description says of night and rain, else clear."""
    condition = scene.get("condition")
    if condition is None:
        words = scene.get("description", "").lower()
        return next((name for name in ("night", "rain") if name in words), "clear")
    severity = f" {condition['severity']}" if by_severity and condition["name"] != "clear" else ""
    return f"{condition['name']}{severity}"


def by_condition(truth: GroundTruth, samples: Sequence[tuple[NuScenes, str]], *, by_severity: bool = False) -> Grouping:
    """By the condition of the scene: clear first, the others by name."""
    of_sample = [condition_of(nusc.scene(token), by_severity=by_severity) for nusc, token in table_order(samples)]
    names = tuple(sorted(set(of_sample), key=lambda name: (name != "clear", name)))
    group = np.array([names.index(name) for name in of_sample], np.int64)
    return Grouping("condition", names, group[truth.labels.sample], lambda found: group[found.sample])


def by_range(truth: GroundTruth, edges: Sequence[float] = RANGES) -> Grouping:
    """By the distance of the centre from the car, on the ground: 0-20, 20-35 and 35-51 m."""

    def group(boxes: SampleBoxes) -> NDArray[np.int64]:
        return np.searchsorted(edges, np.linalg.norm(truth.in_ego(boxes)[:, :2], axis=1), side="right")

    ends = [0, *edges, FARTHEST]
    names = tuple(f"{low:g}-{high:g} m" for low, high in pairwise(ends))
    return Grouping("range", names, group(truth.labels), group)


def by_visibility(truth: GroundTruth) -> Grouping:
    """By nuScenes' four levels of visibility; a label of unknown visibility belongs to none."""
    names = tuple(f"{level.removeprefix('v')} %" for level in VISIBILITY_LEVELS)
    label = np.where(truth.visibility > 0, truth.visibility - 1, NOWHERE)
    return Grouping("visibility", names, label, lambda found: np.full(len(found), EVERYWHERE))


def group_matches(truth: GroundTruth, found: SampleBoxes, grouping: Grouping) -> list[list[ClassMatches]]:
    """What :meth:`GroundTruth.matches` gives, for each group: labels and predictions of the others are left out."""
    found = truth.counted(found)
    own = grouping.of_found(found)
    widest_first = np.argsort(truth.metric.distances)[::-1]
    parts = []
    for label, match in enumerate(truth.metric.match(truth.labels, found, len(truth.tokens))):
        is_class = truth.labels.boxes.label == label
        group_of_label = np.append(grouping.label[is_class], NOWHERE)  # the last for -1, no label
        group = own[found.boxes.label == label][match.row]
        for taken in match.taken[widest_first]:
            group = np.where(taken >= 0, group_of_label[taken], group)
        parts.append(
            [
                _part(match, group, group_of_label, truth.labels.sample[is_class], index)
                for index in range(len(grouping.names))
            ]
        )
    return [list(of_group) for of_group in zip(*parts, strict=True)]


def _part(
    match: ClassMatches,
    group: NDArray[np.int64],
    group_of_label: NDArray[np.int64],
    sample_of_label: NDArray[np.int64],
    index: int,
) -> ClassMatches:
    """The predictions (P,) and labels of one group."""
    kept = (group == index) | (group == EVERYWHERE)
    taken = np.where(group_of_label[match.taken] == index, match.taken, -1)
    return replace(
        match,
        score=match.score[kept],
        sample=match.sample[kept],
        row=match.row[kept],
        taken=taken[:, kept],
        is_pair=match.is_pair[kept],
        errors=match.errors[:, kept],
        num_gt=np.bincount(sample_of_label[group_of_label[:-1] == index], minlength=len(match.num_gt)),
    )


def score_groups(
    truth: GroundTruth, found: SampleBoxes, grouping: Grouping, copies: NDArray[np.int64]
) -> list[GroupScore]:
    """Scores the predictions in each group. ``copies`` (R, S): how often each sample counts in each resample of the scenes
    (:func:`fusion_net.evaluation.bootstrap.resample_scenes`); the same ones pair the differences of groups and of models."""
    scores = []
    for name, matches in zip(grouping.names, group_matches(truth, found, grouping), strict=True):
        there = {truth.classes[k]: match for k, match in enumerate(matches) if match.num_gt.any()}
        ap = {kind: float(truth.metric.average_precision(match).mean()) for kind, match in there.items()}
        labels = np.sum([match.num_gt for match in matches], axis=0)
        resampled = np.full(len(copies), np.nan)
        counted = copies @ labels > 0
        resampled[counted] = bootstrap_map(truth.metric, [*there.values()], copies[counted]) if there else np.nan
        num_gt = {kind: int(match.num_gt.sum()) for kind, match in there.items()}
        scenes = len(set(truth.scenes[labels > 0]))
        scores.append(GroupScore(name, float(np.mean([*ap.values()])) if ap else 0.0, ap, num_gt, resampled, scenes))
    return scores
