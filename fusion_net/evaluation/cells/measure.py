"""The scores of detectors in one cell: the faulty data are made once and shown to all of them."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.modalities import letters
from fusion_net.evaluation.bootstrap import bootstrap_map
from fusion_net.evaluation.cells.cell import Cell
from fusion_net.evaluation.cells.samples import CellSamples, Index
from fusion_net.evaluation.drop_table import Detector, describe, predict
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.evaluation.strata import (
    EVERYWHERE,
    NOWHERE,
    Grouping,
    GroupScore,
    by_condition,
    by_range,
    by_visibility,
    score_groups,
)
from fusion_net.metrics.matching import TP_ERRORS
from fusion_net.metrics.sample_boxes import SampleBoxes

SPEEDS = (1.0, 8.0)
"""m/s at which labels count as moving, and as fast."""
SCALE = 10_000
"""Resampled scores are kept in ten thousandths."""


def measure(
    cell: Cell,
    detectors: Mapping[str, Detector],
    samples: CellSamples,
    *,
    context: Callable[[], AbstractContextManager] = nullcontext,
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Of each detector its name and, as plain values, what :func:`_scores` gives for each subset of the cell, and the seconds
    of processor time that it took, its share of the reading included: other programs do not make them longer."""
    start = time.process_time()
    batches = samples.batches(cell)
    reading = (time.process_time() - start) / len(detectors)
    for name, detector in detectors.items():
        start = time.process_time()
        with context():
            found, _ = predict(detector, batches, subsets=cell.subsets, show=False)
        scores = {}
        for subset, boxes in zip(cell.subsets, found, strict=True):
            table = samples.truth.table([boxes[token] for token in samples.truth.tokens])
            scores[letters(subset)] = _scores(cell, table, samples, is_whole=subset == cell.subsets[0])
        seconds = reading + time.process_time() - start
        yield name, {"curve": cell.curve, "amount": cell.amount, "seconds": round(seconds, 2), "scores": scores}


def _scores(cell: Cell, table: SampleBoxes, samples: CellSamples, *, is_whole: bool) -> dict[str, Any]:
    """mAP, NDS, the five errors, mAP on each resample, and mAP by each grouping of the cell: on each resample by speed, with
    an interval by the others, and of further subsets of the sensors alone, since intervals take most of the time."""
    matches = samples.truth.matches(table)
    figures = describe(samples.truth.metric.summarise(matches))
    row: dict[str, Any] = {name: _rounded(figures[name]) for name in ("mAP", "NDS", *TP_ERRORS)}
    row["resampled"] = scaled(bootstrap_map(samples.truth.metric, matches, samples.copies))
    for part in cell.parts:
        grouping, copies = (
            GROUPINGS[part](samples.truth, samples.index),
            samples.copies if is_whole else samples.copies[:1],
        )
        rows = [_part(score, part) for score in score_groups(samples.truth, table, grouping, copies)]
        row.setdefault("parts", {})[part] = (
            rows if is_whole else [{"group": each["group"], "mAP": each["mAP"]} for each in rows]
        )
    return row


def scaled(values: NDArray[np.float64]) -> list[int]:
    """Scores as whole ten thousandths."""
    return [int(value) for value in np.rint(SCALE * values)]


def _part(score: GroupScore, part: str) -> dict[str, Any]:
    row = score.row()
    kept = {"group": row["group"], "labels": row["labels"], "mAP": _rounded(row["mAP"])}
    if part == "speed":
        resampled = np.where(np.isnan(score.resampled), score.mAP, score.resampled)  # without a label of these
        return kept | {"resampled": scaled(resampled)}
    return kept | {"mAP_ci95": row["mAP_ci95"] and [_rounded(end) for end in row["mAP_ci95"]]}


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def by_speed(truth: GroundTruth, edges: Sequence[float] = SPEEDS) -> Grouping:
    """By the speed of the label over ground; a false alarm counts in each group, a label of unknown speed in none."""
    speed = np.linalg.norm(truth.labels.boxes.velocity, axis=1)
    label = np.where(np.isnan(speed), NOWHERE, np.searchsorted(edges, np.nan_to_num(speed), side="right"))
    ends = [0, *edges]
    names = (*(f"{low:g}-{high:g} m/s" for low, high in pairwise(ends)), f"above {ends[-1]:g} m/s")
    return Grouping("speed", names, label, lambda found: np.full(len(found), EVERYWHERE))


def crossed(first: Grouping, second: Grouping) -> Grouping:
    """Every pair of a group of one and a group of the other; both say of any prediction where it belongs."""

    def both(one: NDArray[np.int64], other: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.where((one < 0) | (other < 0), NOWHERE, one * len(second.names) + other)

    names = tuple(f"{one}, {other}" for one in first.names for other in second.names)
    return Grouping(
        f"{first.axis} x {second.axis}",
        names,
        both(first.label, second.label),
        lambda found: both(first.of_found(found), second.of_found(found)),
    )


def _crossed_with_range(truth: GroundTruth, index: Index) -> Grouping:
    return crossed(by_condition(truth, index), by_range(truth))


GROUPINGS: dict[str, Callable[[GroundTruth, Index], Grouping]] = {
    "condition": by_condition,
    "severity": lambda truth, index: by_condition(truth, index, by_severity=True),
    "range": lambda truth, index: by_range(truth),
    "visibility": lambda truth, index: by_visibility(truth),
    "condition x range": _crossed_with_range,
    "speed": lambda truth, index: by_speed(truth),
}
"""Ways to divide the labels, by the names that a cell's ``parts`` have."""
