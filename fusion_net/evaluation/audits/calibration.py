"""Are the sensors where the calibration has them? The overlay's figures, and the views from above laid over each other."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.modalities import STYLES
from fusion_net.evaluation.audits.alignment import (
    Alignment,
    Motion,
    Pairs,
    align_sensors,
    correlation_by_shift,
    correlation_by_turn,
    pair_up,
)
from fusion_net.evaluation.audits.heat import Heat
from fusion_net.evaluation.audits.result import Audit

Views = Mapping[tuple[str, str], tuple[Sequence[Heat], Sequence[Heat]]]
"""Of two sensors' names the view of each, entry by entry of one sample in its ego frame."""

LARGEST_TURN, LARGEST_SHIFT = 0.3, 0.15
"""Degrees and metres that are no fault."""
SIGMAS = 2.5
"""Standard errors that a turn or a shift must be away from nothing to be one."""
TURNS = np.arange(-5, 5.01, 0.25)
SHIFTS = np.arange(-2, 2.01, 0.2)


def audit_calibration(
    views: Views,
    copies: NDArray[np.int64] | None,
    *,
    overlay: Mapping[str, Any] | None = None,
    usual: Mapping[str, Mapping[str, Any]] | None = None,
) -> Audit:
    """``views``: of :func:`fusion_net.evaluation.audits.heat.heat_of_pairs`; ``copies`` (R, S): resamples of the scenes;
    None of a single scene: what has no error is not judged. ``overlay``: of
    :func:`fusion_net.viz.overlay.measure_overlay`. ``usual``: the ``pairs`` of this audit of sound sensors, whose motions are
    taken off: what the network itself has the sensors off by."""
    title = "Calibration: do the sensors' views lie on each other?"
    explanation = (
        "Overlay: the LiDAR's points in the image, against the exact depth of their pixels where the data have it; the turn"
        " at which most of them fit. From above: what each sensor alone says of objects (the camera: class scores at its own"
        " depth; the others: their points on what they find), as Gaussians, cross-correlated over turns about the"
        " car's origin and shifts; errors are standard errors from resampled scenes, and of a single"
        " scene, which has none, these views are not judged. What the camera says of"
        f" distances is its own guess, so its shift ahead (x) is not judged. Wrong from {LARGEST_TURN:g} degrees or"
        f" {LARGEST_SHIFT:g} m on that are {SIGMAS:g} standard errors away from nothing. A turn is counter-clockwise; it is"
        " what the first sensor's view has to be moved by."
    )
    numbers: dict[str, Any] = {"overlay": dict(overlay or {}), "pairs": {}, "curves": {}}
    for names, (first, second) in views.items():
        alignment = align_sensors(names, first, second, copies)
        key = "+".join(STYLES[name].letter for name in names)
        numbers["pairs"][key] = _figures(alignment, (usual or {}).get(key))
        if alignment.is_known:
            numbers["curves"][key] = _curves(pair_up(first, second), alignment)
    known = {key: pair for key, pair in numbers["pairs"].items() if pair["turn_deg"] is not None}
    judged = {key: pair for key, pair in known.items() if pair["turn_error"] is not None}
    off = [key for key, pair in judged.items() if _is_off(pair)]
    slipped, texts = False, []
    if overlay:
        turn, error = overlay["turn_deg"], overlay["turn_error"]
        slipped = abs(turn) > max(LARGEST_TURN, SIGMAS * error)
        texts.append(f"overlay {turn:+.2f} +- {error:.2f} degrees")
    texts += [_text(key, pair) for key, pair in known.items()]
    if known and not judged:
        texts.append(f"{', '.join(known)} not judged: one scene, so no standard error")
    if not texts:
        return Audit("calibration", title, "too little that two sensors have in common", None, numbers, explanation)
    culprit = _culprit(off, judged)
    numbers["culprit"] = culprit
    verdict = "; ".join(texts) + (f"; {culprit}" if culprit else "")
    ok = not off and not slipped if overlay or judged else None
    return Audit("calibration", title, verdict, ok, numbers, explanation)


