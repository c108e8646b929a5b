"""Every detection that takes no label is a mistake of one kind (TIDE, Bolya et al. 2020, arXiv 2008.08115), by distance of
centres in place of IoU, and with a kind of its own for decoys, which generated data sets have.

A duplicate lies within the threshold of a label of its class, which a better one took. A mistake of class lies within the
threshold of a label of another class; one at a decoy within the threshold of a body that is no object. A mistake of place lies
farther away from a label of its class that nothing takes, but within ``NEAR``. Anything else is background.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fusion_net.evaluation.decoys import Bodies
from fusion_net.metrics.detection import DetectionMetric
from fusion_net.metrics.sample_boxes import SampleBoxes

KINDS = ("class", "place", "duplicate", "decoy", "background")
CLASS, PLACE, DUPLICATE, DECOY, BACKGROUND = range(len(KINDS))
HIT = -1
NEAR = 4.0
"""Metres within which a detection means a label though it lies farther away than the threshold; at least twice that."""
APART = 1e4
"""Metres between samples, or classes, along a third axis: nothing is the neighbour of what is in another."""


@dataclass(frozen=True)
class Judged:
    """What P detections are at one distance threshold."""

    kind: NDArray[np.int64]  # (P,) index into KINDS, or HIT
    meets: NDArray[np.int64]  # (P,) row of the label (of the decoy, where it is one) that it takes or means, or -1


def judge(
    labels: SampleBoxes, found: SampleBoxes, decoys: Bodies, *, metric: DetectionMetric, num_samples: int
) -> list[Judged]:
    """One entry for each distance of the metric. Labels and detections are those that count, ``decoys`` have none that is
    real."""
    taken = _taken(labels, found, metric, num_samples)
    by_class = len(metric.classes)
    own = labels.sample * by_class + labels.boxes.label
    wanted = found.sample * by_class + found.boxes.label
    same, same_row = _nearest(found, wanted, labels.boxes.center[:, :2], own)
    other, other_row = _nearest_of_another_class(labels, found)
    fake, fake_row = _nearest(found, found.sample, decoys.center, decoys.sample)
    judged = []
    for distance, row in zip(metric.distances, taken, strict=True):
        free = np.flatnonzero(~np.isin(np.arange(len(labels)), row))
        missed, missed_row = _nearest(found, wanted, labels.boxes.center[free, :2], own[free])
        cases = [row >= 0, same < distance, other < distance, fake < distance, missed < max(NEAR, 2 * distance)]
        kind = np.select(cases, [HIT, DUPLICATE, CLASS, DECOY, PLACE], BACKGROUND)
        meant = np.append(free, -1)[missed_row]
        judged.append(Judged(kind, np.select(cases, [row, same_row, other_row, fake_row, meant], -1)))
    return judged


def falling(found: SampleBoxes) -> NDArray[np.int64]:
    """(P,) rows in order of falling score, equal ones as the metric has them."""
    return np.argsort(found.boxes.score, kind="stable")[::-1]


def _taken(labels: SampleBoxes, found: SampleBoxes, metric: DetectionMetric, num_samples: int) -> NDArray[np.int64]:
    """(T, P) row of the label that each detection takes, -1 for none."""
    taken = np.full((len(metric.distances), len(found)), -1)
    order = np.argsort(labels.sample, kind="stable")
    for k, match in enumerate(metric.match(labels, found, num_samples)):
        rows = np.append(order[labels.boxes.label[order] == k], -1)  # the last for -1, no label
        taken[:, np.flatnonzero(found.boxes.label == k)[match.row]] = rows[match.taken]
    return taken


def _nearest(
    found: SampleBoxes, group: NDArray[np.int64], places: NDArray[np.float64], group_of_place: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Distance (P,) of each detection to the nearest of the ``places`` (N, 2) of its group, and its row; infinite and -1 where
    there is none."""
    if not len(places) or not len(found):
        return np.full(len(found), np.inf), np.full(len(found), -1)
    tree = cKDTree(np.column_stack([places, APART * group_of_place]))
    wanted = np.column_stack([found.boxes.center[:, :2], APART * group])
    distance, row = tree.query(wanted, distance_upper_bound=APART / 2)
    return distance, np.where(np.isfinite(distance), row, -1)


def _nearest_of_another_class(labels: SampleBoxes, found: SampleBoxes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    distance, row = np.full(len(found), np.inf), np.full(len(found), -1)
    for k in np.unique(found.boxes.label):
        mine, others = found.boxes.label == k, np.flatnonzero(labels.boxes.label != k)
        part = found[mine]
        distance[mine], near = _nearest(part, part.sample, labels.boxes.center[others, :2], labels.sample[others])
        row[mine] = np.append(others, -1)[near]
    return distance, row
