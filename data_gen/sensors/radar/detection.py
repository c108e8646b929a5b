"""The receiver of a 77 GHz radar: from echoes to detections by link budget, fluctuation, resolution cells and threshold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_gen.jobs.jit import jit
from data_gen.rig.mounts import Radar
from fusion_net.common.geometry import wrap_angle

Array = NDArray[np.float64]

FALSE_ALARM = 1e-6
"""Probability that noise alone crosses the threshold in a cell."""
THRESHOLD = -np.log(FALSE_ALARM)
"""Least detectable power over the noise: the power of noise is exponential with mean 1."""
SNR_REF_DB, RCS_REF_DB = 21.1, 10.0
"""A 10 dBsm Swerling-1 target at max_range on the boresight is detected with probability 0.9: SNR = ln Pfa / ln Pd - 1."""
NEAR = 0.5
"""Fraction of max_range within which the power rises no more: the high-pass before the converter takes 40 dB a decade there,
or the road and the bumper would flood it. The least cross-section that is detected is so the same all over the near range."""
EDGE_DB = 6.0
"""Two-way loss of the antenna at the edge of its field of view."""
SEPARABLE = 1.5
"""Resolution cells that two echoes must be apart, in range, azimuth or Doppler, to be two detections (ARS408: 1.5 to 2)."""
NOISE_FLOOR = np.array([0.05, 0.30, 0.05])
"""Least standard deviation of range, azimuth and Doppler as a fraction of the resolution cell, however strong the echo."""
WET_RADOME_DB = 1.09
"""Two-way loss in the film of water on the radome at 1 mm/h. A laminar film thickens with the cube root of the rain rate
(Gibble): 1.9 dB at 5, 4 dB at 50 mm/h."""
DIRECT, UNDERBODY, SINGLE_BOUNCE, DOUBLE_BOUNCE, CLUTTER, RAIN, SPRAY = range(7)
"""What causes an echo: a body in sight; one reached below a vehicle; a body's mirror image by a path that bounces once or
twice; nothing; drops; spray."""


@dataclass(frozen=True)
class Echoes:
    """What comes back: E reflections before the receiver, or detections after it."""

    range: Array  # (E,) metres
    azimuth: Array  # (E,) radians counter-clockwise from the boresight
    doppler: Array  # (E,) d(range)/dt in m/s
    snr: Array  # (E,) power over noise, linear: the mean of a reflection, the measured one of a detection
    body: NDArray[np.int32]  # (E,)
    cause: NDArray[np.uint8]  # (E,) DIRECT .. SPRAY

    def __getitem__(self, index) -> "Echoes":
        """The echoes at an index array or mask."""
        return Echoes(*(column[index] for column in vars(self).values()))

    def strongest(self, count: int) -> "Echoes":
        """The ``count`` with the most power, in the order they are in."""
        if len(self.snr) <= count:
            return self
        return self[np.sort(np.argsort(-self.snr, kind="stable")[:count])]

    @staticmethod
    def concatenate(parts: Sequence["Echoes"]) -> "Echoes":
        """All of them, in order."""
        return Echoes(*(np.concatenate(columns) for columns in zip(*(vars(p).values() for p in parts), strict=True)))


def link_budget_db(distance: ArrayLike, azimuth: ArrayLike, radar: Radar, rain_rate: float = 0.0) -> Array:
    """Mean SNR in dB of a 0 dBsm reflector at ``distance`` m and ``azimuth`` rad: R^-4 from :data:`NEAR` on, antenna
    pattern, rain in the air and on the radome."""
    distance = np.asarray(distance, float)
    rain_db_per_km = 0.94 * rain_rate**0.776  # ITU-R P.838 at 77 GHz
    pattern = EDGE_DB * (np.degrees(azimuth) / radar.fov_deg) ** 2
    spreading = 40 * np.log10(np.maximum(distance / radar.max_range, NEAR))
    wet = 2 * rain_db_per_km * distance / 1000 + WET_RADOME_DB * rain_rate ** (1 / 3)
    return SNR_REF_DB - RCS_REF_DB - spreading - pattern - wet


def detect(echoes: Echoes, radar: Radar, rng: np.random.Generator) -> Echoes:
    """The detections that a radar makes of reflections, measured with noise.

    Each reflection fluctuates as a complex Gaussian (Swerling 1). Those in one resolution cell add as phasors and with the
    receiver's noise; the cell is detected above the threshold at their power-weighted centroid.
    """
    if not len(echoes.range):
        return echoes
    amplitude = np.sqrt(echoes.snr) * complex_normal(rng, len(echoes.range))
    order = np.argsort(-np.abs(amplitude), kind="stable")
    echoes, amplitude = echoes[order], amplitude[order]
    peak, cell = _resolution_cells(echoes, radar)

    def total(weight: Array) -> Array:
        return np.bincount(cell, weight, len(peak)).astype(float, copy=False)

    noise = complex_normal(rng, len(peak))
    power = np.abs(total(amplitude.real) + 1j * total(amplitude.imag) + noise) ** 2
    weight = np.abs(amplitude) ** 2
    weight /= total(weight)[cell]
    found = np.flatnonzero(power > THRESHOLD)
    # Folded about each peak first, so that a centroid does not straddle the Doppler limit.
    offset = wrap_angle(echoes.doppler - echoes.doppler[peak][cell], 2 * radar.max_doppler)
    center = (
        total(weight * echoes.range)[found],
        np.arcsin(np.clip(total(weight * np.sin(echoes.azimuth))[found], -1, 1)),
        (echoes.doppler[peak] + total(weight * offset))[found],
    )
    snr = power[found] - 1
    return _measure(Echoes(*center, snr, echoes.body[peak[found]], echoes.cause[peak[found]]), radar, rng)


def _resolution_cells(echoes: Echoes, radar: Radar) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of the peaks (C,) and the cell (E,) of each echo; the echoes come strongest first.

    An echo that is not ``SEPARABLE`` in range, azimuth or Doppler from a stronger one climbs to it, and on to the peak. The
    array resolves evenly in sin(azimuth), so that its cells widen towards the sides.
    """
    doppler = wrap_angle(echoes.doppler, 2 * radar.max_doppler)
    position = np.stack([echoes.range, np.sin(echoes.azimuth), doppler], axis=1) / (SEPARABLE * _resolution(radar))
    return _climb(position)


