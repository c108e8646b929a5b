"""The motion of a radar from its own returns, most of which stand still (Kellner et al., 2013)."""

import math

import numpy as np

PAIRS, AGREES = 300, 0.3
"""Pairs of returns that are tried as what stands still; and the m/s off within which another agrees: the bearing's noise."""


def ego_motion_fit(rows: np.ndarray, values: np.ndarray) -> tuple[float, float, float]:
    """The two factors of ``rows`` (N, 2) that give most of ``values`` (N,), and the standard error of the second in degrees.

    In dense traffic half of all returns move, and a fit to all of them settles between the road and a truck. So the
    factors that most agree with are chosen from those of random pairs, as Kellner does, and refined by least squares.
    """
    if len(rows) < 3:
        return 1.0, 0.0, 0.0
    pairs = np.random.default_rng(0).integers(0, len(rows), (PAIRS, 2))
    (a, b), (c, d) = rows[pairs].transpose(1, 2, 0)
    first, second = values[pairs].T
    area = np.where(np.abs(a * d - b * c) > 1e-6, a * d - b * c, np.inf)
    guesses = np.stack([first * d - second * b, a * second - c * first]) / area
    factors = guesses[:, _agree(rows @ guesses, values[:, None]).sum(axis=0).argmax()]
    normal = np.eye(2)
    for _ in range(5):
        weights = _agree(rows @ factors, values)
        normal = (rows * weights[:, None]).T @ rows
        factors = np.linalg.lstsq(normal, rows.T @ (weights * values), rcond=None)[0]
    spread = math.sqrt(float(weights @ (values - rows @ factors) ** 2 / weights.sum()))
    sigma = math.degrees(spread * math.sqrt(np.linalg.pinv(normal)[1, 1]))
    return float(factors[0]), float(factors[1]), sigma


def _agree(expected: np.ndarray, values: np.ndarray) -> np.ndarray:
    """How much values agree with what is expected, m/s: Cauchy's weights, from 0 to 1."""
    return 1 / (1 + ((values - expected) / AGREES) ** 2)
