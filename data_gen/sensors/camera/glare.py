"""Light that strays: in the lens around the sun and lamps, and in hazy air around lamps.

Lens: the veil of Stiles and Holladay, L = 10 E / angle^2 with E lux on the lens and the angle in degrees (CIE 146), scaled by
how much worse or better than an eye the lens is. Air: single scattering along each ray up to what it meets.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.conditions import KOSCHMIEDER, Condition
from data_gen.scene.light import Light
from data_gen.scene.luminaires import Luminaires
from data_gen.scene.scene import Scene
from data_gen.sensors.camera.lens import REFERENCE_WIDTH, stamp
from data_gen.sensors.camera.rendering.lamps import sent
from data_gen.sensors.camera.rendering.renderer import MAX_RANGE, PinholeView

CLEAN = 0.2
"""Fraction of the eye's veil in a clean lens; a dirty or wet one comes up to 1."""
_COARSE = 4
"""Pixels of the image a cell of the grid on which the veil is worked out."""
_HAZE = 3_000.0
"""Metres of visibility below which lamps have a halo."""
_GHOSTS = ((-0.5, 26.0, (0.6, 1.0, 0.5)), (-1.0, 60.0, (0.5, 0.6, 1.0)), (0.3, 14.0, (1.0, 0.7, 0.5)))
"""Flare: place on the line from the image centre to the sun, radius in pixels of an image 1,600 wide, tint."""
_GHOST_LUMINANCE = 0.012
"""cd/m^2 a lux of sunlight on the lens."""


def straylight(condition: Condition) -> float:
    """The lens' veil as a fraction of the eye's: 0.2 clean, up to 1 dirty or wet."""
    wet = 0.25 if condition.rain_rate > 0 or condition.spray else 0.0
    return min(CLEAN + wet + 8.0 * condition.dirt, 1.0)


def sun_on_lens(scene: Scene, view: PinholeView, light: Light, t: float) -> NDArray[np.float64]:
    """Sunlight (3,) in lux on the lens: none if it comes from behind, is hidden or has set. Five rays over the disc."""
    facing = float(light.sun_direction @ view.forward)
    if facing <= 0.05 or not light.sun.any():
        return np.zeros(3)
    spread = np.radians(0.2) * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    across = np.cross(light.sun_direction, view.forward)
    across /= np.linalg.norm(across) + 1e-9
    rays = light.sun_direction + spread @ [across, np.cross(across, light.sun_direction)]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return light.sun * facing * float(1 - scene.occluded(view.origin, rays, t, MAX_RANGE).mean())


def veil(
    view: PinholeView,
    light: Light,
    sun: NDArray[np.float64],
    points: Luminaires,
    distance: NDArray[np.float32],
    scatter: float,
) -> NDArray[np.float32] | None:
    """Stray light (H, W, 3) in cd/m^2, None if there is none. ``sun`` from :func:`sun_on_lens`, ``points`` the lamps in sight,
    ``distance`` (H, W) of what each pixel shows, ``scatter`` from :func:`straylight`."""
    if not (sun.any() or len(points.position)):
        return None
    height, width = distance.shape
    rows, columns = -(-height // _COARSE), -(-width // _COARSE)
    v, u = (np.arange(rows) + 0.5) * height / rows, (np.arange(columns) + 0.5) * width / columns
    rays = view.rays(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    ends = distance[v.astype(int)][:, u.astype(int)].ravel()
    out = np.zeros((rows * columns, 3), np.float32)
    if sun.any():
        _sun_veil(rays, light.sun_direction, 10 * scatter * sun, out)
    air = light.extinction if light.extinction > KOSCHMIEDER / _HAZE else 0.0
    _lamp_veil(rays, ends, view.origin, points, 10 * scatter, air, light.extinction, out)
    fine = cv2.resize(out.reshape(rows, columns, 3), (width, height), interpolation=cv2.INTER_LINEAR)
    return fine.astype(np.float32, copy=False)


@jit
def _sun_veil(rays, towards, strength, out):
    for i in range(len(rays)):
        cosine = rays[i, 0] * towards[0] + rays[i, 1] * towards[1] + rays[i, 2] * towards[2]
        angle = np.degrees(np.arccos(min(max(cosine, -1.0), 1.0)))
        for c in range(3):
            out[i, c] += strength[c] / (angle * angle + 1.0)


@jit
def _lamp_veil(rays, ends, eye, points, strength, air, extinction, out):
    """A lamp of I candela at distance d, a metres along a ray and h beside it: in the lens 10 E / angle^2, in the air
    extinction phase I / h (atan((end - a) / h) + atan(a / h)), with the phase of fog, 2 / 4 pi near the forward direction."""
    position, axis, flux = points
    for j in range(len(position)):
        x, y, z = position[j, 0] - eye[0], position[j, 1] - eye[1], position[j, 2] - eye[2]
        d = np.sqrt(x * x + y * y + z * z)
        x, y, z = x / d, y / d, z / d
        candela = sent(-x, -y, -z, axis[j]) * np.exp(-extinction * d)
        lens = strength * candela / (d * d)
        for i in range(len(rays)):
            cosine = min(rays[i, 0] * x + rays[i, 1] * y + rays[i, 2] * z, 1.0)
            if cosine < 0.8:
                continue
            square = 2 * (1 - cosine) * 3283.0  # degrees^2
            value = lens / (square + 0.25)
            if air > 0:
                a, h = d * cosine, d * np.sqrt(max(1 - cosine * cosine, 1e-5))
                end = min(ends[i], 2 * d)
                value += air * candela * 2 / (4 * np.pi) / h * (np.arctan((end - a) / h) + np.arctan(a / h))
            for c in range(3):
                out[i, c] += flux[j, c] * value


def add_ghosts(linear: NDArray[np.float32], view: PinholeView, light: Light, sun: NDArray[np.float64]) -> None:
    """Draw the flare of a sun in or near the image (H, W, 3), in place."""
    height, width = linear.shape[:2]
    depth = float(light.sun_direction @ view.forward)
    if not sun.any() or depth <= 0:
        return
    middle = np.array([width, height]) / 2
    place = np.array(
        [
            view.right @ light.sun_direction / (view.right @ view.right),
            view.down @ light.sun_direction / (view.down @ view.down),
        ]
    )
    offset = place / depth + view.principal - middle
    fade = 1 - (np.abs(offset) / (0.75 * width)).max()
    if fade <= 0:
        return
    for along, radius, tint in _GHOSTS:
        disc = np.zeros((height, width), np.float32)
        stamp(disc, (middle + along * offset)[None], np.array([radius * width / REFERENCE_WIDTH]), np.ones(1), 0.3)
        linear += disc[..., None] * (_GHOST_LUMINANCE * fade * sun * tint).astype(np.float32)
