"""What a radar says of its own detections: whether it could unfold their Doppler, how plausible it takes them to be. It errs.

Codes are those of the ARS408, which nuScenes' files have.
"""

import numpy as np
from numpy.typing import NDArray

from data_gen.sensors.radar.detection import DOUBLE_BOUNCE, SINGLE_BOUNCE, THRESHOLD, Array, complex_normal

AMBIGUOUS, UNAMBIGUOUS, MAYBE_STATIONARY = 1, 3, 4
"""ambig_state: several folds of the Doppler are plausible; one is; several, and one of them is at rest."""
VALID, LOW_RCS, MIRROR = 0x00, 0x04, 0x06
"""invalid_state: valid; valid with a low cross-section; probably a mirror image."""
RAMP = 18.5
"""Doppler in m/s that a ramp of 52 us alone tells without folding. Ramps of two lengths take turns; detected in both, a
target's Doppler is known up to the radar's limit."""
PLAUSIBLE = 45.0
"""Speed over ground in m/s that a car does not expect anybody to exceed."""
LOW_DBSM = -8.0
"""dBsm below which a detection is called one of low cross-section."""
MIRROR_FOUND, MIRROR_MISTAKEN = 0.5, 0.02
"""Probability that a mirror image, and that anything else, is taken for one (assumed)."""
SURE_DB = 15.0
"""SNR from which a detection is hardly ever noise."""


def detected_in_both_ramps(snr: Array, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Whether a target detected with power ratio ``snr`` (P,) in one ramp is detected in the other as well, in whose noise
    it is no other: it fails half of the time at the threshold and once in 70 times 3 dB above."""
    return np.abs(np.sqrt(snr) + complex_normal(rng, len(snr))) ** 2 > THRESHOLD


def ambig_state(ground: Array, limit: Array, at_rest: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Code (P,) of a radial speed over ``ground`` in m/s that is known but for multiples of twice ``limit``."""
    states = [2 * limit - np.abs(ground) > PLAUSIBLE, at_rest]
    return np.select(states, [UNAMBIGUOUS, MAYBE_STATIONARY], AMBIGUOUS).astype(np.uint8)


def invalid_state(rcs: Array, cause: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Code (P,) by the cross-section in dBsm, and by a guess at which detections are mirror images."""
    is_mirror = np.isin(cause, (SINGLE_BOUNCE, DOUBLE_BOUNCE))
    guess = rng.random(len(cause)) < np.where(is_mirror, MIRROR_FOUND, MIRROR_MISTAKEN)
    return np.select([guess, rcs < LOW_DBSM], [MIRROR, LOW_RCS], VALID).astype(np.uint8)


def pdh0(snr_db: Array, both: NDArray[np.bool_], invalid: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Code (P,) of the probability that a detection is nothing: 1 is below 25 %, 2 below 50, 3 below 75, 4 below 90."""
    return np.where(invalid == MIRROR, 4, 1 + (snr_db < SURE_DB) + ~both).astype(np.uint8)
