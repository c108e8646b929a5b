"""Rectangles on the ground over time: do two bodies touch?"""

import math
from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def _ufunc(function: Callable) -> Callable:
    """Compile an element-wise function of eight numbers that broadcasts, cached on disk where a folder can be written."""
    try:
        return numba.vectorize(["boolean(f8, f8, f8, f8, f8, f8, f8, f8)"], cache=True)(function)
    except RuntimeError:
        return numba.vectorize(["boolean(f8, f8, f8, f8, f8, f8, f8, f8)"])(function)


@_ufunc
def _meet(x, y, yaw_a, length_a, width_a, yaw_b, length_b, width_b):
    """Whether rectangle a at the origin and b at (x, y) meet: no axis of either separates them."""
    if x * x + y * y > (length_a + width_a + length_b + width_b) ** 2 / 4:
        return False
    cos, sin = abs(math.cos(yaw_b - yaw_a)), abs(math.sin(yaw_b - yaw_a))
    c, s = math.cos(yaw_a), math.sin(yaw_a)
    apart = abs(x * c + y * s) > (length_a + cos * length_b + sin * width_b) / 2
    apart |= abs(y * c - x * s) > (width_a + cos * width_b + sin * length_b) / 2
    c, s = math.cos(yaw_b), math.sin(yaw_b)
    apart |= abs(x * c + y * s) > (length_b + cos * length_a + sin * width_a) / 2
    apart |= abs(y * c - x * s) > (width_b + cos * width_a + sin * length_a) / 2
    return not apart


def overlaps(
    center_a: ArrayLike, yaw_a: ArrayLike, size_a: ArrayLike, center_b: ArrayLike, yaw_b: ArrayLike, size_b: ArrayLike
) -> NDArray[np.bool_]:
    """Whether rectangles meet, by the separating axis theorem. Everything broadcasts: ``center`` (..., 2 or 3), ``yaw``
    (...), ``size`` (..., 2) as full length and width, in metres and radians."""
    a, b, size_a, size_b = (np.asarray(part, float) for part in (center_a, center_b, size_a, size_b))
    x, y = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return _meet(x, y, yaw_a, size_a[..., 0], size_a[..., 1], yaw_b, size_b[..., 0], size_b[..., 1])


class Occupancy:
    """The ground that bodies take over a set of times, to find room for one more."""

    def __init__(self, steps: int) -> None:
        self.center, self.yaw, self.size = np.zeros((0, steps, 2)), np.zeros((0, steps)), np.zeros((0, 2))

    def free(self, center: ArrayLike, yaw: ArrayLike, size: ArrayLike, margin: float = 0.0) -> bool:
        """Whether a body at ``center`` (T, 2) or (2,), ``yaw`` (T,) or scalar, ``size`` (2,) length and width grown by
        ``margin`` metres on every side touches nothing at any time."""
        grown = np.asarray(size, float) + 2 * margin
        return not overlaps(center, yaw, grown, self.center, self.yaw, self.size[:, None]).any()

    def add(self, center: ArrayLike, yaw: ArrayLike, size: ArrayLike) -> int:
        """Take the ground; arguments as in :meth:`free`. Returns the body's index."""
        steps = self.center.shape[1]
        self.center = np.concatenate([self.center, np.broadcast_to(np.asarray(center, float), (1, steps, 2))])
        self.yaw = np.concatenate([self.yaw, np.broadcast_to(np.asarray(yaw, float), (1, steps))])
        self.size = np.concatenate([self.size, np.asarray(size, float)[None]])
        return len(self.size) - 1

    def drop_first(self) -> None:
        """Give back the ground of the body that was added first."""
        self.center, self.yaw, self.size = self.center[1:], self.yaw[1:], self.size[1:]
