"""What labels of each class are taken for, and what is seen where there is nothing or a decoy."""

from dataclasses import replace
from typing import Any

import numpy as np

from fusion_net.evaluation.breakdown.mistakes import CLASS, DECOY, HIT, falling, judge
from fusion_net.evaluation.breakdown.operating_point import operating_point
from fusion_net.evaluation.decoys import Bodies
from fusion_net.metrics.detection import DetectionMetric
from fusion_net.metrics.sample_boxes import SampleBoxes


def confusion(
    labels: SampleBoxes, found: SampleBoxes, decoys: Bodies, *, metric: DetectionMetric, num_samples: int
) -> dict[str, Any]:
    """Counts of detections above the score of their class's best F1, at the distance at which errors are measured.

    ``labels``: of each class how many labels are found as each class (a label once, as its own class where it is) and how many
    are missed; ``decoys``: of each class imitated, how many decoys are taken for each class, and how many for nothing;
    ``background``: how many other detections there are of each class, duplicates included.
    """
    found = operating_point(labels, found, metric=metric, num_samples=num_samples).found
    at_one = replace(metric, distances=[metric.tp_distance])
    (judged,) = judge(labels, found, decoys, metric=at_one, num_samples=num_samples)
    classes = range(len(metric.classes))
    seen_as, used = _first_seen_as(
        judged.meets, np.isin(judged.kind, (HIT, CLASS)), judged.kind == HIT, found, len(labels)
    )
    fake_as, at_fake = _first_seen_as(judged.meets, judged.kind == DECOY, judged.kind == HIT, found, len(decoys.label))
    rest = ~used & ~at_fake
    return {
        "classes": list(metric.classes),
        "labels": [_row(seen_as[labels.boxes.label == k], len(classes)) for k in classes],
        "decoys": {
            metric.classes[k]: _row(fake_as[decoys.label == k], len(classes)) for k in np.unique(decoys.label).tolist()
        },
        "background": np.bincount(found.boxes.label[rest], minlength=len(classes)).tolist(),
    }


def _first_seen_as(meets, is_at, is_hit, found: SampleBoxes, count: int):
    """Class (N,) that each of ``count`` bodies is taken for, that of the hit, else of the best detection there, else -1; and
    which detections (P,) say so."""
    order = falling(found)
    order = order[np.argsort(~is_hit[order], kind="stable")]
    order = order[is_at[order]]
    bodies, first = np.unique(meets[order], return_index=True)
    seen_as, used = np.full(count, -1), np.zeros(len(found), np.bool_)
    seen_as[bodies] = found.boxes.label[order[first]]
    used[order[first]] = True
    return seen_as, used


def _row(seen_as, classes: int) -> dict[str, Any]:
    return {
        "count": len(seen_as),
        "found": np.bincount(seen_as[seen_as >= 0], minlength=classes).tolist(),
        "missed": int((seen_as < 0).sum()),
    }
