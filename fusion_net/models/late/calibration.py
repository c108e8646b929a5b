"""Scales that make a detector's variances honest: fitted to the errors it makes on scenes that it was not trained on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusion_net.models.late.covariance import gate_of, gaussian_nll, mahalanobis_squared

Array = NDArray[np.float64]
LEAST_MATCHES = 30
"""Matches of a class below which the scale of all classes together is used: of n squared normal errors the mean is off by
sqrt(2 / n), a quarter at 30."""
SCALES = (1e-2, 1e2)
"""Between what a scale of a variance is held: a velocity's standard deviation between 0.1 and 10 m/s."""


@dataclass(frozen=True)
class Scales:
    """Factors (K, 2) by class on the variances along and across the ray, and the matches (K,) behind each."""

    factor: Array
    matches: NDArray[np.int64]


def fit_scales(error: ArrayLike, variance: ArrayLike, label: ArrayLike, *, num_classes: int) -> Scales:
    """Factors k for which the mean of error^2 / (k * variance) is 1 along the ray and 1 across it, so that the mean squared
    normalised innovation is 2, by class.

    ``error`` and ``variance`` (N, 2) are along and across the ray, ``label`` (N,). Rows that are not finite do not count. A
    class with fewer than ``LEAST_MATCHES`` gets the factor of all classes together; without any match factors are 1.
    """
    error, variance, label = np.asarray(error, float), np.asarray(variance, float), np.asarray(label)
    known = np.isfinite(error).all(axis=1)
    squared: Array = np.square(error[known]) / variance[known]
    label = label[known]
    matches = np.bincount(label, minlength=num_classes)
    everything = squared.mean(axis=0) if known.any() else np.ones(2)
    factor = np.tile(everything, (num_classes, 1))
    for k in np.flatnonzero(matches >= LEAST_MATCHES):
        factor[k] = squared[label == k].mean(axis=0)
    return Scales(np.clip(factor, *SCALES), matches)


def consistency(error: ArrayLike, cov: ArrayLike) -> dict[str, float | int | None]:
    """How honest covariances (N, 2, 2) are of errors (N, 2): "matches" N; "NIS", the mean squared normalised innovation, 2 if
    honest, above: overconfident (Bar-Shalom, Li & Kirubarajan 2001, section 5.4); "coverage95", the share within the ellipse
    of 95 %; "NLL" in nats. None where there is no error to judge by."""
    error, cov = np.asarray(error, float), np.asarray(cov, float)
    known = np.isfinite(error).all(axis=1)
    error, cov = error[known], cov[known]
    if not known.any():
        return {"matches": 0, "NIS": None, "coverage95": None, "NLL": None}
    squared = mahalanobis_squared(error, cov)
    return {
        "matches": int(known.sum()),
        "NIS": float(squared.mean()),
        "coverage95": float((squared < gate_of(0.95)).mean()),
        "NLL": float(gaussian_nll(error, cov).mean()),
    }
