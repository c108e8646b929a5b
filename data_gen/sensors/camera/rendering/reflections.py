"""What a wet road mirrors: the rays that its film of water reflects are cast, and blurred by its ripples."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.scene.light import sky
from data_gen.scene.scene import WORLD, Hits
from data_gen.sensors.camera.rendering.renderer import Renderer
from data_gen.sensors.camera.rendering.wet_road import ROUGHNESS

_MIRROR_RANGE = 120.0
"""Metres that mirrored rays travel."""


def mirror_image(
    renderer: Renderer, rays: NDArray[np.float32], hits: Hits, shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Luminance (N, 3) that arrives at the ground from where a level film of water would mirror it, for the rays (N, 3) of a
    whole image of ``shape``; (0, 3) where the ground is dry. Every other pixel of every other row is cast; the ripples' blur
    fills the gaps."""
    if not renderer.is_wet:
        return np.zeros((0, 3), np.float32)
    ground = np.flatnonzero(renderer.on_ground(hits))
    height, width = shape
    row, column = ground // width, ground % width
    ground = ground[(row % 2 == 0) & ((column + row // 2) % 2 == 0)]
    half = np.zeros(((height + 1) // 2, width, 4), np.float32)
    if len(ground):
        half[ground // width // 2, ground % width] = np.pad(
            _bounced(renderer, rays, hits, ground), ((0, 0), (0, 1)), constant_values=1
        )
    # A slope s turns the ray by 2 s: that many pixels up and down, and less across by the grazing angle.
    covered = renderer.scene.wetness.covered
    tall = 2 * (ROUGHNESS[0] + (1 - covered) * (ROUGHNESS[1] - ROUGHNESS[0])) / renderer.view.pixel
    size = (2 * round(0.1 * tall) + 1, 2 * round(0.4 * tall) + 1)  # half the rows, and the filter acts twice
    soft = cv2.blur(cv2.blur(half, size, borderType=cv2.BORDER_CONSTANT), size, borderType=cv2.BORDER_CONSTANT)
    faint = np.float32(1e-3)  # where no sample is near, the horizon
    filled = (soft[..., :3] + faint * renderer.light.horizon.astype(np.float32)) / (soft[..., 3:] + faint)
    return np.repeat(filled, 2, axis=0)[:height].reshape(-1, 3).astype(np.float32, copy=False)


def _bounced(renderer: Renderer, rays: NDArray, hits: Hits, ground: NDArray[np.int64]) -> NDArray[np.float32]:
    """What the mirrored rays of the hits ``ground`` (K,) meet: luminance (K, 3), without lamps and sun: they glitter."""
    scene, normal = renderer.scene, hits.normal[ground]
    along = (rays[ground] * normal).sum(axis=1, keepdims=True)
    towards = np.ascontiguousarray(rays[ground] - 2 * along * normal)
    origins = renderer.lifted(rays, hits, ground)
    met = scene.cast(origins, towards, renderer.t, _MIRROR_RANGE, counted=False)
    points = origins + towards * np.where(np.isfinite(met.distance), met.distance, 0)[:, None]
    colors = renderer.paint(towards, replace(met, distance=met.distance + hits.distance[ground]), 1.0)
    colors[:, 4] = 0.0
    lit, open_sky = renderer.sunlit(points, met), np.ones(len(met.body), np.float32)
    out = renderer.shade(points, towards, met, colors, lit, open_sky, np.zeros((0, 3), np.float32))
    empty = np.flatnonzero(met.body < WORLD)
    above = sky(towards[empty], renderer.light, renderer.view.pixel)
    out[empty] = np.minimum(above, 12 * renderer.light.horizon.astype(np.float32) + renderer.light.afterglow.max())
    return out
