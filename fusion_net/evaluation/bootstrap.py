"""Intervals of mAP by resampling scenes with replacement (Efron 1979).

Scenes are resampled, not samples: the samples of a scene show the same objects. Who matches whom stays as it is, so a resample
costs only new precision curves. Use the same resamples for all that is compared: differences are then paired.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusion_net.metrics.detection import DetectionMetric
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
            ap[:, k] = [metric.average_precision(match, row).mean() for row in copies]
    counts = np.stack([copies @ match.num_gt for match in matches], axis=1)
    is_kept = (counts > 0) | ~np.array([match.num_gt.any() for match in matches])
    return (ap * is_kept).sum(axis=1) / np.maximum(is_kept.sum(axis=1), 1)


def interval(values: NDArray[np.float64], level: float = 0.95) -> list[float]:
    """[low, high] percentiles that hold ``level`` of the values."""
    tail = 50 * (1 - level)
    return [float(value) for value in np.percentile(values, [tail, 100 - tail])]
