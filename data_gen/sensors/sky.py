"""Daylight: how the condition's illuminance splits into sun and sky, and what the sky looks like in any direction.

Photometric units throughout: illuminance in lux, luminance in cd/m^2, one value a colour channel with white as (1, 1, 1).
"""

import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_gen.conditions import Condition
from data_gen.jit import jit
from data_gen.sensors.noise import noise2, ramp

SUN_NORMAL = 100_000.0
"""Illuminance of the sun square to its rays through a clear zenith atmosphere times exp(0.2), lux."""
FOG_DEPTH = 200.0
"""Thickness in metres of the hazy layer that the sun shines through."""
_DISC_RADIUS = np.radians(0.265)


class Light(NamedTuple):
    """The light of one scene. Vectors are (3,) float64."""

    sun_direction: NDArray  # global, towards the sun
    sun: NDArray  # lux square to the sun's rays, behind haze
    ambient: NDArray  # lux on a level face from the sky alone
    zenith: NDArray  # cd/m^2
    horizon: NDArray  # cd/m^2; also what haze scatters into a ray
    clear: float  # 1 under a blue sky, 0 under a closed one
    extinction: float  # 1/m
    night: bool
    seed: float  # shift of the clouds


def light_of(condition: Condition, name: str) -> Light:
    """Sun and sky of a condition; ``name`` of the scene places the clouds.

    The sun's share is that of a clear sky where the illuminance comes near what a clear sky gives at that elevation
    (100,000 lux exp(-0.2 / sin elevation) square to the sun), thinned by the haze layer; the sky gives the rest.
    """
    elevation, azimuth = np.radians([condition.sun_elevation, condition.sun_azimuth])
    sine = np.sin(elevation)
    direction = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), sine])
    seed = float(zlib.crc32(name.encode()) % 10_000)
    if condition.is_night:
        lux = condition.illuminance
        zenith, horizon = np.array([0.6, 0.8, 1.3]) * 0.003 * lux, np.array([1.15, 0.98, 0.85]) * 0.012 * lux
        ambient = np.array([1.10, 1.0, 0.82]) * lux
        return Light(direction, np.zeros(3), ambient, zenith, horizon, 0.3, condition.extinction, True, seed)
    full = SUN_NORMAL * np.exp(-0.2 / max(sine, 0.02)) if sine > 0 else 0.0
    clear = float(ramp(0.25, 0.65, condition.illuminance / (1.2 * full * sine))) if sine > 0.02 else 0.0
    clear *= float(np.exp(-condition.extinction * FOG_DEPTH / max(sine, 0.05)))
    direct = min(clear * full, 0.85 * condition.illuminance / max(sine, 0.1))
    diffuse = condition.illuminance - direct * sine
    diffuse += clear * (min(max(diffuse, 0.1 * condition.illuminance), 4_000.0 + 14_000.0 * sine) - diffuse)
    warm = float(np.exp(-max(sine, 0.0) / 0.18))
    sun = direct * (np.array([1.06, 0.99, 0.88]) * (1 - warm) + np.array([1.35, 0.90, 0.50]) * warm)
    mean = diffuse / np.pi  # of the luminance over the hemisphere, weighted by the cosine
    blue, grey = np.array([0.42, 0.78, 1.62]), np.array([0.98, 1.0, 1.04])
    pale = np.array([1.02, 1.05, 1.12]) * (1 - warm) + np.array([1.35, 1.0, 0.75]) * warm
    zenith = mean * (0.86 * blue * clear + 1.03 * grey * (1 - clear))
    horizon = mean * (2.1 * pale * clear + 0.75 * grey * (1 - clear))
    ambient = diffuse * (np.array([0.86, 0.98, 1.22]) * clear + grey * (1 - clear))
    return Light(direction, sun, ambient, zenith, horizon, clear, condition.extinction, False, seed)


@jit
def gradient(z, light, out):
    """Luminance of the cloudless sky at the sine ``z`` of the elevation, written to ``out`` (3,)."""
    weight = (1 - min(max(z, 0.0), 1.0)) ** 5
    for c in range(3):
        out[c] = light.zenith[c] + (light.horizon[c] - light.zenith[c]) * weight


@jit
def _clouds(x, y, z, seed):
    """Cover in [0, 1] and brightness of the clouds, a layer of fractal noise seen in perspective."""
    s = 1.0 / (z + 0.10)
    u, v = x * s * 1.1 + seed, y * s * 1.1 + 0.7 * seed
    n = 0.55 * noise2(u, v, 1) + 0.28 * noise2(2.1 * u, 2.1 * v, 2) + 0.16 * noise2(4.3 * u, 4.3 * v, 3)
    n += 0.09 * noise2(9.1 * u, 9.1 * v, 4)
    return n


@jit
def sky(rays, light, pixel):
    """Luminance (N, 3) seen along unit global rays that meet nothing: sky, clouds, sun and, below a skyline of distant trees,
    land in the haze. ``pixel`` is the angle of a pixel (rad), over which edges are softened."""
    out = np.empty((len(rays), 3), np.float32)
    color = np.empty(3)
    total = light.ambient + light.sun * max(light.sun_direction[2], 0.0)
    far = np.exp(-light.extinction * 1200.0)
    for i in range(len(rays)):
        x, y, z = np.float64(rays[i, 0]), np.float64(rays[i, 1]), np.float64(rays[i, 2])
        gradient(z, light, color)
        cosine = x * light.sun_direction[0] + y * light.sun_direction[1] + z * light.sun_direction[2]
        angle = np.arccos(min(max(cosine, -1.0), 1.0))
        glow = 0.9 * np.exp(-angle / 0.30) + 5.0 * np.exp(-angle / 0.05)
        n = _clouds(x, y, max(z, 0.0), light.seed)
        cover = ramp(0.02, 0.45, n) * ramp(0.02, 0.16, z) * (0.85 if light.clear > 0.02 else 0.35)
        shade = 1.25 - 0.45 * ramp(0.25, 0.75, n)
        disc = 1 - ramp(_DISC_RADIUS - 0.5 * pixel, _DISC_RADIUS + 0.5 * pixel, angle)
        azimuth = np.arctan2(y, x)
        crest = 0.016 + 0.012 * noise2(9 * azimuth, 0.5, 5) + 0.006 * noise2(60 * azimuth, 0.5, 6)
        land = 1 - ramp(crest - 0.6 * pixel, crest + 0.6 * pixel, z)
        for c in range(3):
            over = color[c] + light.horizon[c] * glow * light.clear * (not light.night)
            white = (total[c] / np.pi * (0.75 + 0.9 * np.exp(-angle / 0.5) * light.clear)) * shade
            over += cover * ((white if not light.night else 1.5 * light.horizon[c] * shade) - over)
            over += disc * (1 - cover) * light.sun[c] / 6.8e-5
            trees = (0.05 + 0.02 * (c == 1)) * total[c] / np.pi * (0.15 if light.night else 0.8)
            out[i, c] = over * (1 - land) + land * (trees * far + light.horizon[c] * (1 - far))
    return out
