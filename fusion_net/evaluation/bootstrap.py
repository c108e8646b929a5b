"""Intervals of mAP by resampling scenes with replacement (Efron 1979).

Scenes are resampled, not samples: the samples of a scene show the same objects. Who matches whom stays as it is, so a resample
costs only new precision curves. Use the same resamples for all that is compared: differences are then paired.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion_net.metrics.detection import RECALL, DetectionMetric
from fusion_net.metrics.matching import ClassMatches


def resample_scenes(scenes: NDArray[np.str_], *, resamples: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """(R, S) how often each sample counts in each resample; ``scenes`` (S,) names the scene of each sample."""
    names, scene = np.unique(scenes, return_inverse=True)
    if not len(names):
        return np.zeros((resamples, 0), np.int64)
    counts = rng.multinomial(len(names), np.full(len(names), 1 / len(names)), size=resamples)
    return counts[:, scene]


def bootstrap_map(
    metric: DetectionMetric, matches: Sequence[ClassMatches], copies: NDArray[np.int64]
) -> NDArray[np.float64]:
    """(R,) mAP of each resample (R, S). A class that a resample happens to lack is left out of its mean, one that no
    sample has at all counts 0 as in the metric itself."""
    ap = np.zeros((len(copies), len(matches)))
    for k, match in enumerate(matches):
        if match.num_gt.any():
            ap[:, k] = average_precisions(metric, match, copies).mean(axis=1)
    counts = np.stack([copies @ match.num_gt for match in matches], axis=1)
    is_kept = (counts > 0) | ~np.array([match.num_gt.any() for match in matches])
    return (ap * is_kept).sum(axis=1) / np.maximum(is_kept.sum(axis=1), 1)


def average_precisions(metric: DetectionMetric, match: ClassMatches, copies: NDArray[np.int64]) -> NDArray[np.float64]:
    """(R, T) what ``metric.average_precision`` gives on each resample (R, S), many times as fast."""
    first = round(100 * metric.min_recall) + 1
    return _average_precisions(match.hit, match.sample, match.num_gt, copies, RECALL[first:], metric.min_precision)


@njit(cache=True)
def _average_precisions(hit, sample, num_gt, copies, at_recall, min_precision):
    """Each prediction counts as often as its sample; precision between two recalls is straight, beyond the last one 0."""
    ap = np.zeros((len(copies), len(hit)))
    for r in range(len(copies)):
        labels = (copies[r] * num_gt).sum()
        length = copies[r][sample].sum()
        if labels == 0 or length == 0:
            continue
        recall, precision = np.empty(length), np.empty(length)
        for t in range(len(hit)):
            hits, n = 0, 0
            for p in range(len(sample)):
                for _ in range(copies[r, sample[p]]):
                    hits += hit[t, p]
                    recall[n] = hits / labels
                    precision[n] = hits / (n + 1)
                    n += 1
            if hits == 0:
                continue
            area, j = 0.0, 0
            for x in at_recall:
                if x > recall[-1]:
                    break
                while j + 1 < length and recall[j + 1] <= x:
                    j += 1
                value = precision[j]
                if recall[j] < x:
                    slope = (precision[j + 1] - precision[j]) / (recall[j + 1] - recall[j])
                    value += slope * (x - recall[j])
                area += max(value - min_precision, 0.0)
            ap[r, t] = area / len(at_recall) / (1 - min_precision)
    return ap


def over_scenes(values: NDArray[np.float64], scenes: int) -> list[float] | None:
    """The 95 % interval of values on resamples of so many scenes; None for fewer than two, which tell nothing of others."""
    return interval(values) if scenes > 1 else None


def interval(values: NDArray[np.float64], level: float = 0.95) -> list[float]:
    """[low, high] percentiles that hold ``level`` of the values."""
    tail = 50 * (1 - level)
    return [float(value) for value in np.percentile(values, [tail, 100 - tail])]
