"""How large the drops of rain are, the same for every sensor: Marshall and Palmer (1948), N(D) = N0 exp(-slope D)."""

N0 = 8_000.0
"""Drops a cubic metre and millimetre of diameter."""


def size_slope(rain_rate: float) -> float:
    """The slope in 1/mm at a rain rate in mm/h."""
    return 4.1 * rain_rate**-0.21
