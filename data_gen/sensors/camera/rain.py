"""Streaks of rain: the drops that fall through the view while the shutter is open.

Only those that are wide enough to show are drawn; what the others do is the extinction of the air.
"""

import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.raindrops import N0, size_slope

LEAST_WIDTH = 0.2
"""Pixels: a drop of diameter D is drawn up to the depth where it is so wide, f D / LEAST_WIDTH."""
_FARTHEST = 15.0
_NEAREST = 0.3
"""Metres; nearer drops are too far out of focus to show."""
_MOST = 20_000
_WIND = 1.5
"""Standard deviation in m/s of a drop's sideways motion."""


def add_streaks(
    linear: NDArray[np.float32], cam_K: NDArray, velocity: NDArray, down: NDArray, *, rain_rate: float, shutter: float,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Draw rain of ``rain_rate`` mm/h over the image (H, W, 3), in place. ``velocity`` (3,) of the camera in m/s and the unit
    vector ``down`` (3,) in the camera frame.

    A drop hides each point of its streak for the fraction diameter / length of the exposure, and has the mean light of the
    surroundings, whatever is behind it (Garg and Nayar, 2007).
    """
    height, width = linear.shape[:2]
    diameter, at = visible_drops(height, width, cam_K, rain_rate, rng)
    fall = 9.65 - 10.3 * np.exp(-0.6 * diameter)  # terminal speed in m/s (Atlas)
    motion = fall[:, None] * down - velocity + rng.normal(0.0, _WIND, (len(at), 3)) * [1, 0.2, 1]
    ends = np.stack([at - 0.5 * shutter * motion, at + 0.5 * shutter * motion])
    ends[..., 2] = np.maximum(ends[..., 2], 0.1)
    f = cam_K[0, 0]
    pixel = np.stack(
        [ends[..., 0] / ends[..., 2] * f + cam_K[0, 2], ends[..., 1] / ends[..., 2] * f + cam_K[1, 2]], axis=-1
    )
    size = 1e-3 * diameter * f / at[:, 2]
    length = np.linalg.norm(pixel[1] - pixel[0], axis=1)
    cover = np.zeros((height, width), np.float32)
    _draw(pixel[0], pixel[1], size, size / (length + size), cover)
    light = linear.mean(axis=(0, 1)) * np.float32(0.5) + np.float32(0.5) * linear[: height // 3].mean(axis=(0, 1))
    linear += cover[..., None] * (light - linear)


def visible_drops(height, width, cam_K, rain_rate, rng):
    """Diameters (N,) in mm and places (N, 3) in the camera frame of the drops to draw.

    Up to the depth f D / LEAST_WIDTH the view holds a volume in proportion to D^3, so those D follow a gamma distribution.
    """
    slope = size_slope(rain_rate)
    f = cam_K[0, 0]
    reach = 1e-3 * f / LEAST_WIDTH  # metres a millimetre of diameter
    solid = width * height / f**2
    expected = N0 * solid / 3 * reach**3 * 6 / slope**4
    count = min(int(rng.poisson(expected)), _MOST)
    diameter = np.minimum(rng.gamma(4.0, 1 / slope, count), 6.0)
    depth = reach * diameter * rng.random(count) ** (1 / 3)
    u, v = rng.random(count) * width, rng.random(count) * height
    kept = (depth > _NEAREST) & (depth < _FARTHEST)
    at = np.stack([(u - cam_K[0, 2]) / f * depth, (v - cam_K[1, 2]) / f * depth, depth], axis=1)
    return diameter[kept], at[kept]


@jit
def _draw(start, end, size, alpha, cover):
    """Lines from ``start`` to ``end`` (N, 2) of width ``size`` (N,) pixels laid over each other in ``cover`` (H, W)."""
    height, width = cover.shape
    for k in range(len(size)):
        ax, ay = start[k, 0] - 0.5, start[k, 1] - 0.5
        bx, by = end[k, 0] - ax - 0.5, end[k, 1] - ay - 0.5
        square = max(bx * bx + by * by, 1e-6)
        wide = max(size[k], 1.0)
        thin = min(size[k], 1.0) * alpha[k]
        reach = 0.5 * wide + 0.5
        left, right = int(max(min(ax, ax + bx) - reach, 0.0)), int(min(max(ax, ax + bx) + reach + 1, width - 1.0))
        top, bottom = int(max(min(ay, ay + by) - reach, 0.0)), int(min(max(ay, ay + by) + reach + 1, height - 1.0))
        for i in range(top, bottom + 1):
            for j in range(left, right + 1):
                s = min(max(((j - ax) * bx + (i - ay) * by) / square, 0.0), 1.0)
                off = np.sqrt((j - ax - s * bx) ** 2 + (i - ay - s * by) ** 2)
                a = thin * min(max(reach - off, 0.0), 1.0)
                cover[i, j] = 1 - (1 - cover[i, j]) * (1 - a)
