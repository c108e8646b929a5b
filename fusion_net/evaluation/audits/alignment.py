"""Whether two sensors' views from above lie on each other: their heat cross-correlated over turns and shifts.

A sensor's heat is what the detector finds with it alone: each box a Gaussian at its centre, as wide as the head says that it
may be off, as high as its score. The cross-correlation of two such maps is again a sum of Gaussians (kernel correlation, Tsin
and Kanade, ECCV 2004), so it needs no raster, and its maximum over (turn, shift) is found to a fraction of a cell: by
iterated weighted least squares, which is mean shift in these three parameters. The kernels begin wide and become as narrow
as the boxes' own variance (graduated non-convexity).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes

Array = NDArray[np.float64]

LOWEST_SCORE = 0.1
"""Boxes of a lower score take no part."""
REACH = 6.0
"""Metres: boxes of one class that are farther apart are not compared."""
NARROWEST = 0.2
"""Metres: the least standard deviation of a box's place, whatever the head says."""
WIDTHS = (2.0, 1.0, 0.5, 0.25, 0.0)
"""Metres by which the Gaussians are widened, one pass after the other."""
FEWEST_PAIRS = 30


@dataclass(frozen=True)
class Pairs:
    """P pairs of boxes of two sensors, of one class and sample, within REACH; the motion is from ``a`` to ``b``."""

    a: Array  # (P, 2) metres, ego frame
    b: Array  # (P, 2)
    variance: Array  # (P, 2) of b - a, m^2
    weight: Array  # (P,) product of both scores
    sample: NDArray[np.int64]  # (P,)


@dataclass(frozen=True)
class Motion:
    """A turn about the ego origin, then a shift, in the plane."""

    turn: float  # radians, counter-clockwise
    shift: Array  # (2,) metres

    def residual(self, pairs: Pairs) -> Array:
        """(P, 2) what is left of b - a."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return pairs.b - (pairs.a @ np.array([[c, s], [-s, c]]) + self.shift)


def pair_up(a: Sequence[Boxes], b: Sequence[Boxes]) -> Pairs:
    """All pairs of two sensors' boxes; entry by entry of one sample in its ego frame."""
    columns: list[tuple[Array, Array, Array, Array, NDArray[np.int64]]] = []
    for sample, (one, other) in enumerate(zip(a, b, strict=True)):
        one, other = (boxes[boxes.score >= LOWEST_SCORE] for boxes in (one, other))
        apart = np.linalg.norm(one.center[:, None, :2] - other.center[None, :, :2], axis=2)
        rows, places = np.nonzero((one.label[:, None] == other.label[None]) & (apart < REACH))
        variance = sum(
            np.maximum(np.exp(boxes.log_variance[chosen]), NARROWEST**2)
            for boxes, chosen in ((one, rows), (other, places))
        )
        columns.append(
            (one.center[rows, :2], other.center[places, :2], np.asarray(variance),
             one.score[rows] * other.score[places], np.full(len(rows), sample))
        )  # fmt: skip
    if not columns:
        return Pairs(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64))
    return Pairs(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def correlation(pairs: Pairs, motion: Motion, *, wider: float = 0.0, copies: Array | None = None) -> Array:
    """(P,) what each pair adds to the cross-correlation of the maps, ``a`` moved by ``motion``."""
    variance = pairs.variance + wider**2
    height = pairs.weight / np.sqrt(variance.prod(axis=1))
    if copies is not None:
        height = height * copies[pairs.sample]
    return height * np.exp(-0.5 * (motion.residual(pairs) ** 2 / variance).sum(axis=1))


def align(pairs: Pairs, *, copies: Array | None = None, start: Motion | None = None) -> Motion:
    """The motion of ``a`` at which the maps agree best. ``copies`` (S,): how often each sample counts; ``start``: the motion
    from which the narrowest kernels are fitted at once."""
    motion = start or Motion(0.0, np.zeros(2))
    for wider in WIDTHS if start is None else WIDTHS[-1:]:
        for _ in range(25):
            step = _step(pairs, motion, correlation(pairs, motion, wider=wider, copies=copies), wider)
            motion = Motion(motion.turn + step[0], motion.shift + step[1:])
            if np.abs(step).max() < 1e-5:
                break
    return motion


def _step(pairs: Pairs, motion: Motion, weight: Array, wider: float) -> Array:
    """(3,) the change of turn and shift that weighted least squares asks for."""
    c, s = np.cos(motion.turn), np.sin(motion.turn)
    turned = pairs.a @ np.array([[c, s], [-s, c]])
    by_turn = np.stack([-turned[:, 1], turned[:, 0]], axis=1)  # what a small turn does to the points
    slope = np.zeros((len(turned), 2, 3))
    slope[:, :, 0], slope[:, 0, 1], slope[:, 1, 2] = by_turn, 1.0, 1.0
    information = weight[:, None] / (pairs.variance + wider**2)
    normal = np.einsum("pki,pk,pkj->ij", slope, information, slope) + 1e-9 * np.eye(3)
    right = np.einsum("pki,pk,pk->i", slope, information, motion.residual(pairs))
    return np.linalg.solve(normal, right)


@dataclass(frozen=True)
class Alignment:
    """The motion that puts ``first``'s view onto ``second``'s, with standard errors from resampled scenes."""

    first: str
    second: str
    pairs: int
    turn_deg: float = float("nan")
    turn_error: float = float("nan")
    shift: tuple[float, float] = (float("nan"),) * 2
    shift_error: tuple[float, float] = (float("nan"),) * 2

    @property
    def is_known(self) -> bool:
        """Whether there were enough pairs."""
        return self.pairs >= FEWEST_PAIRS


def align_sensors(boxes: Mapping[str, Sequence[Boxes]], names: tuple[str, str], copies: NDArray[np.int64]) -> Alignment:
    """Compares two of the sensors of ``boxes`` (by name, one entry a sample, each in its ego frame). ``copies`` (R, S):
    resamples of the scenes, whose spread is the standard error."""
    pairs = pair_up(*(boxes[name] for name in names))
    if len(pairs.weight) < FEWEST_PAIRS:
        return Alignment(*names, len(pairs.weight))
    best = align(pairs)
    spread = [align(pairs, copies=row.astype(float), start=best) for row in copies]
    errors = np.std([[np.degrees(each.turn), *each.shift] for each in spread], axis=0)
    return Alignment(
        *names,
        len(pairs.weight),
        float(np.degrees(best.turn)),
        float(errors[0]),
        (float(best.shift[0]), float(best.shift[1])),
        (float(errors[1]), float(errors[2])),
    )


def correlation_by_turn(pairs: Pairs, at: Motion, turns_deg: Array) -> Array:
    """The cross-correlation over turns (N,), shifted as ``at``, as a share of its maximum."""
    values = np.array([correlation(pairs, Motion(np.radians(turn), at.shift)).sum() for turn in turns_deg])
    return values / max(values.max(), 1e-12)


def correlation_by_shift(pairs: Pairs, at: Motion, shifts: Array) -> Array:
    """(N, N) the cross-correlation over shifts (N,) along x and, by rows, along y, turned as ``at``, as a share of its
    maximum."""
    values = np.array([[correlation(pairs, Motion(at.turn, np.array([x, y]))).sum() for x in shifts] for y in shifts])
    return values / max(values.max(), 1e-12)
