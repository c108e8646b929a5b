"""A wet road: asphalt darkens, its film of water mirrors what stands behind it, and sun and lamps glitter on its ripples.

How much mirrors follows Fresnel's law for water; ripples stretch what is mirrored towards and away from the eye.
"""

import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.noise import noise2
from data_gen.scene.scene import Hits, Scene
from data_gen.scene.wetness import ABSORBING

ROUGHNESS = (0.03, 0.12)
"""Standard deviation of the slope of the ripples on a drowned road and on a damp one."""


def soak(scene: Scene, hits: Hits, ground: NDArray[np.int64], colors: NDArray[np.float32]) -> None:
    """Darken, in place, the painted ``colors`` (N, 5) of the hits ``ground`` (K,), and write the fraction of them that water
    covers to the specular column. Water stands in patches."""
    where, wetness = scene.ground, scene.wetness
    _soak(
        hits.local, ground, where.material, np.asarray(where.origin, float), float(where.resolution), ABSORBING,
        wetness.covered, wetness.darkened, colors,
    )  # fmt: skip


@jit
def _soak(local, ground, raster, origin, resolution, absorbing, covered, darkened, colors):
    for i in ground:
        x, y = np.float64(local[i, 0]), np.float64(local[i, 1])
        row, column = int(np.floor((y - origin[1]) / resolution)), int(np.floor((x - origin[0]) / resolution))
        if not (0 <= row < raster.shape[0] and 0 <= column < raster.shape[1]) or absorbing[raster[row, column]]:
            continue
        patch = 1 + 0.5 * noise2(x / 3.1, y / 3.1, 111) + 0.35 * noise2(x / 0.8, y / 0.8, 112)
        colors[i, 3] = min(max(covered * patch, 0.0), 1.0)
        for c in range(3):  # light is caught between film and road; bright paint gives it back (Lekner and Dorf, 1988)
            colors[i, c] *= 1 - 0.5 * darkened * (1 - colors[i, c]) ** 2


@jit
def glitter(d, x, y, z, covered):
    """Luminance that ripples under a ray ``d`` (3,) show of a source in the unit direction (x, y, z), a lux square to its rays.

    Gaussian slopes: L = F E P(slopes) / (4 cos(view) cos^4(tilt)) (Cox and Munk, 1954); ``covered``: the fraction under water.
    """
    hx, hy, hz = x - d[0], y - d[1], z - d[2]
    if hz <= 0 or z <= 0:
        return 0.0
    rough = ROUGHNESS[0] + (1 - covered) * (ROUGHNESS[1] - ROUGHNESS[0])
    slope2 = (hx * hx + hy * hy) / (hz * hz)
    if slope2 > 25 * rough * rough:
        return 0.0
    length = np.sqrt(hx * hx + hy * hy + hz * hz)
    chance = np.exp(-0.5 * slope2 / (rough * rough)) / (2 * np.pi * rough * rough)
    upright = hz / length
    mirrored = covered * covered * fresnel((x * hx + y * hy + z * hz) / length)
    return mirrored * chance / (4 * max(-d[2], 0.03) * upright**4)


@jit
def fresnel(cosine):
    """Fraction of the light that water mirrors (Schlick)."""
    return 0.02 + 0.98 * (1 - min(max(cosine, 0.0), 1.0)) ** 5
