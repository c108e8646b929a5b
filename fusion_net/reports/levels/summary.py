"""The document behind the page: the lesson's trade-off table with a figure in every cell, the curves, and the verdicts."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from fusion_net.common.modalities import STYLES
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.cells.plan import SOUND, SWAPPED_BEAMS
from fusion_net.evaluation.drop_table import SUBSETS
from fusion_net.reports.ablation.compare import compare, two_level
from fusion_net.reports.levels.measured import COSTS, Measured
from fusion_net.reports.levels.orders import INFORMATION, ROBUSTNESS, verdict
from fusion_net.reports.levels.runs import LEVELS, LevelRun, gaps
from fusion_net.reports.levels.scores import Curve, Estimate, LevelScores, mean_left, mean_slope, ratio
from fusion_net.reports.run_result import SCALE
from fusion_net.reports.tables import name_of

WHOLE = "C+L+R"
PARTS = [name_of(subset) for subset in SUBSETS[1:]]
"""The six proper subsets of the sensors."""
LETTER = {name: STYLES[name].letter for name in MODALITIES}


def summarise(runs: Sequence[LevelRun], measured: Sequence[Measured]) -> dict[str, Any]:
    """Everything that the page shows, as plain values. A level without runs, or a row without cells, says so."""
    scored = [run for run in runs if run.job.result is not None]
    shared = _shared((run.level, run.job.seed) for run in scored)
    cell_seeds = _shared((each.run.level, each.run.job.seed) for each in measured if SOUND.group in each.groups)
    levels = {level: LevelScores(level, measured, cell_seeds) for level in LEVELS}
    found = {level: scores for level, scores in levels.items() if scores.seeds}
    seeds = {level: _over_seeds([run for run in scored if run.job.seed in shared], level) for level in LEVELS}
    return {
        "gaps": gaps(runs),
        "seeds": sorted(shared),
        "cell_seeds": sorted(cell_seeds),
        "runs": _runs(runs),
        "information": _information(scored, seeds),
        "levels": {level: _level(scores) | _dropout(seeds[level]) for level, scores in found.items()},
        "costs": {each.run.level: each.groups[COSTS][COSTS] for each in reversed(measured) if COSTS in each.groups},
        "conditions": {level: _conditions(scores) for level, scores in found.items()},
        "corruptions": _corruptions(found),
        "orders": _orders(found, seeds),
        "seconds": _seconds(measured),
    }


def _shared(pairs: Iterable[tuple[str, int]]) -> set[int]:
    """The seeds that every level which has any has: what is compared rests on the same ones."""
    seeds: dict[str, set[int]] = {}
    for level, seed in pairs:
        seeds.setdefault(level, set()).add(seed)
    return set.intersection(*seeds.values()) if seeds else set()


def _over_seeds(runs: Sequence[LevelRun], level: str) -> dict[str, Estimate]:
    """mAP by subset of all seeds of a level, draws over seeds and scenes; of nothing but whole results."""
    results = [run.job.result for run in runs if run.level == level and run.job.result is not None]
    if not results:
        return {}
    found = {}
    for name in [WHOLE, *PARTS]:
        values = [row["mAP"] for result in results for row in result["rows"] if name_of(row["sensors"]) == name]
        resampled = np.array([result["mAP_resampled"][name] for result in results]) / SCALE
        # the same draws of scenes and of seeds for all levels and subsets: differences are paired
        found[name] = Estimate(float(np.mean(values)), two_level(resampled, np.random.default_rng(0)))
    return found


def _runs(runs: Sequence[LevelRun]) -> list[dict[str, Any]]:
    rows = []
    for run in runs:
        result = run.job.result or {}
        rows.append(
            {"level": run.level, "seed": run.job.seed, "run": run.job.name}
            | {name: result.get(name) for name in ("steps", "minutes", "git")}
        )
    return rows


def _information(scored: Sequence[LevelRun], seeds: Mapping[str, dict[str, Estimate]]) -> dict[str, Any]:
    """What the ablation report says of the levels as variants."""
    if not scored:
        return {}
    doc = compare([run.job for run in scored])
    for variant, level in zip(doc["variants"], dict.fromkeys(run.level for run in scored), strict=True):
        variant["label"] = level
    return doc


def _dropout(mAP: Mapping[str, Estimate]) -> dict[str, Any]:
    """What is left without sensors that are known to be absent."""
    if not mAP:
        return {}
    left = {name: ratio([mAP[name]], mAP[WHOLE]).plain() for name in PARTS}
    return {"absent": left, "absent_mean": ratio([mAP[name] for name in PARTS], mAP[WHOLE]).plain()}


def _level(scores: LevelScores) -> dict[str, Any]:
    curves = {group: scores.curves(group) for group in ("calibration", "shake", "clocks")}
    turned, moved = _by_kind(curves["calibration"])
    return {
        "sound": {"mAP": scores.sound().plain(), "NDS": scores.sound(figure="NDS").value},
        "curves": {group: [_plain(curve) for curve in each] for group, each in curves.items()},
        "per_degree": _or_none(mean_slope(turned)),
        "per_10cm": _or_none(mean_slope(moved, 0.1)),
        "first_break": {"deg": _first_break(turned), "m": _first_break(moved)},
        "left_misaligned": _or_none(mean_left(curves["calibration"])),
        "left_shaken": _or_none(mean_left(curves["shake"])),
        "left_late": _or_none(mean_left(_uncompensated(curves["clocks"]))),
        "clocks_by_speed": {
            name: [_plain(curve) for curve in each] for name, each in scores.part_curves("clocks", "speed").items()
        },
        "deaths": {name: ratio([each], scores.sound()).plain() for name, each in _deaths(scores).items()},
        "swap": {name: _difference(scores, name) for name in scores.cells("swap")},
    }


def _deaths(scores: LevelScores) -> dict[str, Estimate]:
    """Scores with one sensor known to be absent, blank without a word, and half a second old."""
    found = {}
    for sensor in MODALITIES:
        others = "+".join(LETTER[name] for name in MODALITIES if name != sensor)
        for name, score in (
            (f"{sensor} absent", scores.score("sound", "sound", others)),
            (f"{sensor} blank", scores.score("deaths", f"{sensor} blank")),
            (f"{sensor} stale", scores.score("deaths", f"{sensor} stale")),
        ):
            if score is not None:
                found[name] = score
    return found


def _silent(scores: LevelScores) -> Estimate | None:
    blank = [score for name, score in _deaths(scores).items() if name.endswith("blank")]
    return ratio(blank, scores.sound()) if len(blank) == len(MODALITIES) else None


def _difference(scores: LevelScores, name: str) -> dict[str, Any]:
    own, sound = scores.score("swap", name), scores.sound()
    assert own is not None
    return Estimate(own.value - sound.value, own.draws - sound.draws).plain()


def _corruptions(found: Mapping[str, LevelScores]) -> dict[str, Any]:
    """MultiCorrupt's figures (Beemelmanns et al. 2024, arXiv 2402.11677), over every preset of configs/fault: the resistance
    ability RA of a corruption is the mean over its severities of NDS / NDS without it, mRA the mean of RA; the relative
    resistance ability RRA is the sum of NDS over the severities as a share of the sum of ``mid``, less 1."""
    nds = {level: _by_corruption(scores) for level, scores in found.items()}
    rows: dict[str, Any] = {}
    for level, scores in found.items():
        sound = scores.sound(figure="NDS").value
        own = {name: float(np.mean(values)) / sound for name, values in nds[level].items()}
        base = nds.get("mid", {})
        relative = {name: sum(values) / sum(base[name]) - 1 for name, values in nds[level].items() if name in base}
        if own:
            rows[level] = {
                "RA": own,
                "mRA": float(np.mean([*own.values()])),
                "RRA": relative,
                "mRRA": float(np.mean([*relative.values()])) if relative else None,
            }
    return rows


def _by_corruption(scores: LevelScores) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for cells in scores.cells("corruptions").values():
        found.setdefault(cells[0]["curve"], []).append(float(np.mean([cell["scores"][WHOLE]["NDS"] for cell in cells])))
    return found


def _conditions(scores: LevelScores) -> dict[str, Any]:
    """By part and group of the first seed, the mAP of each subset and the number of labels."""
    cells = [*scores.cells("conditions").values()]
    if not cells:
        return {}
    first = cells[0][0]["scores"]
    parts: dict[str, Any] = {}
    for part in first[WHOLE]["parts"]:
        parts[part] = {
            row["group"]: {
                "labels": row["labels"],
                "ci95": row["mAP_ci95"],
                "mAP": {name: first[name]["parts"][part][place]["mAP"] for name in first},
            }
            for place, row in enumerate(first[WHOLE]["parts"][part])
        }
    return parts


def _orders(found: Mapping[str, LevelScores], seeds: Mapping[str, dict[str, Estimate]]) -> list[dict[str, Any]]:
    def of(function: Callable[[LevelScores], Estimate | None]) -> dict[str, Estimate | None]:
        return {level: function(scores) for level, scores in found.items()}

    known = {level: mAP for level, mAP in seeds.items() if mAP}
    return [
        verdict("information: mAP with all sensors", INFORMATION, {level: mAP[WHOLE] for level, mAP in known.items()}),
        verdict(
            "graceful dropout: share of mAP left without sensors known to be absent",
            ROBUSTNESS,
            {level: ratio([mAP[name] for name in PARTS], mAP[WHOLE]) for level, mAP in known.items()},
        ),
        verdict("silent death: share of mAP left with one sensor blank", ROBUSTNESS, of(_silent)),
        verdict(
            "misalignment: share of mAP left with one sensor turned or moved",
            ROBUSTNESS,
            of(lambda scores: mean_left(scores.curves("calibration"))),
        ),
        verdict("shaking mounts: share of mAP left", ROBUSTNESS, of(lambda scores: mean_left(scores.curves("shake")))),
        verdict(
            "clocks: share of mAP left with one sensor late, not compensated",
            ROBUSTNESS,
            of(lambda scores: mean_left(_uncompensated(scores.curves("clocks")))),
        ),
        verdict(
            "corruptions: share of mAP left, mean over presets",
            ROBUSTNESS,
            of(lambda scores: mean_left(scores.curves("corruptions"))),
        ),
        verdict(
            f"another LiDAR ({SWAPPED_BEAMS} beams) without training: share of mAP left",
            ROBUSTNESS,
            of(_swapped),
        ),
    ]


def _swapped(scores: LevelScores) -> Estimate | None:
    names = [*scores.cells("swap")]
    score = scores.score("swap", names[0]) if names else None
    return None if score is None else ratio([score], scores.sound())


def _by_kind(curves: Sequence[Curve]) -> tuple[list[Curve], list[Curve]]:
    """Those over degrees and those over metres."""
    turned = [curve for curve in curves if curve.name.split()[1] in ("roll", "pitch", "yaw")]
    return turned, [curve for curve in curves if curve not in turned]


def _uncompensated(curves: Sequence[Curve]) -> list[Curve]:
    return [curve for curve in curves if curve.name.endswith("none")]


def _first_break(curves: Sequence[Curve]) -> dict[str, Any] | None:
    """The fault that breaks first, and at which amount; its largest amount where none does."""
    if not curves:
        return None
    first = min(curves, key=lambda curve: (curve.break_point.value, -abs(curve.slope.value)))
    return {"curve": first.name, "at": first.break_point.plain(), "to": float(first.amounts[-1])}


def _plain(curve: Curve) -> dict[str, Any]:
    low, high = np.percentile(curve.draws, [2.5, 97.5], axis=1)
    return {
        "name": curve.name,
        "amounts": curve.amounts.tolist(),
        "mAP": curve.scores.tolist(),
        "low": low.tolist(),
        "high": high.tolist(),
        "slope": curve.slope.plain(),
        "break_point": curve.break_point.plain(),
    }


def _or_none(estimate: Estimate | None) -> dict[str, Any] | None:
    return None if estimate is None else estimate.plain()


def _seconds(measured: Sequence[Measured]) -> dict[str, Any]:
    """How long the cells took, in all and by group: seconds a cell and a run, the reading included."""
    found: dict[str, list[float]] = {}
    for each in measured:
        for group, cells in each.groups.items():
            if group != COSTS:
                found.setdefault(group, []).extend(cell["seconds"] for cell in cells.values())
    return {
        "total": sum(sum(values) for values in found.values()),
        "by_group": {group: {"cells": len(values), "mean": float(np.mean(values))} for group, values in found.items()},
    }
