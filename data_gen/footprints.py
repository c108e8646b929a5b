"""Rectangles on the ground over time: do two bodies touch?"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def overlaps(
    center_a: ArrayLike, yaw_a: ArrayLike, size_a: ArrayLike, center_b: ArrayLike, yaw_b: ArrayLike, size_b: ArrayLike
) -> NDArray[np.bool_]:
    """Whether rectangles meet, by the separating axis theorem. Everything broadcasts: ``center`` (..., 2), ``yaw``
    (...), ``size`` (..., 2) as full length and width, in metres and radians."""
    delta = np.asarray(center_b, float)[..., :2] - np.asarray(center_a, float)[..., :2]
    yaw_a, yaw_b = np.asarray(yaw_a, float), np.asarray(yaw_b, float)
    half_a, half_b = np.asarray(size_a, float) / 2, np.asarray(size_b, float) / 2
    cos, sin = np.abs(np.cos(yaw_b - yaw_a)), np.abs(np.sin(yaw_b - yaw_a))
    meet = np.ones(np.broadcast_shapes(delta.shape[:-1], cos.shape), bool)
    for yaw, own, other in ((yaw_a, half_a, half_b), (yaw_b, half_b, half_a)):
        along = delta[..., 0] * np.cos(yaw) + delta[..., 1] * np.sin(yaw)
        across = delta[..., 1] * np.cos(yaw) - delta[..., 0] * np.sin(yaw)
        meet &= np.abs(along) <= own[..., 0] + cos * other[..., 0] + sin * other[..., 1]
        meet &= np.abs(across) <= own[..., 1] + cos * other[..., 1] + sin * other[..., 0]
    return meet


class Occupancy:
    """The ground that bodies take over a set of times, to find room for one more."""

    def __init__(self, steps: int) -> None:
        self.center, self.yaw, self.size = np.zeros((0, steps, 2)), np.zeros((0, steps)), np.zeros((0, 2))

    def free(self, center: ArrayLike, yaw: ArrayLike, size: ArrayLike, margin: float = 0.0) -> bool:
        """Whether a body at ``center`` (T, 2) or (2,), ``yaw`` (T,) or scalar, ``size`` (2,) length and width grown by
        ``margin`` metres on every side touches nothing at any time."""
        center, size = np.asarray(center, float), np.asarray(size, float) + 2 * margin
        reach = (np.hypot(*size) + np.hypot(*self.size.T)) / 2
        near = (np.square(self.center - center).sum(axis=-1) <= np.square(reach)[:, None]).any(axis=1)
        if not near.any():
            return True
        other = self.center[near], self.yaw[near], self.size[near, None]
        return not overlaps(center, yaw, size, *other).any()

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
