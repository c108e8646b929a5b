"""Checks of settings: each raises ValueError with one line that says what is wrong and what would be right."""

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence


def check_names(what: str, names: Iterable[str], known: Sequence[str]) -> None:
    """Every name must be one of those ``known``; ``what`` says what they name."""
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1, 0.0)[0]
            raise ValueError(f"unknown {what} '{name}'; did you mean '{near}'? There are {', '.join(known)}")


def check_not_negative(**values: float) -> None:
    """Every value must be a finite number of 0 or more."""
    for name, value in values.items():
        if not 0 <= value < math.inf:
            raise ValueError(f"{name}={value} must be a finite number, 0 or more")


def check_probabilities(**values: float) -> None:
    """Every value must lie within 0 and 1."""
    for name, value in values.items():
        if not 0 <= value <= 1:
            raise ValueError(f"{name}={value} is a probability: between 0 and 1")


def check_ranges(**values: Sequence[float]) -> None:
    """Every value must be [lowest, highest], of finite numbers of 0 or more."""
    for name, value in values.items():
        if len(value) != 2 or not 0 <= value[0] <= value[1] < math.inf:
            raise ValueError(f"{name}={list(value)} must be [lowest, highest] with 0 <= lowest <= highest")


def check_weights(name: str, weights: Mapping[str, float]) -> None:
    """Relative weights must not be negative, nor all 0."""
    check_not_negative(**{f"{name}.{key}": weight for key, weight in weights.items()})
    if not any(weights.values()):
        raise ValueError(f"{name}: none of the weights is above 0")
