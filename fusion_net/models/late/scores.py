"""From the scores that several detectors gave one object to one probability that it is there.

A detector's score orders its own boxes and no more; to be compared with another detector's it is calibrated first.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

Array = NDArray[np.float64]
Score = Literal["noisy_or", "max", "mean", "bayes"]
SCORES = get_args(Score)
_EDGE = 1e-6
"""Probabilities keep this far from 0 and 1, whose log-odds are infinite."""


def log_odds(probability: ArrayLike) -> Array:
    """log(p / (1 - p)), with p kept off 0 and 1."""
    p = np.clip(np.asarray(probability, float), _EDGE, 1 - _EDGE)
    return np.log(p / (1 - p))


def sigmoid(value: ArrayLike) -> Array:
    """1 / (1 + exp(-x))."""
    return 0.5 * (1 + np.tanh(np.asarray(value, float) / 2))


@dataclass(frozen=True)
class Platt:
    """p = sigmoid(slope * log_odds(score) + shift): Platt scaling (Platt 1999; on log-odds, Kull et al. 2017), rising."""

    slope: float = 1.0
    shift: float = 0.0

    def __call__(self, score: ArrayLike) -> Array:
        """Probabilities (N,) of scores (N,)."""
        return sigmoid(self.slope * log_odds(score) + self.shift)


def fit_platt(score: ArrayLike, hit: ArrayLike) -> Platt:
    """The scaling under which these scores (N,) explain best which boxes were hits (N,) of a label: least cross-entropy, with
    Platt's smoothed targets. Boxes that are all hits, all misses, or none at all leave the scores as they are."""
    hit = np.asarray(hit, bool)
    hits, misses = int(hit.sum()), int((~hit).sum())
    if not hits or not misses:
        return Platt()
    x, target = log_odds(score), np.where(hit, (hits + 1) / (hits + 2), 1 / (misses + 2))

    def cost(theta: Array) -> tuple[float, Array]:
        z = np.exp(theta[0]) * x + theta[1]
        error = sigmoid(z) - target
        value = (np.logaddexp(0.0, z) - target * z).mean()
        return value, np.array([(error * np.exp(theta[0]) * x).mean(), error.mean()])

    found = minimize(cost, np.zeros(2), jac=True, method="L-BFGS-B", bounds=[(-3.0, 3.0), (-20.0, 20.0)])
    return Platt(float(np.exp(found.x[0])), float(found.x[1]))


def combine(probability: ArrayLike, rule: Score, *, prior: float) -> Array:
    """One probability (N,) for each object from those (N, M) of M detectors, NaN where one is silent.

    ``noisy_or`` 1 - prod(1 - p): some detector is right, each for reasons of its own. ``max``, ``mean``: of those that spoke.
    ``bayes``: probabilistic ensembling (Chen et al. 2022, "Multimodal object detection via probabilistic ensembling", arXiv
    2104.02904): detectors independent given the object, so odds = prior odds * prod(odds / prior odds). A silent detector is
    marginalised out, which leaves no factor. ``prior``: how likely a box is an object before its scores are seen.
    """
    if rule not in SCORES:
        raise ValueError(f"there is no score rule {rule!r}; choose from {', '.join(SCORES)}")
    p = np.asarray(probability, float)
    spoke = np.isfinite(p)
    if not spoke.any(axis=-1).all():
        raise ValueError("combine: an object that no detector found has no score")
    if rule == "noisy_or":
        return 1 - np.where(spoke, 1 - p, 1.0).prod(axis=-1)
    if rule == "max":
        return np.where(spoke, p, -np.inf).max(axis=-1, initial=-np.inf)
    if rule == "mean":
        return np.where(spoke, p, 0.0).sum(axis=-1) / spoke.sum(axis=-1)
    base = float(log_odds(prior))
    return sigmoid(base + np.where(spoke, log_odds(np.where(spoke, p, 0.5)) - base, 0.0).sum(axis=-1))
