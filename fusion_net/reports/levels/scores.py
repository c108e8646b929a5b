"""The cells of one level of fusion: scores, what is left of them under a fault, and the curves that they make.

A level may have several seeds. A cell's score is their mean, on each resample of the scenes too: intervals of cells are over
scenes. All cells of all levels are scored on the same resamples, so what is derived of several is paired.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.evaluation.bootstrap import interval
from fusion_net.evaluation.cells.curves import break_point, slope
from fusion_net.evaluation.cells.measure import SCALE
from fusion_net.evaluation.cells.plan import SOUND
from fusion_net.reports.levels.measured import Measured

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A figure and what it is on each resample of the scenes."""

    value: float
    draws: Array  # (R,)

    @property
    def ci95(self) -> list[float]:
        """The 95 % interval; its ends may be infinite."""
        if np.isfinite(self.draws).all():
            return interval(self.draws)
        return [float(end) for end in np.percentile(self.draws, [2.5, 97.5], method="nearest")]

    def plain(self) -> dict[str, Any]:
        """For JSON; None stands for the infinite."""
        ends = [self.value, *self.ci95]
        value, low, high = (each if np.isfinite(each) else None for each in ends)
        return {"value": value, "ci95": [low, high]}


@dataclass(frozen=True)
class Curve:
    """Scores of one fault over its amount, the sound sensors first. ``scores`` of the split itself, ``draws`` (A, R)."""

    name: str
    amounts: Array  # (A,)
    scores: Array  # (A,)
    draws: Array  # (A, R)

    @property
    def slope(self) -> Estimate:
        """mAP per unit."""
        return self._derived(slope)

    @property
    def break_point(self) -> Estimate:
        """The amount at which a tenth of the sound score is lost."""
        return self._derived(break_point)

    @property
    def left(self) -> Estimate:
        """Share of the sound score that is left, the mean over the amounts above 0."""
        return self._derived(lambda _, scores: scores[1:].mean(axis=0) / np.maximum(scores[0], 1e-9))

    def _derived(self, function) -> Estimate:
        return Estimate(float(function(self.amounts, self.scores[:, None])[0]), function(self.amounts, self.draws))


class LevelScores:
    """The cells of the runs of one level with these ``seeds``."""

    def __init__(self, level: str, measured: Sequence[Measured], seeds: set[int]) -> None:
        self.level = level
        own = [each for each in measured if each.run.level == level and each.run.job.seed in seeds]
        self._runs = [each for each in own if SOUND.name in each.groups.get(SOUND.group, {})]

    @property
    def seeds(self) -> list[int]:
        """Those whose cells are here."""
        return [each.run.job.seed for each in self._runs]

    @property
    def labels(self) -> int:
        """How many objects the scores rest on, those of unknown speed left out."""
        return sum(row["labels"] for row in self.cells(SOUND.group)[SOUND.name][0]["scores"]["C+L+R"]["parts"]["speed"])

    def cells(self, group: str) -> dict[str, list[dict[str, Any]]]:
        """The results of a group by name, one a seed; of those that every seed has."""
        groups = [each.groups.get(group, {}) for each in self._runs]
        if not groups:
            return {}
        return {name: [held[name] for held in groups] for name in groups[0] if all(name in held for held in groups)}

    def score(self, group: str, name: str, sensors: str = "C+L+R", figure: str = "mAP") -> Estimate | None:
        """A cell's score; draws are of mAP whatever the figure. None where it was not measured."""
        cells = self.cells(group).get(name)
        if cells is None or any(sensors not in cell["scores"] for cell in cells):
            return None
        rows = [cell["scores"][sensors] for cell in cells]
        return Estimate(
            float(np.mean([row[figure] for row in rows])), np.mean([row["resampled"] for row in rows], axis=0) / SCALE
        )

    def sound(self, sensors: str = "C+L+R", figure: str = "mAP") -> Estimate:
        """The score without a fault."""
        found = self.score(SOUND.group, SOUND.name, sensors, figure)
        assert found is not None
        return found

    def curves(self, group: str) -> list[Curve]:
        """Of a group every fault that has amounts."""
        points: dict[str, list[tuple[float, Estimate]]] = {}
        for name, cells in self.cells(group).items():
            score = self.score(group, name)
            if cells[0]["curve"] and score is not None:
                points.setdefault(cells[0]["curve"], []).append((cells[0]["amount"], score))
        return [
            _curve(name, [(0.0, self.sound()), *sorted(each, key=lambda pair: pair[0])])
            for name, each in points.items()
        ]

    def part_curves(self, group: str, part: str) -> dict[str, list[Curve]]:
        """The same for each group of labels of a ``part``, such as the speeds, by that group's name."""
        sound = self._part_scores(self.cells(SOUND.group)[SOUND.name], part)
        points: dict[tuple[str, str], list[tuple[float, Estimate]]] = {}
        for cells in self.cells(group).values():
            for name, score in self._part_scores(cells, part).items():
                points.setdefault((name, cells[0]["curve"]), [(0.0, sound[name])]).append((cells[0]["amount"], score))
        found: dict[str, list[Curve]] = {name: [] for name in sound}
        for (name, curve), each in points.items():
            found[name].append(_curve(curve, sorted(each, key=lambda pair: pair[0])))
        return found

    def _part_scores(self, cells: Sequence[dict[str, Any]], part: str) -> dict[str, Estimate]:
        rows = [cell["scores"]["C+L+R"]["parts"][part] for cell in cells]
        return {
            own[0]["group"]: Estimate(
                float(np.mean([row["mAP"] for row in own])), np.mean([row["resampled"] for row in own], axis=0) / SCALE
            )
            for own in zip(*rows, strict=True)
        }


def mean_curve(curves: Sequence[Curve]) -> Curve:
    """The mean of curves of the same amounts."""
    scores, draws = ([getattr(curve, name) for curve in curves] for name in ("scores", "draws"))
    return Curve(curves[0].name, curves[0].amounts, np.mean(scores, axis=0), np.mean(draws, axis=0))


def mean_left(curves: Sequence[Curve]) -> Estimate | None:
    """The mean over several curves of what is left; None without any."""
    if not curves:
        return None
    parts = [curve.left for curve in curves]
    return Estimate(float(np.mean([part.value for part in parts])), np.mean([part.draws for part in parts], axis=0))


def mean_slope(curves: Sequence[Curve], unit: float = 1.0) -> Estimate | None:
    """The mean over several curves of mAP per ``unit`` of the amount."""
    if not curves:
        return None
    parts = [curve.slope for curve in curves]
    return Estimate(
        unit * float(np.mean([part.value for part in parts])), unit * np.mean([part.draws for part in parts], axis=0)
    )


def ratio(above: Sequence[Estimate], below: Estimate) -> Estimate:
    """The mean of scores as a share of one."""
    value = float(np.mean([each.value for each in above])) / max(below.value, 1e-9)
    return Estimate(value, np.mean([each.draws for each in above], axis=0) / np.maximum(below.draws, 1e-9))


def _curve(name: str, points: Sequence[tuple[float, Estimate]]) -> Curve:
    amounts = np.array([amount for amount, _ in points])
    return Curve(
        name, amounts, np.array([each.value for _, each in points]), np.stack([each.draws for _, each in points])
    )
