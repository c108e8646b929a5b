"""The camera: one ray through every pixel's centre, more where the picture has edges; then air, lens and sensor.

The body image and the depth come from the centre rays alone; at edges the picture averages five rays in linear light.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.rig.mounts import Camera
from data_gen.scene.scene import Hits, Scene
from data_gen.scene.spray import plumes_at
from data_gen.sensors.camera import glare, lens
from data_gen.sensors.camera.imaging import Exposure, auto_exposure, develop
from data_gen.sensors.camera.motion_blur import motion_blur
from data_gen.sensors.camera.rain import add_streaks
from data_gen.sensors.camera.rendering.reflections import mirror_image
from data_gen.sensors.camera.rendering.renderer import PinholeView, Renderer
from data_gen.sensors.camera.spray import add_spray
from data_gen.sensors.common.data import SensorData
from data_gen.sensors.common.event import CaptureEvent
from fusion_net.common.fault_effects import apply_mask

_SUBPIXEL = np.array([[1, 3], [3, -1], [-1, -3], [-3, 1]]) / 8
"""Offsets from a pixel's centre (right, down) of the extra rays of an edge pixel: a rotated grid."""
_EDGE_FRACTION = 0.07
"""At most this fraction of the pixels is looked at closer."""


@dataclass(frozen=True)
class CameraFrame(SensorData):
    """What a camera delivers. ``image`` is 8-bit sRGB; ``body`` (actor index, -1 world, -2 nothing) and ``depth`` (metres
    along z, inf where nothing) belong to the pixel's centre; ``aimed`` and ``reached`` as in ``scene.Hits``."""

    image: NDArray[np.uint8]  # (H, W, 3) RGB
    body: NDArray[np.int32]  # (H, W)
    depth: NDArray[np.float32]  # (H, W)
    aimed: NDArray[np.int64]  # (A,)
    reached: NDArray[np.int64]  # (A,)

    @property
    def ray_counts(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """``aimed`` and ``reached``."""
        return self.aimed, self.reached

    def with_faults(self, event: CaptureEvent[Any], stamp: int) -> "CameraFrame":
        """The image behind what covers the lens; body and depth, which are labels, stay."""
        return replace(self, image=apply_mask(self.image, event.faults.covered(*self.image.shape[:2])))


def sense(scene: Scene, event: CaptureEvent[Camera]) -> CameraFrame:
    """Exposes one frame. The event's ``rng`` feeds falling rain and the sensor's noise."""
    camera, t = event.mount, event.true_time
    renderer = Renderer(scene, PinholeView(camera.cam_K, scene.ego.pose(t) @ event.ego_T_sensor), t)
    light, rays, hits = _trace(renderer, camera)
    shape = camera.height, camera.width
    condition, view = scene.condition, renderer.view
    sun = glare.sun_on_lens(scene, view, renderer.light, t)
    veil = glare.veil(
        view, renderer.light, sun, renderer.lamps.points, hits.distance.reshape(shape), glare.straylight(condition)
    )
    exposure = auto_exposure(light if veil is None else light + veil)
    light = motion_blur(light, renderer, camera.cam_K, rays, hits, exposure.shutter)
    _weather_on_lens(light, renderer, sun, exposure, event)
    if veil is not None:
        light = light + veil
        glare.add_ghosts(light, view, renderer.light, sun)
    depth = hits.distance.reshape(shape) * _cosine(camera)
    return CameraFrame(develop(light, event.rng, exposure), hits.body.reshape(shape), depth, hits.aimed, hits.reached)


def render_luminance(scene: Scene, camera: Camera, *, t: float) -> tuple[NDArray[np.float32], Hits]:
    """The light (H, W, 3) in cd/m^2 that comes to the lens, and the hits of the pixels' centres, row by row."""
    view = PinholeView(camera.cam_K, scene.ego.pose(t) @ camera.ego_T_sensor)
    light, _, hits = _trace(Renderer(scene, view, t), camera)
    return light, hits


def _trace(renderer: Renderer, camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32], Hits]:
    """The light (H, W, 3), and the rays (H W, 3) through the pixels' centres with what they met."""
    scene, view, shape = renderer.scene, renderer.view, (camera.height, camera.width)
    centers = _centers(*shape)
    rays = view.rays(centers)
    hits, lit = renderer.cast(rays, counted=True)
    open_sky = _open_sky(renderer.cover(rays, hits).reshape(shape)).ravel()
    mirror = mirror_image(renderer, rays, hits, shape)
    linear = renderer.luminance(rays, hits, lit, open_sky, mirror, 1.0)
    tint = scene.surface.albedo[:, 1][hits.face]
    score = _edges(hits.body.reshape(shape), hits.distance, hits.normal, rays, lit, tint, linear)
    chosen = _most(score, _EDGE_FRACTION)
    rays_e = view.rays((centers[chosen, None] + _SUBPIXEL).reshape(-1, 2))
    hits_e, lit_e = renderer.cast(rays_e)
    sky_e = np.repeat(open_sky[chosen], len(_SUBPIXEL))
    mirror_e = np.repeat(mirror[chosen] if len(mirror) else mirror, len(_SUBPIXEL), axis=0)
    extra = renderer.luminance(rays_e, hits_e, lit_e, sky_e, mirror_e, 0.5).reshape(len(chosen), len(_SUBPIXEL), 3)
    linear[chosen] = (linear[chosen] + extra.sum(axis=1)) / (1 + len(_SUBPIXEL))
    if scene.condition.spray:
        add_spray(linear, renderer, plumes_at(scene, renderer.t), rays, hits.distance)
    return linear.reshape(*shape, 3), rays, hits


