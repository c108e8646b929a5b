"""A Kalman filter of constant velocity on the ground, for all tracks of a scene at once.

Formulas: Bar-Shalom, Li and Kirubarajan 2001, "Estimation with applications to tracking and navigation", sections 5.2
(filter) and 6.2.2 (velocity disturbed by white noise). The state is (x, y, vx, vy): metres and m/s, GLOBAL frame.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PLACE, VELOCITY = slice(0, 2), slice(2, 4)
"""Halves of the state that are measured."""


@dataclass(frozen=True)
class Motion:
    """What is known of the places and velocities of N tracks."""

    mean: Array  # (N, 4)
    cov: Array  # (N, 4, 4)

    def __getitem__(self, index) -> "Motion":
        """The tracks at an index array, mask or slice."""
        return Motion(self.mean[index], self.cov[index])

    @staticmethod
    def begin(place: Array, place_cov: Array, velocity: Array, velocity_cov: Array, *, speed: Array) -> "Motion":
        """Motion from a first measurement (N, 2), (N, 2, 2). An unknown velocity (NaN) is 0 with the standard deviation
        ``speed`` (N,) in m/s."""
        known = np.isfinite(velocity[:, :1] + velocity[:, 1:])
        cov = np.zeros((len(place), 4, 4))
        cov[:, PLACE, PLACE] = place_cov
        unknown_cov = speed[:, None, None] ** 2 * np.eye(2)
        cov[:, VELOCITY, VELOCITY] = np.where(known[..., None], velocity_cov, unknown_cov)
        return Motion(np.concatenate([place, np.where(known, velocity, 0.0)], axis=1), cov)

    def predict(self, seconds: float, density: Array) -> "Motion":
        """So many seconds later. ``density`` (N,): power spectral density of the accelerations, m^2/s^3; after t seconds
        they have changed the velocity by sqrt(density t)."""
        F = np.eye(4)
        F[0, 2] = F[1, 3] = seconds
        place, cross, velocity = seconds**3 / 3, seconds**2 / 2, seconds
        Q = np.kron([[place, cross], [cross, velocity]], np.eye(2))
        return Motion(self.mean @ F.T, F @ self.cov @ F.T + density[:, None, None] * Q)

    def update(self, measured: Array, noise: Array, half: slice) -> "Motion":
        """After a half of the state was measured: ``measured`` (N, 2) with covariance ``noise`` (N, 2, 2). Rows with NaN
        were not. The covariance is updated in Joseph's form, which keeps it symmetric and positive."""
        known = np.isfinite(measured).all(axis=1)
        mean, cov = self.mean.copy(), self.cov.copy()
        P, R = cov[known], noise[known]
        H = np.eye(4)[half]
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        innovation = measured[known] - mean[known, half]
        rest = np.eye(4) - gain @ H
        mean[known] += (gain @ innovation[..., None])[..., 0]
        cov[known] = rest @ P @ rest.swapaxes(1, 2) + gain @ R @ gain.swapaxes(1, 2)
        return Motion(mean, cov)

    @staticmethod
    def join(parts: "list[Motion]") -> "Motion":
        """All of several lists, one after the other."""
        return Motion(np.concatenate([part.mean for part in parts]), np.concatenate([part.cov for part in parts]))
