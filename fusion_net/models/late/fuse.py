"""Lists of estimates, one a sensor, to one list: partners found, merged, and scored together; the others kept as they are."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.geometry import wrap_angle
from fusion_net.models.late.association import Pairs, associate, same_truth
from fusion_net.models.late.estimates import Estimates
from fusion_net.models.late.merging import MERGING, Merge
from fusion_net.models.late.scores import Score, combine

ORDER = ("lidar", "radar", "camera")
"""The sensors by how well they place an object: each list is associated with what the lists before it have become. With
another order a box near the gate may find another partner, so it is always this one, whatever order the lists come in."""

Association = Literal["mahalanobis", "oracle"]
ASSOCIATIONS = get_args(Association)


def partners(a: Estimates, b: Estimates, *, association: Association, gate: float, min_probability: float) -> Pairs:
    """Pairs of two lists: ``mahalanobis`` by class, gate and assignment (:func:`associate`), ``oracle`` by the labels that
    the boxes are of. Boxes that no detector thinks at least ``min_probability`` likely find no partner: of the dozens of faint
    peaks that a detector lists, some lie within any gate."""
    rows_a, rows_b = (np.flatnonzero(_best(x.probability) >= min_probability) for x in (a, b))
    a, b = a[rows_a], b[rows_b]
    if association == "oracle":
        pairs = same_truth(a.truth, b.truth)
    else:
        places = (a.boxes.center[:, :2], a.cov, b.boxes.center[:, :2], b.cov)
        pairs = associate(*places, label_a=a.boxes.label, label_b=b.boxes.label, gate=gate)
    return np.stack([rows_a[pairs[:, 0]], rows_b[pairs[:, 1]]], axis=1)


def _best(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.nan_to_num(probability, nan=0.0).max(axis=1, initial=0.0)


def fuse(
    lists: Mapping[str, Estimates],
    pair: Callable[[Estimates, Estimates], Pairs],
    *,
    merge: Merge,
    score: Score,
    prior: float,
) -> Estimates:
    """The estimates of one sample by sensor, any of them empty or not there, as one list, best first. ``pair`` finds the
    partners of two lists. As many come out as went in, less one for each pair."""
    fused = Estimates.empty()
    for name in ORDER:
        if name in lists:
            fused = join(fused, lists[name], pair(fused, lists[name]), merge=merge)
    scores = combine(fused.probability, score, prior=prior)
    variance = np.diagonal(fused.cov, axis1=1, axis2=2)
    fused = replace(fused, boxes=replace(fused.boxes, score=scores, log_variance=np.log(variance)))
    return fused[np.argsort(-scores, kind="stable")]


def join(a: Estimates, b: Estimates, pairs: Pairs, *, merge: Merge) -> Estimates:
    """Both lists, with the ``pairs`` merged."""
    alone_a, alone_b = np.ones(len(a), bool), np.ones(len(b), bool)
    alone_a[pairs[:, 0]], alone_b[pairs[:, 1]] = False, False
    merged = merge_pairs(a[pairs[:, 0]], b[pairs[:, 1]], merge)
    return Estimates.join([merged, a[alone_a], b[alone_b]])


def merge_pairs(a: Estimates, b: Estimates, merge: Merge) -> Estimates:
    """P estimates merged with their P partners, one by one.

    Place and velocity by their own covariances: where a radar has a part, the velocity along its ray is mostly the radar's.
    Height, size (in the logarithm) and heading have no covariances; they are averaged with the share of each in the summed
    information on the place, tr A^-1 and tr B^-1 (with ``best`` the better one's alone). A heading that points the other way
    is flipped by pi first: detectors tell the axis of a body from its front much more surely than its front from its rear.
    The flip follows the partner with the larger share.
    """
    center, cov = MERGING[merge](a.boxes.center[:, :2], a.cov, b.boxes.center[:, :2], b.cov)
    velocity, velocity_cov = MERGING[merge](a.boxes.velocity, a.velocity_cov, b.boxes.velocity, b.velocity_cov)
    share = _share(a, b, merge)
    height = share * a.boxes.center[:, 2] + (1 - share) * b.boxes.center[:, 2]
    boxes = replace(
        a.boxes,
        center=np.concatenate([center, height[:, None]], axis=1),
        wlh=np.exp(share[:, None] * np.log(a.boxes.wlh) + (1 - share[:, None]) * np.log(b.boxes.wlh)),
        yaw=merged_heading(a.boxes.yaw, b.boxes.yaw, share),
        velocity=velocity,
    )
    probability = np.where(np.isnan(a.probability), b.probability, a.probability)
    return Estimates(boxes, cov, velocity_cov, probability, np.where(a.truth < 0, b.truth, a.truth))


def merged_heading(
    yaw_a: NDArray[np.float64], yaw_b: NDArray[np.float64], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Headings in [-pi, pi) between those of pairs, ``share`` (P,) of the way from b to a on the shorter arc between the axes;
    the end that is the front is that of the one with the larger share, of equals that of a."""
    apart = wrap_angle(yaw_b - yaw_a, np.pi)  # b's axis seen from a's: at most a quarter turn
    axis = yaw_a + (1 - share) * apart
    leader = np.where(share >= 0.5, yaw_a, yaw_b)
    return wrap_angle(axis + np.where(np.cos(axis - leader) < 0, np.pi, 0.0))


def _share(a: Estimates, b: Estimates, merge: Merge) -> NDArray[np.float64]:
    """(P,) of the first estimates in the summed information on the place."""
    if merge == "best":
        return (np.linalg.slogdet(a.cov)[1] <= np.linalg.slogdet(b.cov)[1]).astype(float)
    first, second = (np.trace(np.linalg.inv(x.cov), axis1=1, axis2=2) for x in (a, b))
    return first / (first + second)
