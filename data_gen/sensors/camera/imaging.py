"""From light to pixels: exposure, glow of the over-range, sensor noise, tone curve."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.sensors.camera.lens import REFERENCE_WIDTH

APERTURE = 1.4
FULL_WELL = 10_000.0
"""Electrons of a saturated pixel at ISO 100."""
READ_NOISE = 4.0
"""Electrons, standard deviation."""
_SHUTTER = (1 / 20_000, 1 / 250, 1 / 60)
_ISO = (100.0, 1600.0)
"""The program: up to 1/250 s the shutter alone, from there shutter and gain together."""
_KEY = 0.18
_DIM = 20.0
"""Mean luminance in cd/m^2 under which the picture is left darker than the key, as the dark is."""
_HIGHLIGHT = (90.0, 1.0)
"""The percentile of the picture that is kept at this exposure at most, though it costs the shadows."""
_PROTECTION = 0.4
"""At most so far is the exposure lowered for the highlights' sake."""
_LENS = 0.65
"""Fraction q of the light that reaches the sensor (ISO 12232)."""
_BLOOM = ((2.0, 0.6), (8.0, 0.3), (32.0, 0.1))
"""Standard deviation in pixels of an image REFERENCE_WIDTH wide, and weight, of each Gaussian of the glow around over-range
light."""
_OVER = 15.0
"""At most so much over the range glows: what a full pixel still spills."""
_CURVE_SIZE = 4096


class Exposure(NamedTuple):
    """How a frame is exposed: ``gain`` x per cd/m^2 (1 is saturation), ISO, and the time that the shutter is open in s."""

    gain: float
    iso: float
    shutter: float


def auto_exposure(luminance: NDArray[np.float32]) -> Exposure:
    """The exposure for an image (H, W, 3) in cd/m^2, metered on its middle more than on its rim.

    Saturation is at 78 / ISO lux s, so x = L t ISO q / (78 N^2). The wanted exposure puts the log-average at 0.18, less where
    highlights would burn out or in the dark; the shutter gives what it can, then the gain, and what is still missing stays
    missing: nights are dark.
    """
    green = luminance[::2, ::2, 1]
    height, width = green.shape
    v, u = (np.linspace(-1, 1, n) for n in (height, width))
    weight = np.exp(-((v[:, None] ** 2) + u**2))
    mean = float(np.exp(np.sum(weight * np.log(green + 1e-4)) / weight.sum()))
    key = _KEY * min(mean / _DIM, 1.0) ** 0.45
    percent, bound = _HIGHLIGHT
    limit = bound * mean / (key * float(np.percentile(green[::2, ::2], percent)) + 1e-9)
    per_second = _LENS / (78.0 * APERTURE**2)
    wanted = key / mean / per_second * min(max(limit, _PROTECTION), 1.0)  # shutter times ISO
    fastest, base, slowest = _SHUTTER
    beyond = min(max(wanted / (base * _ISO[0]), 1.0), slowest / base * _ISO[1] / _ISO[0])
    longer = np.log(slowest / base) / np.log(slowest / base * _ISO[1] / _ISO[0])
    shutter = min(max(wanted / _ISO[0], fastest), base) * beyond**longer
    iso = min(_ISO[0] * beyond ** (1 - longer), _ISO[1])
    return Exposure(shutter * iso * per_second, iso, shutter)


def bloom(exposed: NDArray[np.float32]) -> NDArray[np.float32]:
    """The image (H, W, 3) plus the glow of what is brighter than the sensor can hold."""
    over = np.clip(exposed - 1.0, 0.0, _OVER)
    if not over.any():
        return exposed
    height, width = over.shape[:2]
    glow = exposed - over
    for sigma, weight in _BLOOM:
        radius = max(sigma * width / REFERENCE_WIDTH, 0.3)
        shrink = 4 if radius > 4 else 1  # a wide glow is worked out on a coarse grid
        size = (-(-width // shrink), -(-height // shrink))
        soft = cv2.resize(over, size, interpolation=cv2.INTER_AREA) if shrink > 1 else over
        soft = cv2.GaussianBlur(soft, (0, 0), radius / shrink, borderType=cv2.BORDER_CONSTANT)
        glow += weight * (cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR) if shrink > 1 else soft)
    return glow


def _tone_curve() -> NDArray[np.uint8]:
    """sRGB bytes for linear values in [0, 1], with a soft shoulder above 0.7 instead of a hard clip."""
    x = np.linspace(0.0, 2.0, _CURVE_SIZE)
    x = np.where(x > 0.7, 0.7 + 0.3 * (1 - np.exp(-(x - 0.7) / 0.3)), x)
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.round(255 * encoded / encoded[-1]).astype(np.uint8)


_CURVE = _tone_curve()


@jit
def _expose(exposed, normal, well, read_noise, curve, out):
    """Vignette (cos^4-like), shot and read noise, 8-bit tone curve. ``normal`` holds one standard normal a value."""
    height, width, channels = exposed.shape
    reach = 0.22 / (0.25 * (height * height + width * width))
    top = len(curve) - 1
    for i in range(height):
        for j in range(width):
            dy, dx = i + 0.5 - 0.5 * height, j + 0.5 - 0.5 * width
            vignette = 1 - reach * (dx * dx + dy * dy)
            for c in range(channels):
                electrons = max(exposed[i, j, c] * vignette, 0.0) * well
                spread = np.sqrt(min(electrons, well) + read_noise * read_noise)
                value = (electrons + spread * normal[i, j, c]) / well
                index = int(value * 0.5 * top + 0.5)
                out[i, j, c] = curve[min(max(index, 0), top)]


def develop(
    luminance: NDArray[np.float32], rng: np.random.Generator, exposure: Exposure | None = None
) -> NDArray[np.uint8]:
    """8-bit sRGB (H, W, 3) of linear luminance (H, W, 3) in cd/m^2, by the automatic exposure unless another is given.

    Shot noise is the normal limit of Poisson: electrons + sqrt(electrons + read^2) N(0, 1). Gain divides the well.
    """
    exposure = exposure or auto_exposure(luminance)
    exposed = bloom(luminance * np.float32(exposure.gain))
    normal = rng.standard_normal(exposed.shape, np.float32)
    out = np.empty(exposed.shape, np.uint8)
    _expose(exposed, normal, FULL_WELL * _ISO[0] / exposure.iso, READ_NOISE, _CURVE, out)
    return out
