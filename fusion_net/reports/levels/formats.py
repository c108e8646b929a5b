"""Figures as the page writes them."""

from collections.abc import Sequence
from typing import Any


def figure(estimate: dict[str, Any] | None, digits: int = 3) -> str:
    """A value and its interval where there is one; a dash for no value."""
    if estimate is None:
        return "-"
    ends = "" if estimate["ci95"] is None else " [" + ", ".join(f"{end:.{digits}f}" for end in estimate["ci95"]) + "]"
    return f"{estimate['value']:.{digits}f}{ends}"


def difference(value: float, ends: Sequence[float], digits: int = 3) -> str:
    """With its sign."""
    return f"{value:+.{digits}f} [{ends[0]:+.{digits}f}, {ends[1]:+.{digits}f}]"


def at(estimate: dict[str, Any] | None, farthest: float) -> str:
    """A break point; None in it stands for beyond the largest amount."""
    if estimate is None:
        return "-"
    value, low, high = (
        f"> {farthest:g}" if each is None else f"{each:.2g}" for each in (estimate["value"], *estimate["ci95"])
    )
    return value if value == low == high else f"{value} [{low}, {high}]"


def percent(value: float | None, *, sign: bool = False) -> str:
    """Of a share; "-" where it is not known."""
    if value is None:
        return "-"
    return f"{100 * value:+.0f} %" if sign else f"{100 * value:.0f} %"


def share(estimate: dict[str, Any] | None) -> str:
    """A share and its interval, in per cent."""
    if estimate is None:
        return "-"
    low, high = estimate["ci95"]
    return f"{100 * estimate['value']:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"


def kilobytes(count: float) -> str:
    """Of 1000 bytes."""
    return f"{count / 1000:.3g}"
