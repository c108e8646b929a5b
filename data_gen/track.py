"""Where a body is at any time: a recorded path with proper interpolation."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_gen.jit import jit

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

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Position (..., 3), yaw (...) and velocity (..., 3) at times ``t`` (...) in seconds."""
        t = np.asarray(t, float)
        inner = np.clip(t, self.times[0], self.times[-1])
        coast = (t - inner)[..., None]
        if len(self.times) == 1:
            shape = t.shape
            velocity = np.broadcast_to(self.velocity[0], (*shape, 3))
            return self.position[0] + coast * velocity, np.broadcast_to(self.yaw[0], shape), velocity
        i = np.clip(np.searchsorted(self.times, inner, side="right") - 1, 0, len(self.times) - 2)
        position, yaw, velocity = _interpolate(self, i, i + 1, inner)
        return position + coast * velocity, yaw, velocity

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
        self._first = np.cumsum(counts) - counts
        self._last = self._first + counts - 1
        names = [field.name for field in fields(Track)]
        self._records = Track(*(np.concatenate([getattr(track, name) for track in tracks]) for name in names))
        # The tracks end to end on one axis of time, a second apart: one binary search then serves them all.
        times = self._records.times
        self._shift = np.arange(len(tracks)) * (np.ptp(times) + 1.0)
        self._axis = times + np.repeat(self._shift, counts)

    def at(self, t: ArrayLike, which: ArrayLike) -> tuple[Array, Array, Array]:
        """:meth:`Track.at` of the tracks ``which`` at times ``t``, of shapes that broadcast together."""
        t, which = np.broadcast_arrays(np.asarray(t, float), which)
        first, last = self._first[which], self._last[which]
        inner = np.clip(t, self._records.times[first], self._records.times[last])
        i = np.searchsorted(self._axis, inner + self._shift[which], side="right") - 1
        i = np.clip(i, first, np.maximum(last - 1, first))
        position, yaw, velocity = _interpolate(self._records, i, np.minimum(i + 1, last), inner)
        return position + (t - inner)[..., None] * velocity, yaw, velocity


def _interpolate(records: Track, i: NDArray, j: NDArray, t: Array) -> tuple[Array, Array, Array]:
    """Position, yaw and velocity at times ``t`` between records ``i`` and ``j`` (the same record: a body at rest)."""
    table = (np.ascontiguousarray(getattr(records, field.name), float) for field in fields(Track))
    position, yaw, velocity = _hermite(*table, i.ravel(), j.ravel(), t.ravel())
    return position.reshape(*t.shape, 3), yaw.reshape(t.shape), velocity.reshape(*t.shape, 3)


@jit
def _hermite(times, position, yaw, velocity, i, j, t):
    found = np.empty((len(t), 3)), np.empty(len(t)), np.empty((len(t), 3))
    for n in range(len(t)):
        a, b = i[n], j[n]
        step = times[b] - times[a] if b != a else 1.0
        s = (t[n] - times[a]) / step
        for k in range(3):
            m0, m1 = velocity[a, k] * step, velocity[b, k] * step
            gap = position[b, k] - position[a, k]
            bend, twist = 3 * gap - 2 * m0 - m1, m0 + m1 - 2 * gap
            found[0][n, k] = position[a, k] + s * (m0 + s * (bend + s * twist))
            found[2][n, k] = (m0 + s * (2 * bend + 3 * s * twist)) / step
        found[1][n] = yaw[a] + s * (yaw[b] - yaw[a])
    return found
