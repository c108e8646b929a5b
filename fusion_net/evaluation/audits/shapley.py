"""What each sensor is worth: the exact Shapley value (Shapley 1953) of a score over the subsets of sensors.

A sensor's value is its gain averaged over all orders in which the sensors could be switched on:
phi_i = sum over S without i of |S|! (M - |S| - 1)! / M! (v(S + i) - v(S)). The values sum to v(all); nothing is worth 0.
"""

from collections.abc import Mapping
from itertools import combinations
from math import factorial

import numpy as np
from numpy.typing import ArrayLike, NDArray


def shapley(values: Mapping[tuple[str, ...], ArrayLike]) -> dict[str, NDArray[np.float64]]:
    """Shapley value of each sensor, of the shape of one value. ``values``: of every subset but the empty one, which is worth
    0, in any order of its sensors; arrays are taken element by element (resamples, boxes). ValueError for a subset that is not
    there."""
    by_set = {frozenset(names): np.asarray(value, float) for names, value in values.items()}
    names = sorted({name for subset in values for name in subset})
    by_set[frozenset()] = np.zeros_like(next(iter(by_set.values())))
    found = {}
    for name in names:
        others = [other for other in names if other != name]
        total = np.zeros_like(by_set[frozenset()])
        for size in range(len(names)):
            share = factorial(size) * factorial(len(names) - size - 1) / factorial(len(names))
            for chosen in combinations(others, size):
                for subset in ({*chosen}, {*chosen, name}):
                    if frozenset(subset) not in by_set:
                        raise ValueError(f"shapley: no value of {', '.join(sorted(subset))}")
                total = total + share * (by_set[frozenset({*chosen, name})] - by_set[frozenset(chosen)])
        found[name] = total
    return found
