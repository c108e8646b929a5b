"""The light that arrives along rays: rays are cast, shadow rays follow, colours and lamps are looked up, kernels add up."""

import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.light import light_of, sky
from data_gen.scene.motion import motion_at
from data_gen.scene.noise import GOLDEN
from data_gen.scene.scene import WORLD, Hits, Scene
from data_gen.sensors.camera.rendering import shading, textures, wet_road
from data_gen.sensors.camera.rendering.lamps import lamps_of
from data_gen.world.ground import ground_table

MAX_RANGE = 400.0
"""Metres that camera rays travel; beyond lies the skyline."""
SHADOW_RANGE = 120.0
COVER_HEIGHT = 2.2
"""Metres above the ground within which a body keeps the sky's light from it."""
_TOWN_GLOW = 0.35
"""Fraction of a town's light that comes from anywhere, where street lamps give the rest."""
_MATERIAL_ALBEDO, _MATERIAL_TEXTURE, _ = ground_table()


class PinholeView:
    """A pinhole camera at one time and place: turns pixel coordinates into unit rays of the global frame."""

    def __init__(self, cam_K: NDArray, global_T_cam: NDArray) -> None:
        self.axes = axes = np.ascontiguousarray(global_T_cam[:3, :3])
        self.origin = global_T_cam[:3, 3].copy()
        self.forward = axes[:, 2].copy()
        self.right, self.down = axes[:, 0] / cam_K[0, 0], axes[:, 1] / cam_K[1, 1]
        self.principal = cam_K[:2, 2]
        self.pixel = 1 / cam_K[0, 0]  # rad a pixel on the axis

    def rays(self, pixels: NDArray) -> NDArray[np.float32]:
        """(N, 3) through pixel coordinates (N, 2) as (u, v)."""
        return _rays(pixels, self.principal, self.forward, self.right, self.down)


@jit
def _rays(pixels, principal, forward, right, down):
    out = np.empty((len(pixels), 3), np.float32)
    for i in range(len(pixels)):
        u, v = pixels[i, 0] - principal[0], pixels[i, 1] - principal[1]
        x = forward[0] + u * right[0] + v * down[0]
        y = forward[1] + u * right[1] + v * down[1]
        z = forward[2] + u * right[2] + v * down[2]
        scale = 1 / np.sqrt(x * x + y * y + z * z)
        out[i, 0], out[i, 1], out[i, 2] = x * scale, y * scale, z * scale
    return out


