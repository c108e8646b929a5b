"""The score without any input: boxes sampled from the labels' own statistics, anywhere on the grid."""

import numpy as np

from fusion_net.common.boxes import Boxes
from fusion_net.evaluation.scoring import GroundTruth


def random_guess(truth: GroundTruth, *, rng: np.random.Generator) -> list[Boxes]:
    """Boxes of each sample in its ego frame. Each copies class and size of a label sampled at random, so both follow the
    split's own prior; as many per sample as there are labels on average; place, heading and score uniform, standing still."""
    labels, grid = truth.labels.boxes, truth.grid
    if not len(labels):
        return [Boxes.empty() for _ in truth.tokens]
    guesses = []
    for _ in truth.tokens:
        prior = labels[rng.integers(len(labels), size=max(1, round(len(labels) / len(truth.tokens))))]
        n = len(prior)
        xy = rng.uniform([grid.x_min, grid.y_min], [grid.x_max, grid.y_max], size=(n, 2))
        center = np.column_stack([xy, prior.wlh[:, 2] / 2])
        yaw, score = rng.uniform(-np.pi, np.pi, n), rng.uniform(0.01, 1, n)
        guesses.append(Boxes(center, prior.wlh, yaw, np.zeros((n, 2)), prior.label, score, np.zeros((n, 2))))
    return guesses
