"""Whether two sensors' views from above lie on each other: their heat cross-correlated over turns and shifts.

Heat is a sum of Gaussians (:mod:`fusion_net.evaluation.audits.heat`). The cross-correlation of two such maps is again a sum of
Gaussians (kernel correlation, Tsin and Kanade, ECCV 2004), so it needs no raster, and its maximum over (turn, shift) is found
to a fraction of a cell: by iterated weighted least squares, which is mean shift in these three parameters. The kernels begin
wide and become as narrow as the evidence itself (graduated non-convexity). What is done to one view as a whole, the found
motion follows exactly: the method has no part in what an audit underrates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from fusion_net.evaluation.audits.heat import Heat

Array = NDArray[np.float64]

REACH = 6.0
"""Metres: Gaussians of one class that are farther apart are not compared."""
WIDTHS = (2.0, 1.0, 0.5, 0.25, 0.0)
"""Metres by which the Gaussians are widened, one pass after the other."""
FAR = 36.0
"""Squared Mahalanobis distance before a pass from which on a pair adds nothing to the maximum that the pass finds."""
FEWEST_PAIRS = 30


@dataclass(frozen=True)
class Pairs:
    """P pairs of Gaussians of two sensors, of one class and sample, within REACH; the motion is from ``a`` to ``b``."""

    a: Array  # (P, 2) metres, ego frame
    b: Array  # (P, 2)
    cov: Array  # (P, 2, 2) of b - a, m^2
    weight: Array  # (P,) product of both weights
    sample: NDArray[np.int64]  # (P,)

    def __getitem__(self, index) -> "Pairs":
        return Pairs(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def __len__(self) -> int:
        return len(self.weight)


@dataclass(frozen=True)
class Motion:
    """A turn about the ego origin, then a shift, in the plane."""

    turn: float  # radians, counter-clockwise
    shift: Array  # (2,) metres

    def __call__(self, places: Array) -> Array:
        """Places (P, 2), moved."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        moved: Array = places @ np.array([[c, s], [-s, c]]) + self.shift
        return moved


STILL = Motion(0.0, np.zeros(2))


def pair_up(a: Sequence[Heat], b: Sequence[Heat]) -> Pairs:
    """All pairs of two sensors' Gaussians; entry by entry of one sample in its ego frame."""
    none = Pairs(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0, np.int64))
    parts = [none]
    for sample, (one, other) in enumerate(zip(a, b, strict=True)):
        apart = np.linalg.norm(one.center[:, None] - other.center[None], axis=2)
        rows, places = np.nonzero((one.label[:, None] == other.label[None]) & (apart < REACH))
        cov, weight = one.cov[rows] + other.cov[places], one.weight[rows] * other.weight[places]
        parts.append(Pairs(one.center[rows], other.center[places], cov, weight, np.full(len(rows), sample)))
    return Pairs(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Pairs)})


@dataclass(frozen=True)
class Kernels:
    """Of P pairs what their Gaussians are made of, ``wider`` metres wider than their covariances."""

    information: Array  # (3, P) xx, xy, yy of the inverse covariances
    height: Array  # (P,)

    @staticmethod
    def of(pairs: Pairs, *, wider: float = 0.0, copies: Array | None = None) -> "Kernels":
        """``copies`` (S,): how often each sample counts."""
        xx, xy, yy = pairs.cov[:, 0, 0] + wider**2, pairs.cov[:, 0, 1], pairs.cov[:, 1, 1] + wider**2
        determinant = xx * yy - xy * xy
        weight = pairs.weight if copies is None else pairs.weight * copies[pairs.sample]
        return Kernels(np.stack([yy, -xy, xx]) / determinant, weight / np.sqrt(determinant))

    def times(self, x: Array, y: Array) -> tuple[Array, Array]:
        """The information times vectors."""
        xx, xy, yy = self.information
        return xx * x + xy * y, xy * x + yy * y

    def distance(self, error: Array) -> Array:
        """(P,) squared, of errors (P, 2)."""
        x, y = self.times(*error.T)
        return error[:, 0] * x + error[:, 1] * y

    def correlation(self, error: Array) -> Array:
        """(P,) what each pair adds to the cross-correlation of the maps where b - a is ``error`` (P, 2)."""
        return self.height * np.exp(-0.5 * self.distance(error))


