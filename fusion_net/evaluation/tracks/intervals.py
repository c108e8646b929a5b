"""Intervals of AMOTA by resampling scenes with replacement, as those of mAP (:mod:`fusion_net.evaluation.bootstrap`).

Who follows whom in a scene at a threshold of score does not depend on the other scenes, so it is worked out once for each
threshold that any resample asks for.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fusion_net.metrics.clear_mot import MATCH, MISS, Correspondences, Followed
from fusion_net.metrics.tracking import WORST, TrackingMetric, motar

Array = NDArray[np.float64]


def bootstrap_amota(metric: TrackingMetric, by_class: Sequence[Correspondences], copies: NDArray[np.int64]) -> Array:
    """(R,) AMOTA of each resample; ``copies`` (R, scenes) says how often each scene counts. A class that a resample happens to
    lack is left out of its mean."""
    of_class = [_class_amota(metric, follow, copies) for follow in by_class if follow.has_labels]
    return np.nanmean(np.array(of_class).reshape(len(of_class), len(copies)), axis=0)


def _class_amota(metric: TrackingMetric, follow: Correspondences, copies: NDArray[np.int64]) -> Array:
    """(R,) AMOTA of one class, NaN for a resample without labels."""
    everything, levels = follow(), follow.levels
    scenes = copies.shape[1]
    num_gt = np.bincount(everything.scene, minlength=scenes)
    is_match = everything.event == MATCH
    score, scene = everything.score[is_match], everything.scene[is_match]

    @cache
    def counts(level: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return _by_scene(follow(levels[level]), scenes)

    amota = np.full(len(copies), np.nan)
    for r, row in enumerate(copies):
        total = int(num_gt @ row)
        if not total:
            continue
        thresholds = metric.thresholds(np.repeat(score, row[scene]), total)
        values = np.full(len(thresholds), WORST["amota"])
        for place, threshold in enumerate(thresholds):
            if not np.isnan(threshold):
                matches, false = (int(each @ row) for each in counts(int(np.searchsorted(levels, threshold))))
                values[place] = np.nan_to_num(motar(matches, false, total), nan=WORST["amota"])
        amota[r] = values.mean()
    return amota


def _by_scene(followed: Followed, scenes: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Matches and false alarms of each scene."""
    matches = np.bincount(followed.scene[followed.event == MATCH], minlength=scenes)
    taken = np.bincount(followed.scene[followed.event != MISS], minlength=scenes)
    return matches, followed.num_found - taken