def _figures(alignment: Alignment, usual: Mapping[str, Any] | None) -> dict[str, Any]:
    """Plain values; None where nothing is known."""
    base: dict[str, Any] = {"sensors": [alignment.first, alignment.second], "pairs": alignment.pairs}
    if not alignment.is_known:
        return base | dict.fromkeys(("turn_deg", "turn_error", "shift", "shift_error"))
    turn, shift = alignment.turn_deg, np.array(alignment.shift)
    if usual is not None and usual["turn_deg"] is not None:
        turn, shift = turn - usual["turn_deg"], shift - usual["shift"]
        base["usual"] = {"turn_deg": usual["turn_deg"], "shift": list(usual["shift"])}
    return base | {
        "turn_deg": turn,
        "turn_error": alignment.turn_error,
        "shift": shift.tolist(),
        "shift_error": alignment.shift_error and list(alignment.shift_error),
    }


def _judged(pair: Mapping[str, Any]) -> list[tuple[float, float, float]]:
    """Turn, shift to the left and, of sensors that measure distances, shift ahead: each with its error and what is no fault."""
    values = [(pair["turn_deg"], pair["turn_error"], LARGEST_TURN)]
    axes = (1,) if "camera" in pair["sensors"] else (1, 0)
    return values + [(pair["shift"][axis], pair["shift_error"][axis], LARGEST_SHIFT) for axis in axes]


def _is_off(pair: Mapping[str, Any]) -> bool:
    return any(abs(value) > max(allowed, SIGMAS * error) for value, error, allowed in _judged(pair))


def _culprit(off: Sequence[str], known: Mapping[str, Any]) -> str:
    """The one sensor whose motion explains all three pairs, and that of no other nearly as well."""
    if not off:
        return ""
    misfits = sorted((_misfit(sensor, known.values()), style.label) for sensor, style in STYLES.items())
    if len(known) == len(STYLES) and misfits[1][0] - misfits[0][0] > SIGMAS**2:
        return f"it is the {misfits[0][1]}"
    return f"{' and '.join(off)} off"


def _misfit(sensor: str, pairs: Iterable[Mapping[str, Any]]) -> float:
    """The sum of squares, in standard errors, that a turn and a shift to the left of this sensor alone leave of all pairs."""
    left = 0.0
    for quantity in range(2):
        rows = []
        for pair in pairs:
            value, error, allowed = _judged(pair)[quantity]
            sign = {pair["sensors"][0]: 1, pair["sensors"][1]: -1}.get(sensor, 0)
            rows.append((value, np.hypot(error, allowed / SIGMAS), sign))
        value, error, sign = np.array(rows).T
        motion = (sign * value / error**2).sum() / max((sign**2 / error**2).sum(), 1e-12)
        left += float((((value - sign * motion) / error) ** 2).sum())
    return left


def _text(key: str, pair: Mapping[str, Any]) -> str:
    x, y = pair["shift"]
    if pair["turn_error"] is None:
        return f"{key} turned {pair['turn_deg']:+.2f} degrees, shifted ({x:+.2f}, {y:+.2f}) m"
    dx, dy = pair["shift_error"]
    return (
        f"{key} turned {pair['turn_deg']:+.2f} +- {pair['turn_error']:.2f} degrees, shifted ({x:+.2f} +- {dx:.2f},"
        f" {y:+.2f} +- {dy:.2f}) m"
    )


def _curves(pairs: Pairs, alignment: Alignment) -> dict[str, Any]:
    """The cross-correlation about its maximum, for the picture."""
    best = Motion(np.radians(alignment.turn_deg), np.array(alignment.shift))
    around = [float(value) for value in np.round(SHIFTS, 3)]
    return {
        "turns_deg": np.round(TURNS, 3).tolist(),
        "by_turn": np.round(correlation_by_turn(pairs, best, TURNS), 4).tolist(),
        "shifts": around,
        "by_shift": np.round(correlation_by_shift(pairs, best, SHIFTS), 4).tolist(),
    }
