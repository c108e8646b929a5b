"""Would the boxes of two sensors be taken for the same objects? Right pairs, wrong merges and splits over gates.

Each detection knows which label it is of, as nuScenes' metric matches them within 4 m. Two sensors' detections are then
associated without the labels, by a :class:`Rule`, and the pairs are judged by the labels: *right* where both are of one label;
a *wrong merge* where they are not, and at least one is of a label (one object swallows another, or a ghost moves it); a *split*
where both sensors have a label and its two detections were not merged (one object counts twice).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from fusion_net.common.modalities import STYLES
from fusion_net.evaluation.audits.alignment import Pairs, align
from fusion_net.evaluation.audits.result import Audit
from fusion_net.evaluation.bootstrap import interval
from fusion_net.models.late.association import same_truth
from fusion_net.models.late.estimates import Estimates
from fusion_net.models.late.fuse import partners
from fusion_net.models.late.late_fusion import LateFusion

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
KINDS = {"right": "right", "wrong": "wrong merges", "split": "split"}
"""What becomes of a pair, in words."""

GATES = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)
"""Metres."""
PROBABILITIES = (0.5, 0.8, 0.9, 0.95, 0.99, 0.999, 0.9999, 0.999999)
"""With which a true partner lies within a gate of late fusion, if the covariances are right."""
WORST_LOSS = 0.1
"""Of the objects that both sensors have, by how much the gate in use may be worse than the best one."""
WORST_OFFSET = 0.05
"""And by how much a motion of one sensor's view may make it worse."""
FEWEST = 30
PAIRS = (("camera", "lidar"), ("camera", "radar"), ("lidar", "radar"))


@dataclass(frozen=True)
class Rule:
    """How a list of two sensors' estimates is associated: ``pair(a, b, gate)`` gives (P, 2) rows of both, each at most once.
    ``gate``: the one in use; None where the detector has none of its own: then each pair of sensors has its best."""

    pair: Callable[[Estimates, Estimates, float], Rows]
    gates: tuple[float, ...]
    unit: str
    gate: float | None = None

    @property
    def tried(self) -> list[float]:
        """All gates, the one in use among them."""
        return sorted({*self.gates, *([] if self.gate is None else [float(self.gate)])})


def by_distance(gate: float | None = None) -> Rule:
    """Pairs of one class nearer than so many metres, so that the sum of min(distance, gate) is least."""
    return Rule(pair_by_distance, GATES, "m", gate)


def by_probability(model: LateFusion) -> Rule:
    """What a model of late fusion does with two detectors' lists, over the probabilities of its gate."""

    def pair(a: Estimates, b: Estimates, gate: float) -> Rows:
        return partners(a, b, association=model.association, gate=gate, min_probability=model.min_probability)

    return Rule(pair, PROBABILITIES, "(probability)", model.gate)


def pair_by_distance(a: Estimates, b: Estimates, gate: float) -> Rows:
    """(P, 2) rows of both."""
    if not len(a) or not len(b):
        return np.zeros((0, 2), np.int64)
    distance = np.linalg.norm(a.boxes.center[:, None, :2] - b.boxes.center[None, :, :2], axis=2)
    distance[a.boxes.label[:, None] != b.boxes.label[None]] = np.inf
    rows, columns = linear_sum_assignment(np.minimum(distance, gate))
    near = distance[rows, columns] < gate
    return np.stack([rows[near], columns[near]], axis=1)


def sort_pairs(pairs: Rows, of_a: Rows, of_b: Rows) -> dict[str, Rows]:
    """Rows (P, 2) of both lists by KINDS, where ``of_a`` and ``of_b`` say which label each row is of, -1 for none. Two ghosts
    are nobody's object; the labels that both sensors have are the right ones and the split ones."""
    one, other = of_a[pairs[:, 0]], of_b[pairs[:, 1]]
    is_right = (one == other) & (one >= 0)
    is_wrong = (one != other) & ((one >= 0) | (other >= 0))
    shared = same_truth(of_a, of_b)
    found = np.isin(of_a[shared[:, 0]], one[is_right])
    return {"right": pairs[is_right], "wrong": pairs[is_wrong], "split": shared[~found]}


