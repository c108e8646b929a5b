"""Two estimates of one quantity become one. What is assumed of how their errors correlate is what the rules differ in.

All take means (..., d) and covariances (..., d, d), any number at once, and give the merged mean and covariance.
"""

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusion_net.models.late.covariance import check_estimates

Array = NDArray[np.float64]
Merge = Literal["covariance_intersection", "information", "inverse_covariance_intersection", "best"]
MERGES = get_args(Merge)
_TRIED = np.linspace(0.0, 1.0, 33)
_ROUNDS = 4
"""Of the search for w: each tries 33 values between the neighbours of the best so far, in the end 8e-6 apart."""


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
    is concave in w.
    """
    a, A, b, B = _checked(mean_a, cov_a, mean_b, cov_b)
    A_inv, B_inv = np.linalg.inv(A), np.linalg.inv(B)
    w = _most_informative(lambda w, ratio: w + (1 - w) / ratio, A, B)
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
    w = _most_informative(lambda w, ratio: 1 + 1 / ratio - 1 / (w + (1 - w) * ratio), A, B)
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
    a, b = np.broadcast_arrays(np.asarray(mean_a, float), np.asarray(mean_b, float))
    A, B = np.broadcast_arrays(np.asarray(cov_a, float), np.asarray(cov_b, float))
    check_estimates(a, A, "merge, first estimates")
    check_estimates(b, B, "merge, second estimates")
    return a, A, b, B


def _combined(A_inv: NDArray, a: NDArray, B_inv: NDArray, b: NDArray) -> tuple[Array, Array]:
    """The mean of a and b weighted by these matrices, and the inverse of their sum, made symmetric to the last bit."""
    P = np.linalg.inv(A_inv + B_inv)
    mean = P @ (A_inv @ a[..., None] + B_inv @ b[..., None])
    return mean[..., 0], (P + P.swapaxes(-1, -2)) / 2


def _most_informative(information_of: Callable[[Array, NDArray], NDArray], A: Array, B: Array) -> Array:
    """The w (..., 1, 1) in [0, 1] under which the merged information has the largest determinant; it has one peak in w.

    In the coordinates in which A is the unit matrix and B diagonal, with the variances ``ratio``, the merged information of
    either rule is diagonal too: ``information_of(w, ratio)``. So the search works on a few numbers and not on matrices.
    """
    root = np.linalg.inv(np.linalg.cholesky(A))
    ratio = np.linalg.eigvalsh(root @ B @ root.swapaxes(-1, -2))[..., None, :]
    low, high = np.zeros(A.shape[:-2]), np.ones(A.shape[:-2])
    for _ in range(_ROUNDS):
        w = low[..., None] + (high - low)[..., None] * _TRIED
        value = np.log(information_of(w[..., None], ratio)).sum(axis=-1) - 1e-9 * np.abs(w - 0.5)  # of equals the half
        best_w = np.take_along_axis(w, value.argmax(axis=-1)[..., None], axis=-1)[..., 0]
        step = (high - low) * _TRIED[1]
        low, high = np.maximum(best_w - step, 0.0), np.minimum(best_w + step, 1.0)
    return best_w[..., None, None]
