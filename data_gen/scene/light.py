"""Daylight, twilight and night: how the condition's illuminance splits into sun, sky and lamps, and what the air and the sky
look like in any direction.

Photometric units throughout: illuminance in lux, luminance in cd/m^2, one value a colour channel with white as (1, 1, 1).
"""

import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.conditions import Condition
from data_gen.scene.noise import noise2, ramp

SUN_NORMAL = 100_000.0
"""Illuminance of the sun square to its rays through a clear zenith atmosphere times exp(0.2), lux."""
FOG_DEPTH = 200.0
"""Thickness in metres of a layer of fog; thin haze lies lower."""
_DISC_RADIUS = np.radians(0.265)
_DISC_SOLID_ANGLE = np.pi * _DISC_RADIUS**2
# Illuminance of a level face under a clear sky by the sun's elevation in degrees: daylight and civil twilight.
_CLEAR_ELEVATION = (-18.0, -8.0, -5.0, -3.0, 0.0, 1.5, 3.0, 6.0, 10.0, 15.0, 25.0, 45.0, 90.0)
_CLEAR_LOG_LUX = (-3.0, 0.9, 1.8, 2.4, 2.95, 3.15, 3.4, 3.7, 3.95, 4.15, 4.5, 4.81, 4.99)
_RAYLEIGH = np.array([0.055, 0.10, 0.215])
"""Optical depth of the air at the zenith in red, green and blue: what makes a low sun red."""
_LUMA = np.array([0.2126, 0.7152, 0.0722])


class Light(NamedTuple):
    """The light of one scene. Vectors are (3,) float64."""

    sun_direction: NDArray  # global, towards the sun
    sun: NDArray  # lux square to the sun's rays, behind haze
    ambient: NDArray  # lux on a level face from the sky alone
    street: NDArray  # lux on a level face from a town's lamps, on average
    zenith: NDArray  # cd/m^2
    horizon: NDArray  # cd/m^2; also what haze scatters into a ray
    afterglow: NDArray  # cd/m^2 that a low sun adds to the horizon below it
    glow: float  # what haze in front of the sun adds, as a fraction of the horizon
    clear: float  # 1 under a blue sky, 0 under a closed one
    extinction: float  # 1/m
    layer: float  # optical depth of the haze towards the zenith
    night: bool  # lamps are lit
    dark: float  # 0 by day, 1 where only lamps are left
    seed: float  # shift of the clouds


def light_of(condition: Condition, name: str) -> Light:
    """Sun, sky and lamps of a condition; ``name`` of the scene places the clouds.

    The sun gives as much as in a clear sky where the illuminance comes near what a clear sky gives at that elevation
    (square to the rays 100,000 lux exp(-0.2 air mass)), thinned by the haze layer; the sky gives the rest. As the sun sinks
    from 4 to 12 degrees under the horizon, lamps take over what is left of the illuminance.
    """
    elevation, azimuth = np.radians([condition.sun_elevation, condition.sun_azimuth])
    sine = float(np.sin(elevation))
    direction = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), sine])
    dark = 1.0 - float(ramp(-12.0, -4.0, condition.sun_elevation)) if condition.is_night else 0.0
    lamplight, natural = condition.illuminance * dark, condition.illuminance * (1 - dark)
    # A mist that leaves kilometres of sight is a shallow one, or the evening sun would never shine through it.
    layer = condition.extinction * FOG_DEPTH * min(condition.extinction / 0.01, 1.0)
    expected = 10.0 ** np.interp(condition.sun_elevation, _CLEAR_ELEVATION, _CLEAR_LOG_LUX)
    through = layer / max(sine, 0.08)
    clear = float(ramp(0.25, 0.65, natural / expected) * np.exp(-through))
    sun = _sunlight(condition.sun_elevation, natural, clear)
    diffuse = natural - float(sun @ _LUMA) * max(sine, 0.0)
    if sine > 0:  # what a cloudless sky gives without the sun is bounded
        diffuse += clear * (min(max(diffuse, 0.1 * natural), 4_000.0 + 14_000.0 * sine) - diffuse)
    warm = float(np.exp(-max(sine, 0.0) / 0.18))
    mean = diffuse / np.pi  # of the luminance over the hemisphere, weighted by the cosine
    blue, grey = np.array([0.42, 0.78, 1.62]), np.array([0.98, 1.0, 1.04])
    pale = np.array([1.02, 1.05, 1.12]) * (1 - warm) + np.array([1.12, 1.0, 0.96]) * warm
    zenith = mean * (0.86 * blue * clear + 1.03 * grey * (1 - clear))
    horizon = mean * (2.1 * pale * (1 - 0.35 * warm) * clear + 0.75 * grey * (1 - clear))
    return Light(
        sun_direction=direction,
        sun=sun,
        ambient=diffuse * (np.array([0.86, 0.98, 1.22]) * clear + grey * (1 - clear)),
        street=np.array([1.10, 1.0, 0.82]) * lamplight,
        zenith=zenith + np.array([0.6, 0.8, 1.3]) * 0.003 * lamplight,
        horizon=horizon + np.array([1.15, 0.98, 0.85]) * 0.012 * lamplight,
        afterglow=mean * clear * warm * np.array([3.0, 1.5, 0.6]),
        # Forward scattering keeps the beam together: haze dims the glow with (1 - g) of its depth, g = 0.85.
        glow=1.2 * float(ramp(0.1, 0.6, natural / expected) * np.exp(-0.15 * through)),
        clear=clear,
        extinction=condition.extinction,
        layer=layer,
        night=condition.is_night,
        dark=dark,
        seed=float(zlib.crc32(name.encode()) % 10_000),
    )


