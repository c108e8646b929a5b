"""What keeps mAP below 1: by how much each kind of mistake lowers it (TIDE, Bolya et al. 2020, arXiv 2008.08115).

Of each kind the mistakes are put right and nothing else, at each of the metric's distances: a detection of the wrong class, or
in the wrong place, takes the label that it means (the best of several; the others go); duplicates, detections at decoys and in
the background go; labels that no detection means are not asked for. What mAP gains is the kind's part. The parts need not sum
up to what is missing: AP is no sum.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.evaluation.bootstrap import bootstrap_map, over_scenes
from fusion_net.evaluation.breakdown.mistakes import CLASS, HIT, KINDS, PLACE, Judged, falling, judge
from fusion_net.evaluation.decoys import Bodies
from fusion_net.metrics.detection import DetectionMetric
from fusion_net.metrics.matching import ClassMatches
from fusion_net.metrics.sample_boxes import SampleBoxes

BUDGET = (*KINDS, "miss")


def error_budget(
    labels: SampleBoxes,
    found: SampleBoxes,
    decoys: Bodies,
    *,
    metric: DetectionMetric,
    copies: NDArray[np.int64],
    scenes: int,
) -> dict[str, Any]:
    """``mAP`` as it is, and for each kind of BUDGET: ``gain`` of mAP without it and its 95 % interval over ``copies`` (R, S) of
    the samples of so many ``scenes``, and ``AP``, the gain of each class. Labels and detections are those that count."""
    judged = judge(labels, found, decoys, metric=metric, num_samples=copies.shape[1])
    order = falling(found)
    as_it_is = [_curves(labels, found, order, each, None, metric, copies.shape[1]) for each in judged]
    ap, resampled = _scores(metric, as_it_is, copies)
    budget = []
    for kind in BUDGET:
        mended = [_curves(labels, found, order, each, kind, metric, copies.shape[1]) for each in judged]
        without, without_resampled = _scores(metric, mended, copies)
        gain = without - ap
        budget.append(
            {
                "kind": kind,
                "gain": float(gain.mean()),
                "gain_ci95": over_scenes(without_resampled - resampled, scenes),
                "AP": dict(zip(metric.classes, gain.tolist(), strict=True)),
            }
        )
    return {"mAP": float(ap.mean()), "budget": budget}


def _scores(
    metric: DetectionMetric, curves: Sequence[Sequence[ClassMatches]], copies: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """AP of each class (K,) and mAP on each resample (R,), means over the distances."""
    ap = np.array([[metric.average_precision(match).mean() for match in each] for each in curves])
    return ap.mean(axis=0), np.mean([bootstrap_map(metric, each, copies) for each in curves], axis=0)


def _curves(
    labels: SampleBoxes,
    found: SampleBoxes,
    order: NDArray[np.int64],
    judged: Judged,
    mended: str | None,
    metric: DetectionMetric,
    num_samples: int,
) -> list[ClassMatches]:
    """Hits and false alarms of each class at one distance, with the mistakes of one kind put right."""
    kind, meets = judged.kind[order], judged.meets[order]
    asked_for = np.ones(len(labels), np.bool_)
    takes = np.where(kind == HIT, meets, -1)
    kept = np.ones(len(order), np.bool_)
    if mended == "miss":
        asked_for[:] = False
        asked_for[meets[np.isin(kind, (HIT, CLASS, PLACE))]] = True
    elif mended is not None:
        is_mended = kind == KINDS.index(mended)
        if KINDS.index(mended) in (CLASS, PLACE):
            takes = np.where(is_mended, meets, takes)
            _, first = np.unique(takes, return_index=True)
            kept = takes < 0
            kept[first] = True
        else:
            kept = ~is_mended
    rows = order[kept]
    takes = takes[kept]
    of_label = np.append(labels.boxes.label, -1)
    label = np.where(takes >= 0, of_label[takes], found.boxes.label[rows])
    curves = []
    for k in range(len(metric.classes)):
        mine, own = label == k, asked_for & (labels.boxes.label == k)
        taken = takes[mine][None]
        curves.append(
            ClassMatches(
                score=found.boxes.score[rows[mine]],
                sample=found.sample[rows[mine]],
                row=rows[mine],
                taken=taken,
                is_pair=taken[0] >= 0,
                errors=np.full((5, taken.shape[1]), np.nan),
                num_gt=np.bincount(labels.sample[own], minlength=num_samples),
            )
        )
    return curves
