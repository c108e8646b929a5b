"""Motion blur: what moves on the sensor while the shutter is open is smeared along its way."""

import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.scene import Hits
from data_gen.sensors.camera.rendering.renderer import Renderer

LEAST_FLOW = 0.5
"""Pixels of motion under which nothing is smeared."""
_MOST_TAPS = 9
_STEP = 0.02
"""Seconds to either side over which the ego's turn is taken."""


def motion_blur(
    linear: NDArray[np.float32],
    renderer: Renderer,
    cam_K: NDArray,
    rays: NDArray[np.float32],
    hits: Hits,
    shutter: float,
) -> NDArray[np.float32]:
    """The image (H, W, 3) smeared along each pixel's flow during ``shutter`` s: that of the surface in it, by the motion of its
    body and of the camera. The same array where nothing moves by half a pixel."""
    height, width = linear.shape[:2]
    view, body = renderer.view, renderer.motion
    motion = (body.position, body.velocity, body.yaw_rate, view.origin, *_own_motion(renderer))
    geometry = (rays, hits.distance, hits.body, view.axes, cam_K, motion)
    coarse = (np.arange(0, height, 4)[:, None] * width + np.arange(0, width, 4)).ravel()
    if np.abs(_flow(coarse, shutter, *geometry)).max() < LEAST_FLOW:
        return linear
    flow = _flow(np.arange(height * width), shutter, *geometry).reshape(height, width, 2)
    out = np.empty_like(linear)
    _blur_along(np.ascontiguousarray(linear), flow, out)
    return out


def _own_motion(renderer: Renderer) -> tuple[NDArray, float]:
    """Velocity (3,) of the camera and yaw rate of the ego in the global frame."""
    position, yaw, velocity = renderer.scene.ego.at(renderer.t + np.array([-_STEP, 0.0, _STEP]))
    rate = float(yaw[2] - yaw[0]) / (2 * _STEP)
    x, y, _ = renderer.view.origin - position[1]
    return velocity[1] + rate * np.array([-y, x, 0.0]), rate


@jit
def _flow(pixels, shutter, rays, distance, body, axes, cam_K, motion):
    """Motion (K, 2) in pixels, right and down, of what the ``pixels`` (K,) show."""
    center, velocity, spin, eye, eye_velocity, eye_spin = motion
    out = np.empty((len(pixels), 2), np.float32)
    v = np.empty(3)
    for k in range(len(pixels)):
        i = pixels[k]
        far = not np.isfinite(distance[i])
        d = 1e6 if far else np.float64(distance[i])
        x, y, z = rays[i, 0] * d, rays[i, 1] * d, rays[i, 2] * d
        v[0], v[1], v[2] = eye_spin * y, -eye_spin * x, 0.0  # the camera's own turn, seen from the camera
        if not far:
            b = body[i]
            px, py = eye[0] + x - center[b, 0], eye[1] + y - center[b, 1]
            v[0] += velocity[b, 0] - spin[b] * py - eye_velocity[0]
            v[1] += velocity[b, 1] + spin[b] * px - eye_velocity[1]
            v[2] += velocity[b, 2] - eye_velocity[2]
        depth = x * axes[0, 2] + y * axes[1, 2] + z * axes[2, 2]
        along = v[0] * axes[0, 2] + v[1] * axes[1, 2] + v[2] * axes[2, 2]
        for c in range(2):
            at = x * axes[0, c] + y * axes[1, c] + z * axes[2, c]
            across = v[0] * axes[0, c] + v[1] * axes[1, c] + v[2] * axes[2, c]
            out[k, c] = shutter * cam_K[c, c] * (across - at / depth * along) / depth
    return out


@jit
def _blur_along(image, flow, out):
    """Means over taps along the flow, centred on each pixel, between the nearest pixels of the way."""
    height, width, channels = image.shape
    for i in range(height):
        for j in range(width):
            u, v = flow[i, j, 0], flow[i, j, 1]
            length = max(abs(u), abs(v))
            taps = 0 if length < LEAST_FLOW else min(int(length) + 2, _MOST_TAPS)
            for c in range(channels):
                out[i, j, c] = 0.0 if taps else image[i, j, c]
            for k in range(taps):
                s = (k + 0.5) / taps - 0.5
                y, x = min(max(i + s * v, 0.0), height - 1.001), min(max(j + s * u, 0.0), width - 1.001)
                row, column = int(y), int(x)
                a, b = y - row, x - column
                for c in range(channels):
                    upper = image[row, column, c] * (1 - b) + image[row, column + 1, c] * b
                    lower = image[row + 1, column, c] * (1 - b) + image[row + 1, column + 1, c] * b
                    out[i, j, c] += (upper * (1 - a) + lower * a) / taps