@jit
def _climb(position):
    """Indices of the peaks and the place of each point's peak among them: a point's parent is the first before it within 1
    along every axis."""
    peaks, cell = np.empty(len(position), np.int64), np.empty(len(position), np.int64)
    count = 0
    for i in range(len(position)):
        cell[i] = -1
        for j in range(i):
            near = True
            for c in range(3):
                near &= abs(position[i, c] - position[j, c]) <= 1.0
            if near:
                cell[i] = cell[j]
                break
        if cell[i] < 0:
            peaks[count], cell[i] = i, count
            count += 1
    return peaks[:count], cell


def _measure(exact: Echoes, radar: Radar, rng: np.random.Generator) -> Echoes:
    """Detections with measurement noise: cell / sqrt(2 SNR) over a floor; in azimuth it grows with 1 / cos(azimuth)."""
    sigma = _resolution(radar) * (1 / np.sqrt(2 * exact.snr)[:, None] + NOISE_FLOOR)
    noise = (rng.normal(size=sigma.shape) * sigma).T
    return Echoes(
        range=np.maximum(exact.range + noise[0], 0.1),
        azimuth=np.arcsin(np.clip(np.sin(exact.azimuth) + noise[1], -1, 1)),
        doppler=wrap_angle(exact.doppler + noise[2], 2 * radar.max_doppler),
        snr=exact.snr,
        body=exact.body,
        cause=exact.cause,
    )


def _resolution(radar: Radar) -> Array:
    """Cell in metres, sine of azimuth and m/s."""
    return np.array([radar.range_resolution, np.radians(radar.azimuth_resolution_deg), radar.doppler_resolution])


def complex_normal(rng: np.random.Generator, count: int) -> NDArray[np.complex128]:
    """Circular Gaussian of mean power 1."""
    return (rng.normal(size=count) + 1j * rng.normal(size=count)) / np.sqrt(2)
