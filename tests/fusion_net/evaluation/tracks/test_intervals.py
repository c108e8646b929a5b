"""Resampled scenes against the metric on scenes that are really there so often."""

import numpy as np
import pytest

from fusion_net.common.boxes import Boxes
from fusion_net.evaluation.tracks.intervals import bootstrap_amota
from fusion_net.metrics.sample_boxes import SampleBoxes
from fusion_net.metrics.track_boxes import TrackBoxes
from fusion_net.metrics.track_paths import Frames
from fusion_net.metrics.tracking import TrackingMetric

KEYFRAMES, OBJECTS = 8, 5
METRIC = TrackingMetric(classes=["car", "truck"])


def noisy_scene(seed):
    """Labels and tracks of one scene as (places, track, label, score) with one row a box."""
    rng = np.random.default_rng(seed)
    frame, number = (x.ravel() for x in np.meshgrid(np.arange(KEYFRAMES), np.arange(OBJECTS)))
    xy = np.stack([4.0 * frame, 8.0 * number], axis=1)
    near = xy + rng.normal(0, 0.9, xy.shape)
    name = number + OBJECTS * ((frame > 4) & (number == 2))  # another name halfway
    found = rng.random(len(xy)) < 0.8
    score = rng.uniform(size=2 * OBJECTS)[name]
    return (frame, xy, number, number % 2, 0 * score), (
        frame[found],
        near[found],
        name[found],
        number[found] % 2,
        score[found],
    )


def joined(scenes):
    """Those of several scenes, one after the other."""
    frame = np.concatenate([part[0] + KEYFRAMES * k for k, part in enumerate(scenes)])
    xy, name, label, score = (np.concatenate([part[i] for part in scenes]) for i in range(1, 5))
    n = len(frame)
    boxes = Boxes(
        np.column_stack([xy, np.ones(n)]),
        np.ones((n, 3)),
        np.zeros(n),
        np.zeros((n, 2)),
        label,
        score,
        np.zeros((n, 2)),
    )
    return TrackBoxes(SampleBoxes(boxes, frame, np.full(n, ""), np.full(n, 5)), name.astype(np.str_))


def correspondences(seeds):
    frames = Frames(np.repeat(np.arange(len(seeds)), KEYFRAMES), np.tile(500_000 * np.arange(KEYFRAMES), len(seeds)))
    truth, found = zip(*(noisy_scene(seed) for seed in seeds), strict=True)
    return METRIC.correspondences(joined(truth), joined(found), frames)


@pytest.mark.parametrize("copies", [(1, 1, 1), (2, 0, 1), (0, 3, 0), (1, 2, 2)])
def test_a_resample_is_what_the_metric_gives_for_scenes_that_are_there_so_often(copies):
    scenes = correspondences([1, 2, 3])
    there = [seed for seed, often in zip((1, 2, 3), copies, strict=True) for _ in range(often)]
    expected = METRIC.summarise(correspondences(there)).total("amota")
    assert 0.1 < expected < 0.95
    assert bootstrap_amota(METRIC, scenes, np.array([copies]))[0] == pytest.approx(expected, abs=1e-12)