class Renderer:
    """One scene seen through one view at one time."""

    def __init__(self, scene: Scene, view: PinholeView, t: float) -> None:
        self.scene, self.view, self.t = scene, view, t
        self.motion = motion_at(scene, t)
        self.lamps = lamps_of(scene, self.motion, view.origin, t)
        self.light = light_of(scene.condition, scene.name)
        if len(self.lamps.street.position):
            self.light = self.light._replace(street=self.light.street * _TOWN_GLOW)
        self.is_wet = scene.wetness.is_wet

    def cast(self, rays: NDArray[np.float32], *, counted: bool = False) -> tuple[Hits, NDArray[np.float32]]:
        """What the rays (N, 3) meet, and which hits the sun reaches: 1, or 0 in shadow or turned away. ``counted`` as in
        ``Scene.cast``."""
        hits = self.scene.cast(self.view.origin, rays, self.t, MAX_RANGE, counted=counted)
        return hits, self.sunlit(_reach(self.view.origin, rays, hits.distance), hits)

    def sunlit(self, at: NDArray[np.float32], hits: Hits) -> NDArray[np.float32]:
        """Which hits ``at`` global points (N, 3) the sun reaches."""
        lit = np.zeros(len(at), np.float32)
        if self.light.sun.any():
            sun = self.light.sun_direction.astype(np.float32)
            asked = np.flatnonzero((hits.body >= WORLD) & (hits.normal @ sun > 0))
            origins = _lifted(at, hits.distance, hits.normal, asked)
            towards = np.broadcast_to(sun, origins.shape)
            lit[asked] = ~self.scene.occluded(origins, towards, self.t, SHADOW_RANGE)
        return lit

    def cover(self, rays: NDArray[np.float32], hits: Hits) -> NDArray[np.float32]:
        """Whether something hangs over each hit on the ground, along a ray that leans a different way from pixel to pixel,
        so that a mean over neighbours is soft: 1 covered, 0 open, NaN where the hit is not ground or not asked: every other
        ray is."""
        covered = np.full(len(rays), np.nan, np.float32)
        asked = np.flatnonzero(self.on_ground(hits)[::2]) * 2
        turn = asked * 2.399963  # golden angle
        lean = 0.75 * np.sqrt((asked * GOLDEN) % 1.0)
        towards = np.stack([lean * np.cos(turn), lean * np.sin(turn), np.sqrt(1 - lean**2)], axis=1).astype(np.float32)
        origins = self.lifted(rays, hits, asked)
        covered[asked] = self.scene.occluded(origins, towards, self.t, COVER_HEIGHT)
        return covered

    def lifted(self, rays: NDArray[np.float32], hits: Hits, chosen: NDArray[np.int64]) -> NDArray[np.float32]:
        """Places (K, 3) of the ``chosen`` hits, off their faces, so that a ray from there does not meet its own."""
        return _lifted(_reach(self.view.origin, rays, hits.distance), hits.distance, hits.normal, chosen)

    def on_ground(self, hits: Hits) -> NDArray[np.bool_]:
        """Which hits (N,) are on the ground."""
        return (hits.body == WORLD) & (hits.face < self.scene.ground_faces)

    def luminance(
        self,
        rays: NDArray[np.float32],
        hits: Hits,
        lit: NDArray[np.float32],
        open_sky: NDArray[np.float32],
        mirror: NDArray[np.float32],
        span: float,
    ) -> NDArray[np.float32]:
        """Luminance (N, 3) in cd/m^2 along the rays. ``open_sky`` (N,) fraction of the sky that the ground sees there;
        ``mirror`` as from ``reflections.mirror_image``; ``span`` the part of a pixel that a ray stands for."""
        colors = self.paint(rays, hits, span)
        if self.is_wet:
            wet_road.soak(self.scene, hits, np.flatnonzero(self.on_ground(hits)), colors)
        at = _reach(self.view.origin, rays, hits.distance)
        out = self.shade(at, rays, hits, colors, lit, open_sky, mirror)
        empty = np.flatnonzero(hits.body < WORLD)
        out[empty] = sky(rays[empty], self.light, self.view.pixel * span)
        return out

    def paint(self, rays: NDArray[np.float32], hits: Hits, span: float) -> NDArray[np.float32]:
        """Colours (N, 5) of ``textures.paint``."""
        view, surface, ground = self.view, self.scene.surface, self.scene.ground
        return textures.paint(
            np.stack([view.origin, view.forward, view.right, view.down]), rays, view.pixel, span, _fields(hits),
            (surface.albedo, surface.texture, surface.specular, surface.emission),
            (self.scene.ground_faces, ground.material, ground.cover, ground.tone, np.asarray(ground.origin, float),
             float(ground.resolution), _MATERIAL_ALBEDO, _MATERIAL_TEXTURE),
            self.motion.yaw, self.light.night,
        )  # fmt: skip

    def shade(self, at, rays, hits: Hits, colors, lit, open_sky, mirror) -> NDArray[np.float32]:
        """Luminance (N, 3) of hits ``at`` global points (N, 3), 0 where nothing was met; as :func:`shading.shade`."""
        out = np.zeros((len(rays), 3), np.float32)
        shading.shade(
            at, rays, _fields(hits), colors, lit, open_sky, mirror, self.scene.ground_faces, self.light, self.lamps, out
        )
        return out


def _fields(hits: Hits) -> tuple:
    return hits.body, hits.face, hits.distance, hits.local, hits.normal


@jit
def _reach(origin, rays, distance):
    out = np.empty((len(rays), 3), np.float32)
    for i in range(len(rays)):
        for c in range(3):
            out[i, c] = origin[c] + rays[i, c] * distance[i]
    return out


@jit
def _lifted(at, distance, normal, chosen):
    out = np.empty((len(chosen), 3), np.float32)
    for k in range(len(chosen)):
        i = chosen[k]
        for c in range(3):
            out[k, c] = at[i, c] + normal[i, c] * (0.01 + 2e-4 * distance[i])
    return out
