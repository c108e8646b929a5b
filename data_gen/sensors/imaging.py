"""From light to pixels: exposure, lens, sensor noise, tone curve."""

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.jit import jit

APERTURE = 1.4
FULL_WELL = 10_000.0
"""Electrons of a saturated pixel at ISO 100."""
READ_NOISE = 4.0
"""Electrons, standard deviation."""
_SHUTTER = (1 / 20_000, 1 / 60)
_ISO = (100.0, 1600.0)
_KEY = 0.18
_LENS = 0.65
"""Share q of the light that reaches the sensor (ISO 12232)."""
_BLOOM = ((2.0, 0.6), (8.0, 0.3), (32.0, 0.1))
"""Standard deviation in pixels of an image 1,600 wide, and weight, of each Gaussian of the glow around over-range light."""
_CURVE_SIZE = 4096


def auto_exposure(luminance: NDArray[np.float32]) -> tuple[float, float]:
    """Exposure x per cd/m^2 (1 is saturation) and ISO for an image (H, W, 3).

    Saturation is at 78 / ISO lux s, so x = L t ISO q / (78 N^2). The wanted exposure puts the log-average at 0.18; the
    shutter gives what it can, then the gain, and what is still missing stays missing: nights are dark.
    """
    mean = float(np.exp(np.mean(np.log(luminance[..., 1] + 1e-4))))
    per_second = _LENS / (78.0 * APERTURE**2)
    wanted = _KEY / mean / per_second  # shutter times ISO
    shutter = min(max(wanted / _ISO[0], _SHUTTER[0]), _SHUTTER[1])
    iso = min(max(wanted / shutter, _ISO[0]), _ISO[1])
    return shutter * iso * per_second, iso


def bloom(exposed: NDArray[np.float32]) -> NDArray[np.float32]:
    """The image (H, W, 3) plus the glow of what is brighter than the sensor can hold."""
    over = np.clip(exposed - 1.0, 0.0, 40.0)
    if not over.any():
        return exposed
    scale = exposed.shape[1] / 1600
    glow = exposed - over
    for sigma, weight in _BLOOM:
        glow = glow + weight * cv2.GaussianBlur(over, (0, 0), max(sigma * scale, 0.3), borderType=cv2.BORDER_CONSTANT)
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


def develop(luminance: NDArray[np.float32], rng: np.random.Generator, noise: bool = True) -> NDArray[np.uint8]:
    """8-bit sRGB (H, W, 3) of linear luminance (H, W, 3) in cd/m^2.

    Shot noise is the normal limit of Poisson: electrons + sqrt(electrons + read^2) N(0, 1). Gain divides the well.
    """
    exposure, iso = auto_exposure(luminance)
    exposed = bloom(luminance * np.float32(exposure))
    normal = rng.standard_normal(exposed.shape, np.float32) if noise else np.zeros_like(exposed)
    out = np.empty(exposed.shape, np.uint8)
    _expose(exposed, normal, FULL_WELL * _ISO[0] / iso, READ_NOISE, _CURVE, out)
    return out
