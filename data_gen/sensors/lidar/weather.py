"""What besides surfaces sends light to a LiDAR: drops, fog, spray, the sun and other LiDARs; and how it weakens a return."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_gen.rig.mounts import Lidar
from data_gen.scene.light import SUN_NORMAL, light_of
from data_gen.scene.scene import NOTHING, Scene
from data_gen.scene.spray import penetrate, plumes_at
from data_gen.sensors.lidar.power import Returns, calibrated_reflectivity, signal_to_noise, strongest
from data_gen.sensors.lidar.scatter import RANGES, echo_table, sample_echoes

Array = NDArray[np.float64]

HAZE = 2_000.0
"""Metres of visibility up to which mist returns light that could be detected."""
SPRAY_ECHO = 0.5
"""Fraction k of the spray's two-way optical depth that makes an echo: with the probability 1 - exp(-2 k tau)."""
SPRAY_BYTE = (1.0, 10.0)
"""Calibrated reflectivity of spray (SemanticSpray)."""
SUN_CONE = 10.0
"""Degrees from the sun within which its light reaches the receiver."""
HIGH_SUN = 25.0
"""Degrees of elevation from which the sun is out of reach of the highest beam."""
SUN_NOISE = 2.0
"""Noise power of a full sun straight ahead, in units of the receiver's own."""
SUN_FALSE = 0.05
"""Fraction of the rays straight at a full sun that report its noise as a point."""


class Rays(NamedTuple):
    """The rays of a sweep in the global frame."""

    origins: Array  # (N, 3)
    directions: Array  # (N, 3) unit
    times: Array  # (N,) seconds


def with_weather(scene: Scene, rays: Rays, surfaces: Returns, *, lidar: Lidar, rng: np.random.Generator) -> Returns:
    """The strongest return of each ray: of those of ``surfaces``, weakened, and of everything in the air before them.

    In clear air ``surfaces`` itself. Points that come from the air belong to NOTHING.
    """
    condition, count, max_range = scene.condition, len(rays.times), lidar.max_range
    if not count:
        return surfaces
    reach = np.full(count, max_range)
    reach[surfaces.ray] = surfaces.distance
    echoes = []
    middle = float(rays.times.mean())
    plumes = plumes_at(scene, middle)
    if len(plumes.length):
        depth = rng.exponential(size=count) / (2 * SPRAY_ECHO)
        tau, stop = penetrate(plumes, rays.origins, rays.directions, reach, depth, rays.times - middle)
        surfaces = surfaces.dimmed(np.exp(-2 * tau[surfaces.ray]))
        ray = np.flatnonzero(np.isfinite(stop))
        distance, byte = stop[ray], rng.uniform(*SPRAY_BYTE, len(ray))
        brightness = byte / 100 * np.exp(-2 * condition.extinction * distance)
        echoes.append(_in_air(ray, distance, signal_to_noise(brightness, distance, max_range=max_range), byte))
    if condition.rain_rate > 0 or condition.visibility < HAZE:
        weather = (condition.rain_rate, condition.mist_extinction, condition.extinction)
        table = echo_table(*weather, max_range, lidar.model.divergence)
        ray, distance, snr = sample_echoes(table, reach, rng)
        echoes.append(_in_air(ray, distance, snr, calibrated_reflectivity(snr, distance, max_range=max_range)))
    if lidar.crosstalk > 0:
        echoes.append(_stray(np.full(count, lidar.crosstalk), 3.0, max_range, rng))
    sun = _sunlight(scene, rays)
    if sun is not None:
        surfaces = surfaces._replace(snr=surfaces.snr / (1 + SUN_NOISE * sun[surfaces.ray]))
        echoes.append(_stray(SUN_FALSE * sun, 0.5, max_range, rng))
    return strongest(count, surfaces, *echoes) if echoes else surfaces


def _sunlight(scene: Scene, rays: Rays) -> Array | None:
    """Sunlight (N,) in the receiver of each ray, 1 for a full sun straight ahead; None where none comes in.

    It falls evenly to 0 over ``SUN_CONE``. At 905 nm a low sun passes the air better than to the eye, with a third of the
    optical depth.
    """
    if not 0 < scene.condition.sun_elevation < HIGH_SUN:
        return None
    light = light_of(scene.condition, scene.name)
    power = float(light.sun.mean() / SUN_NORMAL) ** (1 / 3)
    cosine = rays.directions @ light.sun_direction
    if power < 0.05 or cosine.max() < np.cos(np.radians(SUN_CONE)):
        return None
    ahead = int(cosine.argmax())
    if scene.occluded(rays.origins[ahead], light.sun_direction[None], float(rays.times[ahead]))[0]:
        return None
    return power * np.maximum(1 - np.degrees(np.arccos(np.clip(cosine, -1, 1))) / SUN_CONE, 0.0)


def _stray(probability: Array, excess: float, max_range: float, rng: np.random.Generator) -> Returns:
    """Light of no pulse of this LiDAR, received at any distance with a ``probability`` (N,) per ray; ``excess``: its mean
    power above the least detectable, in units of that."""
    ray = np.flatnonzero(rng.random(len(probability)) < probability)
    distance, snr = rng.uniform(RANGES[0], max_range, len(ray)), 1 + rng.exponential(excess, len(ray))
    return _in_air(ray, distance, snr, calibrated_reflectivity(snr, distance, max_range=max_range))


def _in_air(ray: NDArray[np.int64], distance: Array, snr: Array, byte: Array) -> Returns:
    return Returns(ray, distance, snr, byte, np.full(len(ray), NOTHING, np.int32))
