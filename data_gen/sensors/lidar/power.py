"""The power that comes back to a LiDAR, in units of the least that it detects, and what follows from it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_gen.jobs.jit import jit

Array = NDArray[np.float64]

LEAST_BRIGHTNESS = 0.9
"""Reflectivity of the target that is detected half of the time when hit squarely at the greatest range in clear air (LISA)."""
WATER_INDEX = 1.328
"""Refractive index of water at 905 nm."""


class Returns(NamedTuple):
    """The strongest echo of each of E rays, before detection."""

    ray: NDArray[np.int64]  # (E,) ascending
    distance: Array  # (E,) metres
    snr: Array  # (E,) received over least detectable power
    byte: Array  # (E,) calibrated reflectivity, not rounded
    body: NDArray[np.int32]  # (E,) actor index, WORLD or NOTHING

    def of(self, chosen: NDArray) -> "Returns":
        """Those that a mask (E,) or indices choose."""
        return Returns(*(np.asarray(field)[chosen] for field in self))

    def dimmed(self, transmission: Array) -> "Returns":
        """The same behind something that transmits a fraction (E,) of the power."""
        return self._replace(snr=self.snr * transmission, byte=self.byte * transmission)


def strongest(count: int, *parts: Returns) -> Returns:
    """Of several echoes of ``count`` rays the strongest of each ray: a LiDAR reports one."""
    every = Returns(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    return every.of(_winners(count, every.ray, every.snr))


@jit
def _winners(count, ray, snr):
    """Indices of the strongest echo of each ray that has any, in the order of the rays."""
    best = np.full(count, -1, np.int64)
    for k in range(len(ray)):
        i = ray[k]
        if best[i] < 0 or snr[k] > snr[best[i]]:
            best[i] = k
    return best[best >= 0]


def signal_to_noise(brightness: Array, distance: Array, max_range: float) -> Array:
    """Received over least detectable power, P / P_min, with P = brightness / r^2 and P_min = 0.9 / max_range^2 (LISA).

    ``brightness`` is reflectivity x cos(incidence) x two-way transmission of a target that fills the beam.
    """
    return brightness * (max_range / distance) ** 2 / LEAST_BRIGHTNESS


def calibrated_reflectivity(snr: Array, distance: Array, *, max_range: float) -> Array:
    """Of a target that fills the beam, in per cent: what a LiDAR takes a return to come from, the inverse of
    :func:`signal_to_noise`."""
    return 100 * LEAST_BRIGHTNESS * snr * (distance / max_range) ** 2


def detection_probability(snr: ArrayLike) -> Array:
    """1 / (1 + exp(-1.5 SNR_dB)): one half at P_min, 18 % at 1 dB less; 1 % of all returns are lost whatever their power."""
    return 0.99 / (1 + np.maximum(snr, 1e-9) ** (-15 / np.log(10)))


def range_sigma(snr: ArrayLike, *, noise: float) -> Array:
    """Standard deviation of range in metres: 0.09 / sqrt(2 SNR) (LISA) over that of a strong return, ``noise``."""
    return 0.09 / np.sqrt(2 * np.asarray(snr)) + noise


def rough_cosine(cosine: Array) -> Array:
    """What replaces cos(incidence) on the ground: A cos + B sin^2, the law of Oren and Nayar for light that goes
    back where it came from, with facets of 0.5 rad (variance 0.25). Smooth asphalt would be lost from 14 m on."""
    a, b = 1 - 0.5 * 0.25 / (0.25 + 0.33), 0.45 * 0.25 / (0.25 + 0.09)
    return a * cosine + b * (1 - cosine**2)


def film_loss(cosine: Array, covered: float) -> Array:
    """Fraction (N,) of the diffuse reflection that is left of a ground of which water covers the fraction ``covered``, at
    cos(incidence) (N,).

    (1 - f) + f T^2 with f = ``covered`` and T the unpolarised Fresnel transmission into water, passed twice: at a grazing
    angle the light is mirrored away (LiDAR_snow_sim).
    """
    inside = np.sqrt(1 - (1 - cosine**2) / WATER_INDEX**2)  # cosine of the refracted ray
    s = (cosine - WATER_INDEX * inside) / (cosine + WATER_INDEX * inside)
    p = (WATER_INDEX * cosine - inside) / (WATER_INDEX * cosine + inside)
    return 1 - covered + covered * (1 - (s**2 + p**2) / 2) ** 2
