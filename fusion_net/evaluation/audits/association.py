"""Would the boxes of two sensors be taken for the same objects? Matches, wrong merges and splits over gates.

Each detection is first told which label it is of: the nearest of its class within IDENTITY metres that no better scored
detection of the sensor took. Two sensors' detections are then associated without the labels, as late fusion does (gate, then
the assignment of least distance within each class), and the pairs are judged by the labels: *right* where both are of one
label; a *wrong merge* where they are not, and at least one is of a label (one object swallows another, or a ghost moves it);
a *split* where both sensors have a label and its two detections were not merged (one object counts twice).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from fusion_net.common.boxes import Boxes
from fusion_net.common.modalities import STYLES
from fusion_net.evaluation.audits.result import Audit

Rows = NDArray[np.int64]
Associate = Callable[[Boxes, Boxes, float], Rows]
"""Boxes of two sensors and a gate to (P, 2) rows of both; each row at most once."""

IDENTITY = 4.0
"""Metres: the widest distance at which nuScenes' metric lets a detection take a label."""
GATES = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)
"""Metres."""
WORST_LOSS = 0.1
"""By how much of the objects that both sensors have the gate in use may be worse than the best one."""
FEWEST = 30
PAIRS = (("camera", "lidar"), ("camera", "radar"), ("lidar", "radar"))


def associate_by_distance(a: Boxes, b: Boxes, gate: float) -> Rows:
    """Pairs of one class nearer than ``gate`` metres, so that the sum of min(distance, gate) is least."""
    if not len(a) or not len(b):
        return np.zeros((0, 2), np.int64)
    distance = _distances(a, b)
    rows, columns = linear_sum_assignment(np.minimum(distance, gate))
    near = distance[rows, columns] < gate
    return np.stack([rows[near], columns[near]], axis=1)


def identities(found: Boxes, labels: Boxes) -> Rows:
    """(N,) which label each detection is of, -1 for none."""
    identity = np.full(len(found), -1, np.int64)
    if not len(labels) or not len(found):
        return identity
    distance = _distances(found, labels)
    for row in np.argsort(-found.score, kind="stable"):
        nearest = int(distance[row].argmin())
        if distance[row, nearest] < IDENTITY:
            identity[row] = nearest
            distance[:, nearest] = np.inf
    return identity


def _distances(a: Boxes, b: Boxes) -> NDArray[np.float64]:
    """(A, B) metres between centres, infinite where classes differ."""
    distance = np.linalg.norm(a.center[:, None, :2] - b.center[None, :, :2], axis=2)
    return np.where(a.label[:, None] == b.label[None], distance, np.inf)


def count_pairs(pairs: Rows, identity_a: Rows, identity_b: Rows) -> NDArray[np.int64]:
    """(right, wrong, split, shared) of one sample; ``shared``: labels that both sensors have."""
    one, other = identity_a[pairs[:, 0]], identity_b[pairs[:, 1]]
    right = int(((one == other) & (one >= 0)).sum())
    wrong = int(((one != other) & ((one >= 0) | (other >= 0))).sum())
    shared = len(np.intersect1d(identity_a[identity_a >= 0], identity_b[identity_b >= 0]))
    return np.array([right, wrong, shared - right, shared])


def audit_association(
    found: Mapping[str, Sequence[Boxes]],
    labels: Sequence[Boxes],
    *,
    thresholds: Mapping[str, NDArray[np.float64]],
    gate: float,
    gates: Sequence[float] = GATES,
    associate: Associate = associate_by_distance,
    unit: str = "m",
) -> Audit:
    """``found``: the boxes of each sensor alone, and ``labels``: entry by entry of one sample in its ego frame.
    ``thresholds``: of each sensor, by class, the score from which on its detections count. ``gate`` is the one in use, one of
    ``gates`` or beside them."""
    title = "Association: are two sensors' boxes taken for the same objects?"
    explanation = (
        "Boxes of two sensors alone, above the score of their best F1, associated within a gate and judged by the labels."
        " Right: both are of one label. Wrong merge: they are not, so an object is swallowed or moved. Split: both sensors"
        " have an object and it would be counted twice. Wrong where, at the gate in use, right minus wrong merges is more than"
        f" {100 * WORST_LOSS:g} % of the shared objects below the best gate's, or below half of them."
    )
    gates = sorted({*map(float, gates), float(gate)})
    kept = {
        name: [boxes[boxes.score >= thresholds[name][boxes.label]] for boxes in per_sample]
        for name, per_sample in found.items()
    }
    identity = {name: [identities(*pair) for pair in zip(boxes, labels, strict=True)] for name, boxes in kept.items()}
    numbers: dict[str, Any] = {"gate": gate, "unit": unit, "gates": gates, "pairs": []}
    for one, other in PAIRS:
        if one in kept and other in kept:
            counts = np.zeros((len(gates), 4), np.int64)
            for a, b, own_a, own_b in zip(kept[one], kept[other], identity[one], identity[other], strict=True):
                counts += [count_pairs(associate(a, b, each), own_a, own_b) for each in gates]
            numbers["pairs"].append(_pair(one, other, counts, gates))
    if not any(pair["shared"] >= FEWEST for pair in numbers["pairs"]):
        return Audit("association", title, "too few objects that two sensors have", None, numbers, explanation)
    verdict, ok = judge_gate(numbers, gate)
    return Audit("association", title, verdict, ok, numbers, explanation)


def judge_gate(numbers: Mapping[str, Any], gate: float) -> tuple[str, bool]:
    """The verdict in words on one of the ``gates`` that an audit's ``numbers`` hold, and whether nothing is wrong with it."""
    place, unit = numbers["gates"].index(float(gate)), numbers["unit"]
    faults, texts = [], []
    for pair in (pair for pair in numbers["pairs"] if pair["shared"] >= FEWEST):
        shared, gain = pair["shared"], np.array(pair["right"]) - np.array(pair["wrong"])
        name = "+".join(STYLES[sensor].letter for sensor in pair["sensors"])
        loss = (gain.max() - gain[place]) / shared
        right, wrong, split = (100 * pair[kind][place] / shared for kind in ("right", "wrong", "split"))
        texts.append(f"{name} {right:.0f} % right, {wrong:.0f} % wrong merges, {split:.0f} % split")
        if loss > WORST_LOSS or gain[place] < shared / 2:
            faults.append(f"{name}: best at {pair['best']:g} {unit}" if loss > WORST_LOSS else f"{name}: no gate does")
    return f"at a gate of {gate:g} {unit} {'; '.join(texts)}" + (
        f" ({', '.join(faults)})" if faults else ""
    ), not faults


def _pair(one: str, other: str, counts: NDArray[np.int64], gates: Sequence[float]) -> dict[str, Any]:
    right, wrong, split, shared = counts.T
    return {
        "sensors": [one, other],
        "shared": int(shared[0]),
        "right": right.tolist(),
        "wrong": wrong.tolist(),
        "split": split.tolist(),
        "best": gates[int(np.argmax(right - wrong))],
    }