@lru_cache(maxsize=8)
def _centers(height: int, width: int) -> NDArray[np.float64]:
    """Pixel coordinates (H W, 2) of the pixels' centres, as (u, v)."""
    rows, columns = np.indices((height, width))
    return np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float) + 0.5


def _weather_on_lens(
    light: NDArray[np.float32],
    renderer: Renderer,
    sun: NDArray[np.float64],
    exposure: Exposure,
    event: CaptureEvent[Camera],
) -> None:
    """Rain before the lens, drops and dirt on it, drawn over the image (H, W, 3) in place."""
    scene, axes, shape = renderer.scene, renderer.view.axes, light.shape[:2]
    condition, velocity = scene.condition, scene.ego.at(renderer.t)[2]
    if condition.rain_rate > 0:
        add_streaks(
            light, event.mount.cam_K, axes.T @ velocity, -axes[2], rain_rate=condition.rain_rate, shutter=exposure.shutter,
            rng=event.rng,
        )  # fmt: skip
    if condition.rain_rate > 0 or condition.spray:
        rate = lens.drop_rate(condition, float(np.linalg.norm(velocity)))
        lens.add_drops(light, lens.drops_at(rate, renderer.t, event.lens_seed, shape=shape))
    if condition.dirt > 0:
        lens.add_dirt(light, lens.dirt_cover(condition.dirt, event.lens_seed, shape=shape), sun)


def _cosine(camera: Camera) -> NDArray[np.float32]:
    """(H, W): z of the unit ray through each pixel's centre in the camera frame."""
    K = camera.cam_K
    x = (np.arange(camera.width) + 0.5 - K[0, 2]) / K[0, 0]
    y = (np.arange(camera.height) + 0.5 - K[1, 2]) / K[1, 1]
    return (1 / np.sqrt(1 + x**2 + y[:, None] ** 2)).astype(np.float32)


def _open_sky(covered: NDArray[np.float32]) -> NDArray[np.float32]:
    """Fraction of the sky (H, W) that the ground sees: the mean over neighbours of which leaning rays got out. Away from any
    ground pixel, 1."""
    ground = np.isfinite(covered).astype(np.float32)
    size = (2 * (covered.shape[1] // 90) + 1, 2 * (covered.shape[1] // 120) + 1)
    total = cv2.boxFilter(ground, -1, size, borderType=cv2.BORDER_REPLICATE)
    blocked = cv2.boxFilter(np.nan_to_num(covered), -1, size, borderType=cv2.BORDER_REPLICATE)
    return (1 - 0.9 * blocked / np.maximum(total, 1e-3)).astype(np.float32)


def _most(score: NDArray[np.float32], fraction: float) -> NDArray[np.int64]:
    """Indices of the positive scores (N,), the highest ``fraction`` of all N at most: what bounds the time of a frame."""
    chosen = np.flatnonzero(score)
    limit = int(fraction * len(score))
    if len(chosen) <= limit:
        return chosen
    return np.sort(chosen[np.argpartition(-score[chosen], limit)[:limit]])


@jit
def _edges(body, distance, normal, rays, lit, tint, linear):
    """How much each pixel (N,) of body (H, W) would gain from a closer look: its contrast to the pixel on the right or below.

    0 unless the body or its colour changes there, the surface turns, a shadow ends or the point leaves the neighbour's plane
    by more than 2 % of the distance. Both sides of an edge score.
    """
    height, width = body.shape
    score = np.zeros(height * width, np.float32)
    mean = linear[:, 1].mean()
    for i in range(height):
        for j in range(width):
            for di, dj in ((0, 1), (1, 0)):
                if i + di >= height or j + dj >= width:
                    continue
                a, b = i * width + j, (i + di) * width + j + dj
                one, two = linear[a, 1], linear[b, 1]
                contrast = abs(one - two) / (one + two + 0.5 * mean)
                if contrast < 0.05:
                    continue
                differs = body[i, j] != body[i + di, j + dj] or lit[a] != lit[b]
                differs = differs or abs(tint[a] - tint[b]) > 0.02
                if not differs and body[i, j] >= -1:
                    alike, gap = 0.0, 0.0
                    for c in range(3):
                        alike += normal[a, c] * normal[b, c]
                        gap += normal[a, c] * (rays[b, c] * distance[b] - rays[a, c] * distance[a])
                    differs = alike < 0.9 or abs(gap) > 0.02 * distance[a]
                if differs:
                    score[a], score[b] = max(score[a], contrast), max(score[b], contrast)
    return score