def audit_association(found: Mapping[str, Sequence[Estimates]], rule: Rule, copies: NDArray[np.int64]) -> Audit:
    """``found``: what each sensor alone finds, entry by entry of one sample in its ego frame, with the labels that it is of;
    ``copies`` (R, S): resamples of the scenes."""
    title = "Association: are two sensors' boxes taken for the same objects?"
    explanation = (
        "What two sensors find alone, associated within a gate and judged by the labels. Right: both are of one label. Wrong"
        " merge: they are not, so an object is swallowed or moved. Split: both sensors have an object and it would be counted"
        " twice. The gain of a gate is right pairs less wrong merges, as a share of the objects that both sensors have. Wrong"
        f" where the gate in use gains {100 * WORST_LOSS:g} % less than the best one, where a motion of one sensor's view"
        f" (fitted to the objects that both have) would gain {100 * WORST_OFFSET:g} %, each beyond its 95 % interval over"
        " scenes, or where the gain is below a half. A detector without an association of its own is judged at the best gate"
        " of each pair, unless audit_gate= names one."
    )
    pairs = [_audit_pair(one, other, found, rule, copies) for one, other in PAIRS if one in found and other in found]
    numbers: dict[str, Any] = {"gate": rule.gate, "unit": rule.unit, "gates": rule.tried, "pairs": pairs}
    if not any(pair["shared"] >= FEWEST for pair in pairs):
        return Audit("association", title, "too few objects that two sensors have", None, numbers, explanation)
    verdict, ok = judge_gate(numbers, rule.gate)
    return Audit("association", title, verdict, ok, numbers, explanation)


def judge_gate(numbers: Mapping[str, Any], gate: float | None) -> tuple[str, bool]:
    """The verdict in words on one of the ``gates`` that an audit's ``numbers`` hold (None: on the best one of each pair), and
    whether nothing is wrong with it."""
    gates, unit = numbers["gates"], numbers["unit"]
    faults, texts = [], []
    for pair in (pair for pair in numbers["pairs"] if pair["shared"] >= FEWEST):
        used = pair["best"] if gate is None else gate
        place, shared = gates.index(float(used)), pair["shared"]
        gain = (np.array(pair["right"]) - np.array(pair["wrong"])) / shared
        name = "+".join(STYLES[sensor].letter for sensor in pair["sensors"])
        loss = float(gain.max() - gain[place])
        shares = ", ".join(f"{100 * pair[kind][place] / shared:.0f} % {word}" for kind, word in KINDS.items())
        best = f" (best: {pair['best']:g} {unit}, {100 * loss:.0f} % more)" if loss > 0 else ""
        texts.append(f"{name} {shares}{f' at {used:g} {unit}' if gate is None else ''}{best}")
        at_least = pair["loss_ci95"][place][0] if "loss_ci95" in pair else loss
        if loss > WORST_LOSS and at_least > 0:
            faults.append(f"too {'wide' if used > pair['best'] else 'narrow'} for {name}")
        elif gain[place] < 0.5:
            faults.append(f"less than a half for {name}")
        faults += _offset_fault(name, pair.get("offset"))
    start = "" if gate is None else f"at a gate of {gate:g} {unit} "
    return start + "; ".join([*texts, *faults]), not faults


def _offset_fault(name: str, offset: Mapping[str, Any] | None) -> list[str]:
    """What a motion of one sensor's view would mend, if that is much."""
    if offset is None or offset["gain"] <= WORST_OFFSET or offset["gain_ci95"][0] <= 0:
        return []
    x, y = offset["shift"]
    moved = f"turned {offset['turn_deg']:+.1f} degrees and shifted ({x:+.1f}, {y:+.1f}) m"
    return [f"{name}: {100 * offset['gain']:.0f} % more if {offset['sensor']} were {moved}"]


