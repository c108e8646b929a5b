"""A wet road: asphalt darkens, its film of water mirrors what stands behind it, and sun and lamps glitter on its ripples.

How much mirrors follows Fresnel's law for water; ripples stretch what is mirrored towards and away from the eye.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.light import sky
from data_gen.scene.noise import noise2
from data_gen.scene.scene import WORLD, Hits, Scene
from data_gen.world.ground import GROUND_NAMES

if TYPE_CHECKING:
    from data_gen.sensors.camera.rendering.renderer import Renderer

LEAST_FILM = 0.05
"""Millimetres of water under which a road counts as dry."""
FULL_FILM = 1.0
"""Millimetres that drown the texture of the road."""
_DARK_FILM = 0.2
_MIRROR_RANGE = 120.0
_ROUGHNESS = (0.03, 0.12)
"""Standard deviation of the slope of the ripples on a drowned road and on a damp one."""
_SOAKS_AWAY = np.array([any(word in name for word in ("grass", "gravel", "earth", "soil")) for name in GROUND_NAMES])


def soak(scene: Scene, hits: Hits, ground: NDArray[np.int64], colors: NDArray[np.float32]) -> None:
    """Darken, in place, the painted ``colors`` (N, 5) of the hits ``ground`` (K,), and write the share of them that water
    covers to the column of the specular share. Water stands in patches."""
    where, film = scene.ground, scene.condition.water_film
    _soak(
        hits.local, ground, where.material, np.asarray(where.origin, float), float(where.resolution), _SOAKS_AWAY,
        min(film / FULL_FILM, 1.0) ** 0.7, min(film / _DARK_FILM, 1.0), colors,
    )  # fmt: skip


@jit
def _soak(local, ground, raster, origin, resolution, soaks_away, share, damp, colors):
    for i in ground:
        x, y = np.float64(local[i, 0]), np.float64(local[i, 1])
        row, column = int(np.floor((y - origin[1]) / resolution)), int(np.floor((x - origin[0]) / resolution))
        if not (0 <= row < raster.shape[0] and 0 <= column < raster.shape[1]) or soaks_away[raster[row, column]]:
            continue
        patch = 1 + 0.5 * noise2(x / 3.1, y / 3.1, 111) + 0.35 * noise2(x / 0.8, y / 0.8, 112)
        colors[i, 3] = min(max(share * patch, 0.0), 1.0)
        for c in range(3):  # light is caught between film and road; bright paint gives it back (Lekner and Dorf, 1988)
            colors[i, c] *= 1 - 0.5 * damp * (1 - colors[i, c]) ** 2


def mirror_image(
    renderer: "Renderer", rays: NDArray[np.float32], hits: Hits, ground: NDArray[np.int64], shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Luminance (N, 3) that arrives at the ground from where a level film of water would mirror it, for the rays (N, 3) of a
    whole picture of ``shape``. Every other pixel of every other row is cast; the ripples' blur fills the gaps."""
    height, width = shape
    row, column = ground // width, ground % width
    ground = ground[(row % 2 == 0) & ((column + row // 2) % 2 == 0)]
    half = np.zeros(((height + 1) // 2, width, 4), np.float32)
    if len(ground):
        half[ground // width // 2, ground % width] = np.pad(
            _bounced(renderer, rays, hits, ground), ((0, 0), (0, 1)), constant_values=1
        )
    # A slope s turns the ray by 2 s: that many pixels up and down, and less across by the grazing angle.
    film = min(renderer.scene.condition.water_film / FULL_FILM, 1.0)
    tall = 2 * (_ROUGHNESS[0] + (1 - film) * (_ROUGHNESS[1] - _ROUGHNESS[0])) / renderer.view.pixel
    size = (2 * round(0.1 * tall) + 1, 2 * round(0.4 * tall) + 1)  # half the rows, and the filter acts twice
    soft = cv2.blur(cv2.blur(half, size, borderType=cv2.BORDER_CONSTANT), size, borderType=cv2.BORDER_CONSTANT)
    faint = np.float32(1e-3)  # where no sample is near, the horizon
    filled = (soft[..., :3] + faint * renderer.light.horizon.astype(np.float32)) / (soft[..., 3:] + faint)
    return np.repeat(filled, 2, axis=0)[:height].reshape(-1, 3).astype(np.float32, copy=False)


def _bounced(renderer: "Renderer", rays: NDArray, hits: Hits, ground: NDArray[np.int64]) -> NDArray[np.float32]:
    """What the mirrored rays of the hits ``ground`` (K,) meet: luminance (K, 3), without lamps and sun: they glitter."""
    scene, normal = renderer.scene, hits.normal[ground]
    along = (rays[ground] * normal).sum(axis=1, keepdims=True)
    towards = np.ascontiguousarray(rays[ground] - 2 * along * normal)
    origins = renderer.lifted(rays, hits, ground)
    met = scene.cast(origins, towards, renderer.t, _MIRROR_RANGE)
    points = origins + towards * np.where(np.isfinite(met.distance), met.distance, 0)[:, None]
    colors = renderer.paint(towards, replace(met, distance=met.distance + hits.distance[ground]), 1.0)
    colors[:, 4] = 0.0
    lit, open_sky = renderer.sunlit(points, met), np.ones(len(met.body), np.float32)
    out = renderer.shade(points, towards, met, colors, lit, open_sky, np.zeros((0, 3), np.float32))
    empty = np.flatnonzero(met.body < WORLD)
    above = sky(towards[empty], renderer.light, renderer.view.pixel)
    out[empty] = np.minimum(above, 12 * renderer.light.horizon.astype(np.float32) + renderer.light.afterglow.max())
    return out


@jit
def glitter(d, x, y, z, share):
    """Luminance that ripples under a ray ``d`` (3,) show of a source in the unit direction (x, y, z), a lux square to its rays.

    Gaussian slopes: L = F E P(slopes) / (4 cos(view) cos^4(tilt)) (Cox and Munk, 1954); ``share`` covered by water.
    """
    hx, hy, hz = x - d[0], y - d[1], z - d[2]
    if hz <= 0 or z <= 0:
        return 0.0
    rough = _ROUGHNESS[0] + (1 - share) * (_ROUGHNESS[1] - _ROUGHNESS[0])
    slope2 = (hx * hx + hy * hy) / (hz * hz)
    if slope2 > 25 * rough * rough:
        return 0.0
    length = np.sqrt(hx * hx + hy * hy + hz * hz)
    chance = np.exp(-0.5 * slope2 / (rough * rough)) / (2 * np.pi * rough * rough)
    upright = hz / length
    return share * share * fresnel((x * hx + y * hy + z * hz) / length) * chance / (4 * max(-d[2], 0.03) * upright**4)


@jit
def fresnel(cosine):
    """Share of the light that water mirrors (Schlick)."""
    return 0.02 + 0.98 * (1 - min(max(cosine, 0.0), 1.0)) ** 5
