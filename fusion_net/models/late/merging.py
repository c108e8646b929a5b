"""Two estimates of one quantity become one. What is assumed of how their errors correlate is what the rules differ in.

All take means (..., d) and covariances (..., d, d), any number at once, and give the merged mean and covariance.
"""

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusion_net.models.late.covariance import check_covariance

Array = NDArray[np.float64]
Merge = Literal["covariance_intersection", "information", "inverse_covariance_intersection", "best"]
MERGES = get_args(Merge)
_GOLDEN = (5**0.5 - 1) / 2
_STEPS = 32
"""Of the search for omega, each 0.618 times the interval: it ends within 2e-7."""


def information(mean_a: ArrayLike, cov_a: ArrayLike, mean_b: ArrayLike, cov_b: ArrayLike) -> tuple[Array, Array]:
    """Independent errors: P^-1 = A^-1 + B^-1, P^-1 x = A^-1 a + B^-1 b, a Kalman update. Overconfident where they correlate."""
    a, A, b, B = _checked(mean_a, cov_a, mean_b, cov_b)
    return _combined(np.linalg.inv(A), a, np.linalg.inv(B), b)


def covariance_intersection(
    mean_a: ArrayLike, cov_a: ArrayLike, mean_b: ArrayLike, cov_b: ArrayLike
) -> tuple[Array, Array]:
    """Any correlation: P^-1 = w A^-1 + (1 - w) B^-1, P^-1 x = w A^-1 a + (1 - w) B^-1 b, with the w in [0, 1] of the least
    det P (Julier & Uhlmann 1997, "A non-divergent estimation algorithm in the presence of unknown correlations").

    P is never smaller than the true covariance of the merged error, whatever the correlation, if A and B are not. log det P^-1
    is concave in w, so a golden section search finds it.
    """
    a, A, b, B = _checked(mean_a, cov_a, mean_b, cov_b)
    A_inv, B_inv = np.linalg.inv(A), np.linalg.inv(B)
    w = _most_informative(lambda w: w * A_inv + (1 - w) * B_inv, A.shape[:-2])
    return _combined(w * A_inv, a, (1 - w) * B_inv, b)


def inverse_covariance_intersection(
    mean_a: ArrayLike, cov_a: ArrayLike, mean_b: ArrayLike, cov_b: ArrayLike
) -> tuple[Array, Array]:
    """Errors that correlate by information that both share: P^-1 = A^-1 + B^-1 - M with M = (w A + (1 - w) B)^-1, and
    P^-1 x = (A^-1 - w M) a + (B^-1 - (1 - w) M) b, with the w of the least det P (Noack, Sijs, Reinhardt & Hanebeck 2017,
    "Decentralized data fusion with inverse covariance intersection", Automatica 79). Tighter than covariance intersection.
    """
    a, A, b, B = _checked(mean_a, cov_a, mean_b, cov_b)
    A_inv, B_inv = np.linalg.inv(A), np.linalg.inv(B)
    w = _most_informative(lambda w: A_inv + B_inv - np.linalg.inv(w * A + (1 - w) * B), A.shape[:-2])
    shared = np.linalg.inv(w * A + (1 - w) * B)
    return _combined(A_inv - w * shared, a, B_inv - (1 - w) * shared, b)


def best(mean_a: ArrayLike, cov_a: ArrayLike, mean_b: ArrayLike, cov_b: ArrayLike) -> tuple[Array, Array]:
    """The estimate with the smaller determinant, of equals the first, as it is."""
    a, A, b, B = _checked(mean_a, cov_a, mean_b, cov_b)
    first = (np.linalg.slogdet(A)[1] <= np.linalg.slogdet(B)[1])[..., None]
    return np.where(first, a, b), np.where(first[..., None], A, B)


MERGING: dict[str, Callable[[ArrayLike, ArrayLike, ArrayLike, ArrayLike], tuple[Array, Array]]] = {
    "covariance_intersection": covariance_intersection,
    "information": information,
    "inverse_covariance_intersection": inverse_covariance_intersection,
    "best": best,
}
"""The rules by the names of ``late.merge``."""


def _checked(mean_a: ArrayLike, cov_a: ArrayLike, mean_b: ArrayLike, cov_b: ArrayLike) -> tuple[Array, ...]:
    check_covariance(cov_a, "merge, first estimates")
    check_covariance(cov_b, "merge, second estimates")
    a, b = np.broadcast_arrays(np.asarray(mean_a, float), np.asarray(mean_b, float))
    A, B = np.broadcast_arrays(np.asarray(cov_a, float), np.asarray(cov_b, float))
    return a, A, b, B


def _combined(A_inv: NDArray, a: NDArray, B_inv: NDArray, b: NDArray) -> tuple[Array, Array]:
    """The mean of a and b weighted by these matrices, and the inverse of their sum, made symmetric to the last bit."""
    P = np.linalg.inv(A_inv + B_inv)
    mean = P @ (A_inv @ a[..., None] + B_inv @ b[..., None])
    return mean[..., 0], (P + P.swapaxes(-1, -2)) / 2


def _most_informative(information_of: Callable[[Array], NDArray], shape: tuple[int, ...]) -> Array:
    """The w (..., 1, 1) in [0, 1] of the largest log det of ``information_of(w)`` (..., d, d), which has one peak in w."""

    def value(w: Array) -> Array:
        return np.linalg.slogdet(information_of(w[..., None, None]))[1]

    low, high = np.zeros(shape), np.ones(shape)
    for _ in range(_STEPS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        rises = value(left) < value(right)
        low, high = np.where(rises, left, low), np.where(rises, high, right)
    searched = (low + high) / 2
    half, none, all_ = (np.full(shape, w) for w in (0.5, 0.0, 1.0))  # the search never tries the ends themselves
    candidates = np.stack([half, searched, none, all_])
    chosen = np.stack([value(w).round(9) for w in candidates]).argmax(
        axis=0
    )  # of equals, as of equal A and B, the half
    return np.take_along_axis(candidates, chosen[None], axis=0)[0][..., None, None]
