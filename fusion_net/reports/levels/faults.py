"""Figures that are made of several cells of a level: how it is without a sensor, with one turned, late, or swapped."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fusion_net.common.modalities import letters
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.cells.plan import SOUND
from fusion_net.reports.levels.scores import Curve, Estimate, LevelScores, ratio

WHOLE = letters(MODALITIES)


def deaths(scores: LevelScores) -> dict[str, Estimate]:
    """Scores with one sensor known to be absent, blank without a word, and half a second old."""
    found = {}
    for sensor in MODALITIES:
        others = letters(name for name in MODALITIES if name != sensor)
        for name, score in (
            (f"{sensor} absent", scores.score(SOUND.group, SOUND.name, others)),
            (f"{sensor} blank", scores.score("deaths", f"{sensor} blank")),
            (f"{sensor} stale", scores.score("deaths", f"{sensor} stale")),
        ):
            if score is not None:
                found[name] = score
    return found


def blank_left(scores: LevelScores) -> Estimate | None:
    """Share of mAP left with one sensor blank, mean over the sensors; None until each was measured."""
    blank = [score for name, score in deaths(scores).items() if name.endswith("blank")]
    return ratio(blank, scores.sound()) if len(blank) == len(MODALITIES) else None


def swap_difference(scores: LevelScores, name: str) -> dict[str, Any]:
    """mAP gained (mostly lost) by the swap of a sensor without training, paired over scenes."""
    own, sound = scores.score("swap", name), scores.sound()
    assert own is not None
    return Estimate(own.value - sound.value, own.draws - sound.draws).plain()


def swap_left(scores: LevelScores) -> Estimate | None:
    """Share of mAP left after the first swap of a sensor that was measured; None where none was."""
    names = [*scores.cells("swap")]
    score = scores.score("swap", names[0]) if names else None
    return None if score is None else ratio([score], scores.sound())


def by_kind(curves: Sequence[Curve]) -> tuple[list[Curve], list[Curve]]:
    """Those over degrees and those over metres."""
    turned = [curve for curve in curves if curve.name.split()[1] in ("roll", "pitch", "yaw")]
    return turned, [curve for curve in curves if curve not in turned]


def uncompensated(curves: Sequence[Curve]) -> list[Curve]:
    """Of the curves over a clock's delay those that nothing compensates."""
    return [curve for curve in curves if curve.name.endswith("none")]


def first_break(curves: Sequence[Curve]) -> dict[str, Any] | None:
    """The fault that breaks first, and at which amount; its largest amount where none does."""
    if not curves:
        return None
    first = min(curves, key=lambda curve: (curve.break_point.value, -abs(curve.slope.value)))
    return {"curve": first.name, "at": first.break_point.plain(), "to": float(first.amounts[-1])}


def resistance(found: Mapping[str, LevelScores]) -> dict[str, Any]:
    """MultiCorrupt's figures (Beemelmanns et al. 2024, arXiv 2402.11677), over every preset of configs/fault: the resistance
    ability RA of a corruption is the mean over its severities of NDS / NDS without it, mRA the mean of RA; the relative
    resistance ability RRA is the sum of NDS over the severities as a share of the sum of ``mid``, less 1."""
    nds = {level: _by_corruption(scores) for level, scores in found.items()}
    rows: dict[str, Any] = {}
    for level, scores in found.items():
        sound = scores.sound(figure="NDS").value
        base = nds.get("mid", {})
        own = {name: float(np.mean(values)) / sound if sound else None for name, values in nds[level].items()}
        relative = {
            name: sum(values) / sum(base[name]) - 1 for name, values in nds[level].items() if any(base.get(name, ()))
        }
        if nds[level]:
            rows[level] = {"RA": own, "mRA": _mean(own), "RRA": relative, "mRRA": _mean(relative)}
    return rows


def _mean(values: Mapping[str, float | None]) -> float | None:
    """Of what is known; None where nothing is: a run that finds nothing has nothing to lose."""
    known = [value for value in values.values() if value is not None]
    return float(np.mean(known)) if known else None


def _by_corruption(scores: LevelScores) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for cells in scores.cells("corruptions").values():
        found.setdefault(cells[0]["curve"], []).append(float(np.mean([cell["scores"][WHOLE]["NDS"] for cell in cells])))
    return found
