"""What a curve of scores over the amount of a fault says: how fast it falls, and where it breaks."""

import numpy as np
from numpy.typing import NDArray

LOST = 0.1
"""Share of the sound score whose loss is the break point."""
Array = NDArray[np.float64]


def slope(amounts: Array, scores: Array) -> Array:
    """(R,) change of the score per unit: the least-squares line through the sound score. ``amounts`` (A,) begin with 0, and
    ``scores`` (A, R) are those on each of R resamples of the scenes."""
    change = scores - scores[0]
    return amounts @ change / np.square(amounts).sum()


def break_point(amounts: Array, scores: Array, lost: float = LOST) -> Array:
    """(R,) the amount at which the curve, straight between its points, first falls below (1 - ``lost``) of the sound score;
    infinite where it never does. Arguments as in :func:`slope`, ``amounts`` rising."""
    limit = (1 - lost) * scores[0]
    found = np.full(scores.shape[1], np.inf)
    for a in range(len(amounts) - 1, 0, -1):
        above, below = scores[a - 1] >= limit, scores[a] < limit
        fall = np.where(scores[a - 1] > scores[a], scores[a - 1] - scores[a], 1.0)
        share = (scores[a - 1] - limit) / fall
        crosses = above & below
        found = np.where(crosses, amounts[a - 1] + share * (amounts[a] - amounts[a - 1]), found)
    return found
