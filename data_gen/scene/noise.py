"""Lattice noise and analytic box filters for procedural textures, as scalar functions that numba inlines.

Those that take a seed have their types declared: numba would compile them once for every seed that is written in the code.
"""

import numpy as np

from data_gen.jobs.jit import jit, jit_as

GOLDEN = 0.618034
"""Golden ratio: the fractional parts of its multiples are spread evenly, and no two that follow each other are alike."""


@jit_as("float64(int64, int64, int64)")
def lattice(i, j, k):
    """A number in [0, 1) for an integer cell (i, j, k): the same everywhere and always."""
    h = (i * 374761393 + j * 668265263 + k * 1440662683) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0xFFFFFFFF
    h = ((h ^ (h >> 15)) * 2246822519) & 0xFFFFFFFF
    return (h ^ (h >> 16)) * (1.0 / 4294967296.0)


@jit_as("float64(float64, float64, int64)")
def noise2(x, y, seed):
    """Value noise in [-1, 1] with one feature a unit of length; bilinear in smoothed coordinates."""
    i, j = int(np.floor(x)), int(np.floor(y))
    u, v = x - i, y - j
    u, v = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
    low = lattice(i, j, seed) * (1 - u) + lattice(i + 1, j, seed) * u
    high = lattice(i, j + 1, seed) * (1 - u) + lattice(i + 1, j + 1, seed) * u
    return 2 * (low * (1 - v) + high * v) - 1


@jit_as("float64(float64, float64, float64, int64)")
def noise3(x, y, z, seed):
    """Value noise in [-1, 1] in space."""
    k = int(np.floor(z))
    w = z - k
    w = w * w * (3 - 2 * w)
    return noise2(x, y, seed + 131 * k) * (1 - w) + noise2(x, y, seed + 131 * (k + 1)) * w


@jit_as("float64(float64, float64, float64, float64, int64)")
def octave2(x, y, size, footprint, seed):
    """Noise with features of ``size`` metres that fades out as the pixel's footprint (m) grows past them."""
    keep = 1.5 - 2.0 * footprint / size
    if keep <= 0:
        return 0.0
    return noise2(x / size, y / size, seed) * min(keep, 1.0)


@jit_as("float64(float64, float64, float64, float64, float64, int64)")
def octave3(x, y, z, size, footprint, seed):
    """:func:`octave2` in space."""
    keep = 1.5 - 2.0 * footprint / size
    if keep <= 0:
        return 0.0
    return noise3(x / size, y / size, z / size, seed) * min(keep, 1.0)


@jit
def band(x, period, start, width, footprint):
    """Fraction of [x - footprint / 2, x + footprint / 2] inside the bands [start, start + width) of every period: the exact
    box filter of a stripe pattern."""
    footprint = max(footprint, 1e-3)
    a, b = (x - start - footprint / 2) / period, (x - start + footprint / 2) / period
    duty = width / period
    low = np.floor(a) * duty + min(a - np.floor(a), duty)
    high = np.floor(b) * duty + min(b - np.floor(b), duty)
    return (high - low) * period / footprint


@jit
def ramp(low, high, x):
    """Smooth step from 0 at ``low`` to 1 at ``high``."""
    s = min(max((x - low) / (high - low), 0.0), 1.0)
    return s * s * (3 - 2 * s)


@jit
def mix(out, fraction, r, g, b):
    """Blend a ``fraction`` of the colour (r, g, b) into ``out``, in place."""
    out[0] += fraction * (r - out[0])
    out[1] += fraction * (g - out[1])
    out[2] += fraction * (b - out[2])
