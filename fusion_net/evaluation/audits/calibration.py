"""Are the sensors where the calibration has them? The overlay's figures, and the views from above laid over each other."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
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
from fusion_net.evaluation.audits.result import Audit

PAIRS = (("camera", "lidar"), ("camera", "radar"), ("lidar", "radar"))
LARGEST_TURN, LARGEST_SHIFT = 0.3, 0.15
"""Degrees and metres that are no fault."""
SIGMAS = 2.5
"""Standard errors that a turn or a shift must be away from nothing to be one."""
TURNS = np.arange(-5, 5.01, 0.25)
SHIFTS = np.arange(-2, 2.01, 0.2)


def audit_calibration(
    boxes: Mapping[str, Sequence[Boxes]],
    copies: NDArray[np.int64],
    *,
    overlay: Mapping[str, Any] | None = None,
    usual: Mapping[str, Mapping[str, Any]] | None = None,
) -> Audit:
    """``boxes``: of each sensor alone, entry by entry of one sample in its ego frame; ``copies`` (R, S): resamples of the
    scenes. ``overlay``: of :func:`fusion_net.viz.overlay.measure_overlay`. ``usual``: the ``pairs`` of this audit of sound
    sensors, whose motions are taken off: what the network itself has the sensors off by."""
    title = "Calibration: do the sensors' views lie on each other?"
    explanation = (
        "Overlay: the LiDAR's points in the image, against the exact depth of their pixels where the data have it; the turn"
        " at which most of them fit. From above: what the detector finds with each sensor alone, as Gaussians, cross-correlated"
        " over turns about the car's origin and shifts; errors are standard errors from resampled scenes. Boxes of a camera"
        " or a LiDAR follow a small turn of their sensor by a part only, so this is a lower bound. What the camera says of"
        f" distances is its own guess, so its shift ahead (x) is not judged. Wrong from {LARGEST_TURN:g} degrees or"
        f" {LARGEST_SHIFT:g} m on that are {SIGMAS:g} standard errors away from nothing. A turn is counter-clockwise; it is"
        " what the first sensor's view has to be moved by."
    )
    numbers: dict[str, Any] = {"overlay": dict(overlay or {}), "pairs": {}, "curves": {}}
    for names in PAIRS:
        if names[0] in boxes and names[1] in boxes:
            alignment = align_sensors(boxes, names, copies)
            key = "+".join(STYLES[name].letter for name in names)
            numbers["pairs"][key] = _figures(alignment, (usual or {}).get(key))
            if alignment.is_known:
                numbers["curves"][key] = _curves(pair_up(*(boxes[name] for name in names)), alignment)
    known = {key: pair for key, pair in numbers["pairs"].items() if pair["turn_deg"] is not None}
    off = [key for key, pair in known.items() if _is_off(pair)]
    slipped, texts = False, []
    if overlay:
        turn, error = overlay["turn_deg"], overlay["turn_error"]
        slipped = abs(turn) > max(LARGEST_TURN, SIGMAS * error)
        texts.append(f"overlay {turn:+.2f} +- {error:.2f} degrees")
    texts += [_text(key, pair) for key, pair in known.items()]
    if not texts:
        return Audit("calibration", title, "too few boxes that two sensors have", None, numbers, explanation)
    culprit = _culprit(off, known)
    numbers["culprit"] = culprit
    verdict = "; ".join(texts) + (f"; {culprit}" if culprit else "")
    return Audit("calibration", title, verdict, not off and not slipped, numbers, explanation)


def _figures(alignment: Alignment, usual: Mapping[str, Any] | None) -> dict[str, Any]:
    """Plain values; None where nothing is known."""
    base: dict[str, Any] = {"sensors": [alignment.first, alignment.second], "box_pairs": alignment.pairs}
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
        "shift_error": list(alignment.shift_error),
    }


def _is_off(pair: Mapping[str, Any]) -> bool:
    axes = (1,) if "camera" in pair["sensors"] else (0, 1)
    values = [(pair["turn_deg"], pair["turn_error"], LARGEST_TURN)]
    values += [(pair["shift"][axis], pair["shift_error"][axis], LARGEST_SHIFT) for axis in axes]
    return any(abs(value) > max(allowed, SIGMAS * error) for value, error, allowed in values)


def _culprit(off: Sequence[str], known: Mapping[str, Any]) -> str:
    """The one sensor that all pairs that are off have in common, and no other pair has."""
    if not off:
        return ""
    for sensor, style in STYLES.items():
        with_it = [key for key, pair in known.items() if sensor in pair["sensors"]]
        if len(known) == len(PAIRS) and set(with_it) == set(off):
            return f"it is the {style.label}"
    return f"{' and '.join(off)} off"


def _text(key: str, pair: Mapping[str, Any]) -> str:
    x, y = pair["shift"]
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
