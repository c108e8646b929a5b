"""Where a body is at any time: a recorded path with proper interpolation."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_gen.jobs.jit import jit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Track:
    """Poses over time in the global frame (x forward, y left, z up), at the body's ground centre.

    Between records, position is the cubic Hermite spline of position and velocity and yaw is linear on the unwrapped
    angle, so speed is continuous and a constant speed is exact. Outside the recorded span the body coasts at the
    velocity of its end. One record is a body at rest or, with a velocity, in straight motion.
    """

    times: Array  # (T,) seconds, strictly increasing
    position: Array  # (T, 3) metres
    yaw: Array  # (T,) radians, unwrapped
    velocity: Array  # (T, 3) m/s: the derivative of position, slip included

    @staticmethod
    def static(position: ArrayLike, yaw: float) -> "Track":
        """A body at rest at ``position`` (3,)."""
        return Track(np.zeros(1), np.asarray(position, float)[None], np.array([float(yaw)]), np.zeros((1, 3)))

    def __post_init__(self) -> None:
        for field in fields(self):  # one layout in memory: the kernel compiles once
            object.__setattr__(self, field.name, np.ascontiguousarray(getattr(self, field.name), float))

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Position (..., 3), yaw (...) and velocity (..., 3) at times ``t`` (...) in seconds."""
        t = np.asarray(t, float)
        first, last = np.zeros(1, np.int64), np.full(1, len(self.times) - 1)
        return _at(self, first, last, t, np.zeros(t.shape, np.int64))

    def pose(self, t: float) -> Array:
        """``global_T_body`` (4, 4) at one time."""
        position, yaw, _ = self.at(t)
        c, s = np.cos(yaw), np.sin(yaw)
        return np.array([[c, -s, 0, position[0]], [s, c, 0, position[1]], [0, 0, 1, position[2]], [0, 0, 0, 1]])

    def shifted(self, offset: ArrayLike) -> "Track":
        """The same motion with ``offset`` (3,) added to every position."""
        return Track(self.times, self.position + np.asarray(offset, float), self.yaw, self.velocity)


class TrackBundle:
    """Many tracks in one table, so that one call gives the poses of all of them."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        counts = np.array([len(track.times) for track in tracks], np.int64)
        self._last = np.cumsum(counts) - 1
        self._first = self._last - counts + 1
        self._records = Track(*(np.concatenate([getattr(t, field.name) for t in tracks]) for field in fields(Track)))

    def at(self, t: ArrayLike, which: ArrayLike) -> tuple[Array, Array, Array]:
        """:meth:`Track.at` of the tracks ``which`` at times ``t``, of shapes that broadcast together."""
        t, which = np.broadcast_arrays(np.asarray(t, float), np.asarray(which, np.int64))
        return _at(self._records, self._first, self._last, t, which)


def _at(records: Track, first: NDArray, last: NDArray, t: Array, which: NDArray) -> tuple[Array, Array, Array]:
    flat = _sample(*vars(records).values(), first, last, t.flatten(), which.flatten())  # not views: whole, writable
    return flat[0].reshape(*t.shape, 3), flat[1].reshape(t.shape), flat[2].reshape(*t.shape, 3)


@jit
def _sample(times, position, yaw, velocity, first, last, t, which):
    """Position (N, 3), yaw (N,), velocity (N, 3) at times ``t`` (N,) of the tracks whose records are ``first`` to ``last`` of
    ``which`` (N,)."""
    found = np.empty((len(t), 3)), np.empty(len(t)), np.empty((len(t), 3))
    for n in range(len(t)):
        low, high = first[which[n]], last[which[n]]
        inner = min(max(t[n], times[low]), times[high])
        coast = t[n] - inner
        a, b = low, high
        while b - a > 1:
            middle = (a + b) // 2
            if times[middle] <= inner:
                a = middle
            else:
                b = middle
        step = times[b] - times[a] if b != a else 1.0
        s = (inner - times[a]) / step
        for k in range(3):
            m0, m1 = velocity[a, k] * step, velocity[b, k] * step
            gap = position[b, k] - position[a, k]
            bend, twist = 3 * gap - 2 * m0 - m1, m0 + m1 - 2 * gap
            speed = (m0 + s * (2 * bend + 3 * s * twist)) / step
            found[0][n, k] = position[a, k] + s * (m0 + s * (bend + s * twist)) + coast * speed
            found[2][n, k] = speed
        found[1][n] = yaw[a] + s * (yaw[b] - yaw[a])
    return found
