"""The light that arrives along rays: rays are cast, shadow rays follow, colours and lamps are looked up, kernels add up."""

import numpy as np
from numpy.typing import NDArray

from data_gen.ground import ground_table
from data_gen.jit import jit
from data_gen.scene import WORLD, Hits, Scene
from data_gen.sensors.shading import shade
from data_gen.sensors.sky import light_of, sky
from data_gen.sensors.textures import paint

MAX_RANGE = 400.0
"""Metres that camera rays travel; beyond lies the skyline."""
SHADOW_RANGE = 120.0
COVER_HEIGHT = 2.2
"""Metres above the ground within which a body keeps the sky's light from it."""
LOW_BEAM = 15_000.0
"""Candela of one head-lamp."""
_LAMP_REACH = 90.0
_LAMP_MOUNT = 0.65
"""Height of head-lamps in metres; half their spacing."""
_EGO_LAMP_X = 3.6
_GROUND_ALBEDO, _GROUND_KIND, _ = ground_table()


class View:
    """A pinhole camera at one time and place: turns pixel coordinates into unit rays of the global frame."""

    def __init__(self, cam_K: NDArray, global_T_cam: NDArray) -> None:
        axes = global_T_cam[:3, :3]
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

    def __init__(self, scene: Scene, view: View, t: float) -> None:
        self.scene, self.view, self.t = scene, view, t
        self.light = light_of(scene.condition, scene.name)
        self.lamps = _lamps(scene, view.origin, t) if self.light.night else np.zeros((0, 6))
        self.yaw = np.array([actor.track.at(t)[1] for actor in scene.actors], float).reshape(-1)

    def cast(self, rays: NDArray[np.float32]) -> tuple[Hits, NDArray[np.float32]]:
        """What the rays (N, 3) meet, and which hits the sun reaches: 1, or 0 in shadow or turned away."""
        hits = self.scene.cast(self.view.origin, rays, self.t, MAX_RANGE)
        lit = np.zeros(len(rays), np.float32)
        if self.light.sun.any():
            sun = self.light.sun_direction.astype(np.float32)
            asked = np.flatnonzero((hits.body >= WORLD) & (hits.normal @ sun > 0))
            origins = self._above(rays, hits, asked)
            towards = np.broadcast_to(sun, origins.shape)
            lit[asked] = ~self.scene.occluded(origins, towards, self.t, SHADOW_RANGE)
        return hits, lit

    def cover(self, rays: NDArray[np.float32], hits: Hits) -> NDArray[np.float32]:
        """Whether something hangs over each hit on the ground, along a ray that leans a different way from pixel to pixel,
        so that a mean over neighbours is soft: 1 covered, 0 open, NaN where the hit is not ground or not asked: every other
        ray is."""
        covered = np.full(len(rays), np.nan, np.float32)
        asked = np.flatnonzero(self.on_ground(hits)[::2]) * 2
        turn = asked * 2.399963  # golden angle
        lean = 0.75 * np.sqrt((asked * 0.618034) % 1.0)
        towards = np.stack([lean * np.cos(turn), lean * np.sin(turn), np.sqrt(1 - lean**2)], axis=1).astype(np.float32)
        covered[asked] = self.scene.occluded(self._above(rays, hits, asked), towards, self.t, COVER_HEIGHT)
        return covered

    def on_ground(self, hits: Hits) -> NDArray[np.bool_]:
        """Which hits (N,) are on the ground."""
        return (hits.body == WORLD) & (hits.face < self.scene.ground_faces)

    def luminance(
        self,
        rays: NDArray[np.float32],
        hits: Hits,
        lit: NDArray[np.float32],
        open_sky: NDArray[np.float32],
        span: float,
    ) -> NDArray[np.float32]:
        """Luminance (N, 3) in cd/m^2 along the rays. ``open_sky`` (N,) share of the sky that the ground sees there; ``span``
        the part of a pixel that a ray stands for."""
        scene, view, surface, ground = self.scene, self.view, self.scene.surface, self.scene.ground
        hit = (hits.body, hits.face, hits.distance, hits.local, hits.normal)
        colors = paint(
            np.stack([view.origin, view.forward, view.right, view.down]), rays, view.pixel, span, hit,
            (surface.albedo, surface.texture, surface.specular, surface.emission),
            (scene.ground_faces, ground.material, np.asarray(ground.origin, float), float(ground.resolution),
             _GROUND_ALBEDO, _GROUND_KIND),
            self.yaw, self.light.night,
        )  # fmt: skip
        out = np.zeros((len(rays), 3), np.float32)
        shade(view.origin, rays, hit, colors, lit, open_sky, scene.ground_faces, self.light, self.lamps, out)
        empty = np.flatnonzero(hits.body < WORLD)
        out[empty] = sky(rays[empty], self.light, view.pixel * span)
        return out

    def _above(self, rays, hits, chosen):
        """Hit points lifted off their faces, so that a ray from there does not meet its own face."""
        return _lifted(self.view.origin, rays, hits.distance, hits.normal, chosen)


@jit
def _lifted(origin, rays, distance, normal, chosen):
    out = np.empty((len(chosen), 3), np.float32)
    for k in range(len(chosen)):
        i = chosen[k]
        for c in range(3):
            out[k, c] = origin[c] + rays[i, c] * distance[i] + normal[i, c] * (0.01 + 2e-4 * distance[i])
    return out


def _lamps(scene: Scene, eye: NDArray, t: float) -> NDArray[np.float64]:
    """Low beams (L, 6) of the ego and of vehicles around: position, direction (cos, sin of yaw), candela."""
    lamps = []
    ego = scene.ego.pose(t)
    for side in (_LAMP_MOUNT, -_LAMP_MOUNT):
        place = ego[:3, :3] @ [_EGO_LAMP_X, side, _LAMP_MOUNT] + ego[:3, 3]
        lamps.append((*place, ego[0, 0], ego[1, 0], LOW_BEAM))
    for actor in scene.actors:
        if not actor.asset.category.startswith("vehicle.") or actor.attribute.endswith(("parked", "without_rider")):
            continue
        position, yaw, _ = actor.track.at(t)
        if np.hypot(*(position - eye)[:2]) < _LAMP_REACH:
            nose = actor.asset.size[0] / 2 + 0.05
            c, s = np.cos(yaw), np.sin(yaw)
            lamps.append(
                (position[0] + nose * c, position[1] + nose * s, position[2] + _LAMP_MOUNT, c, s, 2 * LOW_BEAM)
            )
    return np.array(lamps)
