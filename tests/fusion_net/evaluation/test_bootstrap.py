"""AP on many resamples at once: that of the metric itself on each."""

import numpy as np
import pytest

from fusion_net.evaluation.bootstrap import average_precisions, resample_scenes
from fusion_net.metrics.detection import DetectionMetric
from fusion_net.metrics.matching import ClassMatches


def random_matches(rng, *, samples, predictions, labels):
    """Predictions that take a label with a probability that falls with their rank."""
    chance = np.linspace(1, 0, predictions)
    taken = np.where(rng.random((4, predictions)) < chance, rng.integers(0, max(labels, 1), (4, predictions)), -1)
    sample, num_gt = (
        rng.integers(0, samples, predictions),
        np.bincount(rng.integers(0, samples, labels), minlength=samples),
    )
    score = np.sort(rng.random(predictions))[::-1]
    errors = np.full((5, predictions), np.nan)
    return ClassMatches(score, sample, np.arange(predictions), taken, taken[-1] >= 0, errors, num_gt)


@pytest.mark.parametrize(("predictions", "labels"), [(300, 90), (40, 200), (7, 3), (5, 1), (0, 4), (6, 0)])
def test_each_resample_has_the_metrics_own_ap(predictions, labels):
    rng = np.random.default_rng(predictions + labels)
    metric, scenes = DetectionMetric(), np.repeat(np.array(["a", "b", "c", "d", "e"]), 4)
    match = random_matches(rng, samples=len(scenes), predictions=predictions, labels=labels)
    copies = np.vstack([np.ones((1, len(scenes)), np.int64), resample_scenes(scenes, resamples=30, rng=rng)])
    expected = [metric.average_precision(match, row) for row in copies]
    np.testing.assert_allclose(average_precisions(metric, match, copies), expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        average_precisions(metric, match, copies)[0], metric.average_precision(match), rtol=1e-12
    )