def align(pairs: Pairs, *, copies: Array | None = None, start: Motion | None = None) -> Motion:
    """The motion of ``a`` at which the maps agree best. ``copies`` (S,): how often each sample counts; ``start``: the motion
    from which the narrowest kernels are fitted at once."""
    motion = start or STILL
    for wider in WIDTHS if start is None else WIDTHS[-1:]:
        near = pairs[Kernels.of(pairs, wider=wider).distance(pairs.b - motion(pairs.a)) < FAR]
        kernels = Kernels.of(near, wider=wider, copies=copies)
        for _ in range(50):
            step = _step(near, motion, kernels)
            motion = Motion(motion.turn + step[0], motion.shift + step[1:])
            if np.abs(step).max() < 1e-5:
                break
    return motion


def _step(pairs: Pairs, motion: Motion, kernels: Kernels) -> Array:
    """(3,) the change of turn and shift that weighted least squares asks for."""
    moved = motion(pairs.a)
    error = pairs.b - moved
    weight = kernels.correlation(error)
    x, y = (moved - motion.shift).T
    by_turn = (-y, x)  # what a small turn does to the points
    pull, turn_pull = kernels.times(*error.T), kernels.times(*by_turn)
    xx, xy, yy = kernels.information @ weight
    a, b = (weight @ each for each in turn_pull)
    c = weight @ (by_turn[0] * turn_pull[0] + by_turn[1] * turn_pull[1])
    normal = np.array([[c, a, b], [a, xx, xy], [b, xy, yy]]) + 1e-9 * np.eye(3)
    right = [weight @ (by_turn[0] * pull[0] + by_turn[1] * pull[1]), weight @ pull[0], weight @ pull[1]]
    return np.linalg.solve(normal, right)


@dataclass(frozen=True)
class Alignment:
    """The motion that puts ``first``'s view onto ``second``'s, with standard errors from resampled scenes; None where there is
    one scene only."""

    first: str
    second: str
    pairs: int
    turn_deg: float = float("nan")
    shift: tuple[float, float] = (float("nan"),) * 2
    turn_error: float | None = None
    shift_error: tuple[float, float] | None = None

    @property
    def is_known(self) -> bool:
        """Whether there were enough pairs."""
        return self.pairs >= FEWEST_PAIRS


def align_sensors(
    names: tuple[str, str], a: Sequence[Heat], b: Sequence[Heat], copies: NDArray[np.int64] | None
) -> Alignment:
    """Compares the views of two sensors, entry by entry of one sample in its ego frame. ``copies`` (R, S): resamples of the
    scenes, whose spread is the standard error; None of a single scene, whose resamples are all alike."""
    pairs = pair_up(a, b)
    if len(pairs) < FEWEST_PAIRS:
        return Alignment(*names, len(pairs))
    best = align(pairs)
    found = Alignment(*names, len(pairs), float(np.degrees(best.turn)), (float(best.shift[0]), float(best.shift[1])))
    if copies is None:
        return found
    spread = [align(pairs, copies=row.astype(float), start=best) for row in copies]
    errors = np.std([[np.degrees(each.turn), *each.shift] for each in spread], axis=0)
    return replace(found, turn_error=float(errors[0]), shift_error=(float(errors[1]), float(errors[2])))


def correlation_by_turn(pairs: Pairs, at: Motion, turns_deg: Array) -> Array:
    """The cross-correlation over turns (N,), shifted as ``at``, as a share of its maximum."""
    kernels, moved = Kernels.of(pairs), (Motion(np.radians(turn), at.shift)(pairs.a) for turn in turns_deg)
    values = np.array([kernels.correlation(pairs.b - each).sum() for each in moved])
    return values / max(values.max(), 1e-12)


def correlation_by_shift(pairs: Pairs, at: Motion, shifts: Array) -> Array:
    """(N, N) the cross-correlation over shifts (N,) along x and, by rows, along y, turned as ``at``, as a share of its
    maximum."""
    kernels, apart = Kernels.of(pairs), pairs.b - Motion(at.turn, np.zeros(2))(pairs.a)
    values = np.array([[kernels.correlation(apart - (x, y)).sum() for x in shifts] for y in shifts])
    return values / max(values.max(), 1e-12)