def _sunlight(elevation: float, natural: float, clear: float) -> NDArray[np.float64]:
    """Illuminance (3,) square to the sun's rays; ``elevation`` in degrees. Air mass after Kasten and Young (1989)."""
    if elevation < -0.5:
        return np.zeros(3)
    sine = np.sin(np.radians(max(elevation, 0.0)))
    mass = 1.0 / (sine + 0.50572 * (max(elevation, 0.0) + 6.07995) ** -1.6364)
    lux = min(clear * SUN_NORMAL * np.exp(-0.2 * mass), 0.85 * natural / max(sine, 0.1))
    color = np.exp(-(_RAYLEIGH - _RAYLEIGH[1]) * min(mass, 8.0))
    return lux * color / (color @ _LUMA)


@jit
def airlight(x, y, z, light, out):
    """What haze scatters into a ray with the unit direction (x, y, z), written to ``out`` (3,): the horizon's light, brighter
    towards the sun and warm below a low one."""
    sun = light.sun_direction
    level = np.sqrt((x * x + y * y) * (sun[0] * sun[0] + sun[1] * sun[1])) + 1e-6
    below = 0.5 + 0.5 * (x * sun[0] + y * sun[1]) / level
    towards = 0.5 + 0.5 * (x * sun[0] + y * sun[1] + z * sun[2])
    for _ in range(3):
        below *= below
        towards *= towards
    towards *= towards
    for c in range(3):
        out[c] = light.horizon[c] * (1 + light.glow * towards) + light.afterglow[c] * below


@jit
def gradient(x, y, z, light, out):
    """Luminance of the cloudless sky in the unit direction (x, y, z), written to ``out`` (3,)."""
    airlight(x, y, z, light, out)
    weight = (1 - min(max(z, 0.0), 1.0)) ** 5
    for c in range(3):
        out[c] = light.zenith[c] + (out[c] - light.zenith[c]) * weight


@jit
def _clouds(x, y, z, seed):
    """Density of the clouds, a layer of fractal noise seen in perspective."""
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
    color, air = np.empty(3), np.empty(3)
    total = light.ambient + light.sun * max(light.sun_direction[2], 0.0)
    far = np.exp(-light.extinction * 1200.0)
    for i in range(len(rays)):
        x, y, z = np.float64(rays[i, 0]), np.float64(rays[i, 1]), np.float64(rays[i, 2])
        gradient(x, y, z, light, color)
        airlight(x, y, z, light, air)
        cosine = x * light.sun_direction[0] + y * light.sun_direction[1] + z * light.sun_direction[2]
        angle = np.arccos(min(max(cosine, -1.0), 1.0))
        glow = 0.4 * np.exp(-angle / 0.30) + 5.0 * np.exp(-angle / 0.05)
        n = _clouds(x, y, max(z, 0.0), light.seed)
        shines = light.clear * np.exp(-((angle / 0.10) ** 2))  # no cloud stands before a sun that casts shadows
        cover = ramp(0.02, 0.45, n) * ramp(0.02, 0.16, z) * (0.85 if light.clear > 0.02 else 0.35) * (1 - shines)
        shade = 1.25 - 0.45 * ramp(0.25, 0.75, n)
        disc = 1 - ramp(_DISC_RADIUS - 0.5 * pixel, _DISC_RADIUS + 0.5 * pixel, angle)
        azimuth = np.arctan2(y, x)
        crest = 0.016 + 0.012 * noise2(9 * azimuth, 0.5, 5) + 0.006 * noise2(60 * azimuth, 0.5, 6)
        land = 1 - ramp(crest - 0.6 * pixel, crest + 0.6 * pixel, z)
        through = np.exp(-light.layer / max(z, 0.01))
        for c in range(3):
            over = color[c] + light.horizon[c] * glow * light.clear
            white = total[c] / np.pi * (0.75 + 0.9 * np.exp(-angle / 0.5) * light.clear) + 0.4 * light.afterglow[c]
            over += cover * ((white + 1.5 * light.horizon[c] * light.dark) * shade - over)
            over += disc * (1 - cover) * light.sun[c] / _DISC_SOLID_ANGLE
            over = air[c] + (over - air[c]) * through
            trees = (0.05 + 0.02 * (c == 1)) * (0.8 * total[c] + 0.15 * light.street[c]) / np.pi
            out[i, c] = over * (1 - land) + land * (trees * far + air[c] * (1 - far))
    return out
