"""Rain and fog in a LiDAR's beam: the strongest of all echoes from the air, sampled at once and without a loop over drops.

Let M(p, r) be the expected number of echoes from nearer than r that are stronger than p. They are independent, so the
strongest is weaker than p with the probability exp(-M(p, r)): it is M^-1 of an exponential variate.
M is tabulated once per weather.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.conditions import KOSCHMIEDER
from data_gen.scene.raindrops import N0, size_slope
from data_gen.sensors.lidar.power import LEAST_BRIGHTNESS, WATER_INDEX

Array = NDArray[np.float64]

NEAREST = 1.5
"""Metres of the nearest echo of a drop (LISA)."""
DROP = ((WATER_INDEX - 1) / (WATER_INDEX + 1)) ** 2
"""Reflectivity of a drop that fills the beam."""
PULSE = 0.75
"""Metres of air that return light at a time: c / 2 x 5 ns."""
OVERLAP = 7.5
"""Metres from which the receiver sees the whole beam; nearer it sees a fraction that grows with the square."""
BACKSCATTER = 0.046 / KOSCHMIEDER
"""Backscatter over extinction of fog in 1/sr: beta = 0.046 / MOR (Rasshofer 2011, Hahner 2021)."""

RANGES = np.linspace(1.0, 51.0, 201)
"""Metres at which M is tabulated; nothing in the air is detected from farther away."""
LEVELS = 0.25 * 1.06 ** np.arange(100)
"""Powers in units of the least detectable at which M is tabulated."""


def drop_echoes(power: ArrayLike, distance: ArrayLike, rain_rate: float, divergence: float) -> Array:
    """Drops per metre of beam at ``distance`` that return more than ``power``: reflectivity / m^2, both broadcast.
    ``divergence`` is the full width of the beam in rad.

    Drops of diameter D number N(D) as ``raindrops`` says, and return
    DROP (D / beam width)^2 / r^2.
    """
    slope = size_slope(rain_rate)
    least = 1e3 * divergence * np.square(distance) * np.sqrt(np.asarray(power) / DROP)  # mm
    section = np.pi / 4 * np.square(divergence * np.asarray(distance))
    return section * N0 / slope * np.exp(-slope * least) * (np.asarray(distance) > NEAREST)


def fog_power(distance: ArrayLike, mist: float, extinction: float) -> Array:
    """Mean power from a pulse's length of mist at ``distance``, as reflectivity / m^2: pi beta PULSE overlap e^(-2 a r) / r^2.

    The fog's soft return of Hahner et al. (2021) for a pulse that is short against its range. ``mist`` is the extinction of
    what floats and ``extinction`` that of all, in 1/m.
    """
    overlap = np.minimum(np.asarray(distance) / OVERLAP, 1.0) ** 2
    decay = np.exp(-2 * extinction * np.asarray(distance))
    return np.pi * BACKSCATTER * mist * PULSE * overlap * decay / np.square(distance)


@lru_cache(maxsize=8)
def echo_table(rain_rate: float, mist: float, extinction: float, max_range: float, divergence: float) -> Array:
    """M at ``LEVELS`` and ``RANGES`` (K, R). The power of one parcel of fog is exponentially distributed (speckle)."""
    power, middle = LEVELS[:, None] * LEAST_BRIGHTNESS / max_range**2, (RANGES[1:] + RANGES[:-1]) / 2
    density = np.zeros((len(power), len(middle)))
    if rain_rate > 0:
        density += drop_echoes(power * np.exp(2 * extinction * middle), middle, rain_rate, divergence)
    if mist > 0:
        density += np.exp(-power / fog_power(middle, mist, extinction)) / PULSE
    return np.concatenate([np.zeros((len(power), 1)), np.cumsum(density * np.diff(RANGES), axis=1)], axis=1)


def sample_echoes(table: Array, reach: Array, rng: np.random.Generator) -> tuple[NDArray[np.int64], Array, Array]:
    """The strongest echo from the air before ``reach`` (N,) metres: ray (E,), distance (E,) in metres and power (E,) in units
    of the least detectable, of those rays that have one of more than a quarter of that."""
    snr, distance = _sample(table, reach, rng.exponential(size=len(reach)), rng.random(len(reach)))
    ray = np.flatnonzero(snr)
    return ray, distance[ray], snr[ray]


@jit
def _sample(table, reach, tail, quantile):
    snr, distance = np.zeros(len(reach)), np.zeros(len(reach))
    last = len(RANGES) - 1
    for i in range(len(reach)):
        at = min((reach[i] - RANGES[0]) / (RANGES[1] - RANGES[0]), last - 1e-6)
        if at <= 0 or _between(table[0], at) <= tail[i]:
            continue
        low, high = 0, len(LEVELS) - 1  # M falls with the level
        while high - low > 1:
            middle = (low + high) // 2
            if _between(table[middle], at) > tail[i]:
                low = middle
            else:
                high = middle
        a, b = _between(table[low], at), _between(table[high], at)
        part = min((a - tail[i]) / max(a - b, 1e-12), 1.0)
        snr[i] = LEVELS[low] * (LEVELS[high] / LEVELS[low]) ** part
        # Where: as the echoes of this power are distributed.
        wanted, near, far = quantile[i] * (a - b), 0, int(at) + 1
        while far - near > 1:
            middle = (near + far) // 2
            if table[low, middle] - table[high, middle] <= wanted:
                near = middle
            else:
                far = middle
        below, above = table[low, near] - table[high, near], table[low, far] - table[high, far]
        within = (wanted - below) / max(above - below, 1e-12)
        distance[i] = RANGES[near] + min(within, 1.0) * (RANGES[far] - RANGES[near])
    return snr, distance


@jit
def _between(row, at):
    """Value of a table's row at a fractional index."""
    i = int(at)
    return row[i] + (at - i) * (row[i + 1] - row[i])