def _audit_pair(
    one: str, other: str, found: Mapping[str, Sequence[Estimates]], rule: Rule, copies: NDArray[np.int64]
) -> dict[str, Any]:
    """The counts of all gates, which is best, what the others lose, what a motion would mend, and a sample to look at."""
    a, b, gates = found[one], found[other], rule.tried
    sorted_out = [[_sorted(rule, *both, gate) for gate in gates] for both in zip(a, b, strict=True)]
    counts = np.array([[[len(each[kind]) for kind in KINDS] for each in row] for row in sorted_out]).reshape(
        -1, len(gates), 3
    )
    shared = counts[:, 0, 0] + counts[:, 0, 2]  # (S,)
    gains = counts[:, :, 0] - counts[:, :, 1]  # (S, G)
    best = int(gains.sum(axis=0).argmax())
    used = best if rule.gate is None else gates.index(float(rule.gate))
    example = int((counts[:, used, 1] + counts[:, used, 2]).argmax()) if len(counts) else None
    return {
        "sensors": [one, other],
        "shared": int(shared.sum()),
        **{kind: counts[:, :, k].sum(axis=0).tolist() for k, kind in enumerate(KINDS)},
        "best": gates[best],
        "loss_ci95": [_interval(gains[:, best] - gains[:, place], shared, copies) for place in range(len(gates))],
        "offset": _offset(one, a, b, rule, gates[used], gains[:, used], shared, copies),
        "example": None if example is None else _drawn(a[example], b[example], sorted_out[example][used]),
    }


def _sorted(rule: Rule, a: Estimates, b: Estimates, gate: float) -> dict[str, Rows]:
    return sort_pairs(rule.pair(a, b, gate), a.truth, b.truth)


def _interval(gain: Rows, shared: Rows, copies: NDArray[np.int64]) -> list[float]:
    """Of a sum of samples (S,) as a share of the shared objects (S,)."""
    return interval((copies @ gain) / np.maximum(copies @ shared, 1))


def _offset(
    sensor: str, a: Sequence[Estimates], b: Sequence[Estimates], rule: Rule, gate: float, gains: Rows, shared: Rows,
    copies: NDArray[np.int64],
) -> dict[str, Any] | None:  # fmt: skip
    """The motion of the first sensor's view that puts it onto the second's at the objects that both have, and what would be
    gained if it were made. None where they have too few."""
    if shared.sum() < FEWEST:
        return None
    motion = align(_shared_pairs(a, b))
    gained = np.zeros_like(gains)
    for sample, (one, other) in enumerate(zip(a, b, strict=True)):
        center = one.boxes.center.copy()
        center[:, :2] = motion(center[:, :2])
        kinds = _sorted(rule, replace(one, boxes=replace(one.boxes, center=center)), other, gate)
        gained[sample] = len(kinds["right"]) - len(kinds["wrong"]) - gains[sample]
    return {
        "sensor": sensor,
        "turn_deg": float(np.degrees(motion.turn)),
        "shift": motion.shift.tolist(),
        "gain": float(gained.sum() / shared.sum()),
        "gain_ci95": _interval(gained, shared, copies),
    }


def _shared_pairs(a: Sequence[Estimates], b: Sequence[Estimates]) -> Pairs:
    """Both sensors' estimates of the objects that both have."""
    columns: list[tuple[Array, Array, Array]] = []
    for one, other in zip(a, b, strict=True):
        rows = same_truth(one.truth, other.truth).T
        cov = one.cov[rows[0]] + other.cov[rows[1]]
        columns.append((one.boxes.center[rows[0], :2], other.boxes.center[rows[1], :2], cov))
    of_a, of_b, cov = (np.concatenate(column) for column in zip(*columns, strict=True))
    return Pairs(of_a, of_b, cov, np.ones(len(of_a)), np.zeros(len(of_a), np.int64))


def _drawn(a: Estimates, b: Estimates, kinds: Mapping[str, Rows]) -> dict[str, Any]:
    """Places for a picture: of both sensors' estimates, and (N, 4) of the two ends of each pair by kind."""
    one, other = a.boxes.center[:, :2], b.boxes.center[:, :2]
    lines = {kind: np.hstack([one[rows[:, 0]], other[rows[:, 1]]]) for kind, rows in kinds.items()}
    drawn = {"first": one, "second": other, **lines}
    return {name: np.round(places, 2).tolist() for name, places in drawn.items()}
