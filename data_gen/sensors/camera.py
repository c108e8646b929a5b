"""The camera: one ray through every pixel's centre, more where the picture has edges, light, lens, sensor.

The class image and the depth come from the centre rays alone; the picture's edges average five rays in linear light.
"""

from typing import NamedTuple

import cv2
import numpy as np
from dataclasses import dataclass
from numpy.typing import NDArray

from data_gen.ground import ground_table
from data_gen.rig import Camera
from data_gen.scene import NOTHING, WORLD, Hits, Scene
from data_gen.sensors.imaging import develop
from data_gen.sensors.noise import jit
from data_gen.sensors.shading import shade
from data_gen.sensors.sky import Light, light_of, sky
from data_gen.sensors.textures import paint

MAX_RANGE = 400.0
"""Metres that camera rays travel; beyond lies the skyline."""
SHADOW_RANGE = 120.0
_SUBPIXEL = np.array([[1, 3], [3, -1], [-1, -3], [-3, 1]]) / 8
"""Offsets from a pixel's centre (right, down) of the extra rays of an edge pixel: a rotated grid."""
_COVER_HEIGHT = 2.2
"""Metres above the ground within which a body keeps the sky's light from it."""
LOW_BEAM = 15_000.0
"""Candela of one head-lamp."""


@dataclass(frozen=True)
class CameraFrame:
    """What a camera delivers. ``image`` is 8-bit sRGB; ``body`` (actor index, -1 world, -2 nothing) and ``depth`` (metres
    along z, inf where nothing) belong to the pixel's centre; ``aimed`` and ``reached`` as in ``scene.Hits``."""

    image: NDArray[np.uint8]  # (H, W, 3)
    body: NDArray[np.int32]  # (H, W)
    depth: NDArray[np.float32]  # (H, W)
    aimed: NDArray[np.int64]  # (A,)
    reached: NDArray[np.int64]  # (A,)


class _View(NamedTuple):
    """A camera at one time: what turns pixels into rays."""

    origin: NDArray[np.float32]  # (3,) global
    forward: NDArray[np.float64]  # (3,) global, unit
    right: NDArray[np.float64]  # (3,) change of a ray of depth one per pixel to the right
    down: NDArray[np.float64]  # (3,) ... per pixel down
    principal: tuple[float, float]

    def rays(self, u: NDArray, v: NDArray) -> NDArray[np.float32]:
        """Unit global directions (N, 3) through pixel coordinates (N,)."""
        across, along = u - self.principal[0], v - self.principal[1]
        rays = self.forward + across[:, None] * self.right + along[:, None] * self.down
        return (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)


def _view(camera: Camera, global_T_cam: NDArray) -> _View:
    K, axes = camera.cam_K, global_T_cam[:3, :3]
    right, down, forward = axes[:, 0] / K[0, 0], axes[:, 1] / K[1, 1], axes[:, 2]
    return _View(global_T_cam[:3, 3].astype(np.float32), forward, right, down, (K[0, 2], K[1, 2]))


def render_camera(
    scene: Scene, camera: Camera, *, ego_T_sensor: NDArray | None = None, t: float, rng: np.random.Generator,
) -> CameraFrame:
    """Expose one frame at time ``t`` (s). ``ego_T_sensor`` (4, 4) replaces the nominal mount, for a camera that was knocked.

    ``rng`` feeds the sensor's noise alone: the same generator state gives the same bytes.
    """
    view = _view(camera, scene.ego.pose(t) @ (camera.ego_T_sensor if ego_T_sensor is None else ego_T_sensor))
    height, width = camera.height, camera.width
    rows, columns = (grid.ravel() for grid in np.indices((height, width)))
    light = light_of(scene.condition, scene.name)
    rays = view.rays(columns + 0.5, rows + 0.5)
    hits = scene.cast(view.origin, rays, t, MAX_RANGE)
    open_sky = _open_sky(scene, view, rays, hits, t, (height, width))
    lit = _lit(scene, view, rays, hits, t, light)
    linear = _luminance(scene, view, rays, hits, t, light, lit, open_sky, 1.0)

    edges = _edges(hits.body, hits.distance, hits.normal, rays, lit, _material(scene, hits), height, width)
    chosen = np.flatnonzero(edges)
    if len(chosen):
        parent = np.repeat(chosen, len(_SUBPIXEL))
        offsets = np.tile(_SUBPIXEL, (len(chosen), 1)) + 0.5
        rays_e = view.rays(columns[parent] + offsets[:, 0], rows[parent] + offsets[:, 1])
        hits_e = scene.cast(view.origin, rays_e, t, MAX_RANGE)
        lit_e = _lit(scene, view, rays_e, hits_e, t, light)
        extra = _luminance(scene, view, rays_e, hits_e, t, light, lit_e, open_sky[parent], 0.5)
        total = linear[chosen] + extra.reshape(len(chosen), len(_SUBPIXEL), 3).sum(axis=1)
        linear[chosen] = total / (1 + len(_SUBPIXEL))

    depth = (hits.distance * (rays @ view.forward.astype(np.float32))).reshape(height, width)
    image = develop(linear.reshape(height, width, 3), rng)
    return CameraFrame(image, hits.body.reshape(height, width), depth, hits.aimed, hits.reached)
