"""The document behind the page: the lesson's trade-off table with a figure in every cell, the curves, and the verdicts."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.cells.plan import SOUND
from fusion_net.reports.ablation.compare import compare, two_level
from fusion_net.reports.levels.faults import (
    WHOLE,
    by_kind,
    deaths,
    first_break,
    resistance,
    swap_difference,
    uncompensated,
)
from fusion_net.reports.levels.measured import COSTS, Measured
from fusion_net.reports.levels.orders import PARTS, lesson_orders
from fusion_net.reports.levels.runs import LEVELS, LevelRun, gaps
from fusion_net.reports.levels.scores import Curve, Estimate, LevelScores, mean_curve, mean_left, mean_slope, ratio
from fusion_net.reports.run_result import SCALE
from fusion_net.reports.tables import name_of


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
        "labels": next((scores.labels for scores in found.values()), 0),
        "runs": _runs(runs),
        "information": _information(scored, seeds),
        "levels": {level: _level(scores) | _dropout(seeds[level]) for level, scores in found.items()},
        "costs": {each.run.level: each.groups[COSTS][COSTS] for each in reversed(measured) if COSTS in each.groups},
        "conditions": {level: _conditions(scores) for level, scores in found.items()},
        "corruptions": resistance(found),
        "orders": lesson_orders(found, seeds),
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
    turned, moved = by_kind(curves["calibration"])
    return {
        "sound": {"mAP": scores.sound().plain(), "NDS": scores.sound(figure="NDS").value},
        "curves": {group: [_plain(curve) for curve in each] for group, each in curves.items()},
        "panels": {
            f"{sensor} {what}": _plain(mean_curve(own))
            for what, each in (("turned", turned), ("moved", moved), ("late", uncompensated(curves["clocks"])))
            for sensor in MODALITIES
            if (own := [curve for curve in each if curve.name.startswith(sensor)])
        },
        "per_degree": _or_none(mean_slope(turned)),
        "per_10cm": _or_none(mean_slope(moved, 0.1)),
        "first_break": {"deg": first_break(turned), "m": first_break(moved)},
        "left_misaligned": _or_none(mean_left(curves["calibration"])),
        "left_shaken": _or_none(mean_left(curves["shake"])),
        "left_late": _or_none(mean_left(uncompensated(curves["clocks"]))),
        "clocks_by_speed": {
            name: [_plain(curve) for curve in each] for name, each in scores.part_curves("clocks", "speed").items()
        },
        "deaths": {name: ratio([each], scores.sound()).plain() for name, each in deaths(scores).items()},
        "swap": {name: swap_difference(scores, name) for name in scores.cells("swap")},
    }


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
