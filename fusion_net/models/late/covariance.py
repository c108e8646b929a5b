"""Covariances of places and velocities on the ground, with the shape that a sensor's blur has: along and across its ray.

A radar knows a range to decimetres and a direction to a degree or more, a camera the other way round. In the ego frame such an
ellipse lies askew: its 2 x 2 covariance has entries off the diagonal. Rays start at the ego frame's origin; the sensors are
mounted up to four metres from it, which turns an ellipse 10 m away and 5 m aside by a few degrees.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LOG_VARIANCE = (-8.0, 6.0)
"""Between what the head's log-variance is trained: outside of it the network says nothing that it has learned."""


def ray_axes(xy: ArrayLike) -> Array:
    """Rotations (..., 2, 2) whose columns are, in ego axes, the unit vectors along and (to the left) across the ray to ``xy``
    (..., 2). A point at the origin has the x axis for its ray."""
    xy = np.asarray(xy, float)
    angle = np.arctan2(xy[..., 1], xy[..., 0])
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)


def along_and_across(vectors: ArrayLike, xy: ArrayLike) -> Array:
    """Vectors (..., 2) in ego axes as parts along and across the ray to ``xy`` (..., 2)."""
    return np.einsum("...ij,...i->...j", ray_axes(xy), np.asarray(vectors, float))


def ray_variance(log_variance: ArrayLike, xy: ArrayLike) -> Array:
    """Variances (..., 2) along and across the ray to ``xy`` of errors whose variances in x and y are exp(``log_variance``)."""
    variance = np.exp(np.clip(log_variance, *LOG_VARIANCE))
    return np.einsum("...ij,...i->...j", ray_axes(xy) ** 2, variance)


def ray_covariance(variance: ArrayLike, xy: ArrayLike) -> Array:
    """Covariances (..., 2, 2) in ego axes of errors with ``variance`` (..., 2) along and across the ray: R diag(v) R^T."""
    axes = ray_axes(xy)
    return np.einsum("...ij,...j,...kj->...ik", axes, np.asarray(variance, float), axes)


def mahalanobis_squared(error: ArrayLike, cov: ArrayLike) -> Array:
    """e^T P^-1 e (...) of errors (..., d) under covariances (..., d, d). With true covariances its mean is d."""
    error, cov = np.asarray(error, float), np.asarray(cov, float)
    if error.shape[-1] == 2:  # Cramer's rule: ten times as fast as a solver, for all pairs of two long lists
        x, y = error[..., 0], error[..., 1]
        determinant = cov[..., 0, 0] * cov[..., 1, 1] - cov[..., 0, 1] * cov[..., 1, 0]
        adjugate = x * x * cov[..., 1, 1] - x * y * (cov[..., 0, 1] + cov[..., 1, 0]) + y * y * cov[..., 0, 0]
        return adjugate / determinant
    return (error[..., None] * np.linalg.solve(cov, error[..., None])).sum(axis=(-2, -1))


def gaussian_nll(error: ArrayLike, cov: ArrayLike) -> Array:
    """Negative log-likelihood (...) in nats of errors (..., d) under normal distributions with covariances (..., d, d)."""
    cov = np.asarray(cov, float)
    return 0.5 * (mahalanobis_squared(error, cov) + np.linalg.slogdet(2 * np.pi * cov)[1])


def gate_of(probability: float) -> float:
    """The squared Mahalanobis distance that a true partner in the plane keeps with this probability: the quantile of chi
    squared with two degrees of freedom, -2 ln(1 - p). 0.95: 5.99, 0.99: 9.21."""
    if not 0 < probability < 1:
        raise ValueError(f"gate={probability} is a probability: above 0 and below 1")
    return -2.0 * float(np.log1p(-probability))


def check_estimates(mean: ArrayLike, cov: ArrayLike, what: str) -> None:
    """ValueError, naming ``what``, unless the means (..., d) are finite and the covariances (..., d, d), one for each mean or
    one for all, are as :func:`check_covariance` wants them."""
    mean, cov = np.asarray(mean, float), np.asarray(cov, float)
    d = mean.shape[-1]
    if cov.shape[-2:] != (d, d) or (cov.ndim > 2 and cov.shape[:-2] != mean.shape[:-1]):
        raise ValueError(f"{what}: means {mean.shape} want covariances {(*mean.shape, d)}, not {cov.shape}")
    if not np.isfinite(mean).all():
        raise ValueError(f"{what}: {np.count_nonzero(~np.isfinite(mean))} numbers of the means are not finite")
    check_covariance(cov, what)


def check_covariance(cov: ArrayLike, what: str) -> None:
    """ValueError, naming ``what``, unless all of ``cov`` (..., d, d) are finite, symmetric and positive definite."""
    cov = np.asarray(cov, float)
    d = cov.shape[-1]
    flat = cov.reshape(-1, d, d)
    finite = np.isfinite(flat).all(axis=(1, 2))
    flat = np.where(finite[:, None, None], flat, 0.0)
    scale = np.abs(flat).max(axis=(1, 2), initial=0.0)
    symmetric = np.abs(flat - flat.swapaxes(1, 2)).max(axis=(1, 2), initial=0.0) <= 1e-9 * scale
    wrong = np.flatnonzero(~(finite & symmetric & (np.linalg.eigvalsh(flat)[:, 0] > 0)))
    if len(wrong):
        first = np.asarray(cov, float).reshape(-1, d, d)[wrong[0]].tolist()
        raise ValueError(
            f"{what}: {len(wrong)} of {len(flat)} covariances are not symmetric and positive definite, the first is number"
            f" {wrong[0]}, {first}"
        )
