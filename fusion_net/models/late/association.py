"""Which estimates of two sensors are of one object: a Mahalanobis gate, then the best assignment within each class."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from fusion_net.common.boxes import Boxes
from fusion_net.models.late.covariance import check_estimates, gate_of, mahalanobis_squared

Pairs = NDArray[np.int64]
"""(P, 2) rows of the first and of the second list; each row at most once."""

GATE = 0.99
"""Probability with which a true partner lies within the gate, if the covariances are right."""


def associate(
    mean_a: ArrayLike,
    cov_a: ArrayLike,
    mean_b: ArrayLike,
    cov_b: ArrayLike,
    *,
    label_a: ArrayLike | None = None,
    label_b: ArrayLike | None = None,
    gate: float = GATE,
) -> Pairs:
    """Partners among means (A, d) and (B, d) with covariances (A, d, d) and (B, d, d), or one (d, d) for all of a list.

    The distance of two estimates is d^2 = e^T (P_a + P_b)^-1 e, e their difference. Pairs of one class within the gate (of
    probability ``gate`` in the plane, d = 2) are assigned so that the sum of min(d^2, gate) is least (Hungarian algorithm): an
    estimate without a partner costs what a pair at the gate does, and stays single. ValueError for a covariance that is not
    positive definite, or is not there.
    """
    mean_a, mean_b, cov_a, cov_b = (np.asarray(x, float) for x in (mean_a, mean_b, cov_a, cov_b))
    for mean, cov, which in ((mean_a, cov_a, "first"), (mean_b, cov_b, "second")):
        if len(mean):
            check_estimates(mean, cov, f"associate, {which} list")
    limit = gate_of(gate)
    if not len(mean_a) or not len(mean_b):
        return np.zeros((0, 2), np.int64)
    d = mean_a.shape[-1]
    cov_a, cov_b = (np.broadcast_to(cov, (len(mean), d, d)) for mean, cov in ((mean_a, cov_a), (mean_b, cov_b)))
    distance = mahalanobis_squared(mean_a[:, None] - mean_b[None], cov_a[:, None] + cov_b[None])
    if label_a is not None and label_b is not None:
        distance = np.where(np.asarray(label_a)[:, None] == np.asarray(label_b)[None], distance, np.inf)
    return _assigned(distance, limit)


def _assigned(distance: NDArray[np.float64], limit: float) -> Pairs:
    """The assignment of the least sum of min(distance, limit), without the pairs at the limit."""
    rows, columns = linear_sum_assignment(np.minimum(distance, limit))
    pairs = np.stack([rows, columns], axis=1).astype(np.int64)
    return pairs[distance[rows, columns] < limit]


def match_to_labels(boxes: Boxes, labels: Boxes, *, distance: float) -> NDArray[np.int64]:
    """(N,) row of the label that each box takes, -1 for none, as nuScenes' metric matches them: in order of falling score each
    box takes the nearest label of its class that none took before, if its centre is nearer than ``distance`` metres."""
    taken = np.full(len(boxes), -1, np.int64)
    if not len(labels):
        return taken
    away = np.linalg.norm(boxes.center[:, None, :2] - labels.center[None, :, :2], axis=2)
    away[boxes.label[:, None] != labels.label[None]] = np.inf
    for row in np.argsort(-boxes.score, kind="stable"):
        nearest = int(away[row].argmin())
        if away[row, nearest] < distance:
            taken[row] = nearest
            away[:, nearest] = np.inf
    return taken


def same_truth(truth_a: NDArray[np.int64], truth_b: NDArray[np.int64]) -> Pairs:
    """Pairs of boxes that took the same label (:func:`match_to_labels`): the association that cannot err."""
    same = (truth_a[:, None] == truth_b[None]) & (truth_a[:, None] >= 0)
    return np.argwhere(same).astype(np.int64)
