"""What sits on a camera's lens: drops of rain that come, slide and go, and dried dirt that stays.

Both are functions of the lens' own seed and of the time: consecutive frames of a camera show the same drops.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.conditions import Condition
from fusion_net.common.random import stream

LIFETIME = 6.0
"""Mean seconds that a drop stays on the lens."""
_WINDOW = 4.0
"""Drops are sampled by windows of so many seconds, and looked for so many windows back."""
_WINDOWS = 6
REFERENCE_WIDTH = 1600
"""Pixels of nuScenes' image width: sizes on the lens and on the sensor are given for it and scale with the image."""
_RADIUS = (4.0, 30.0)
_BLOTCH = (18.0, 60.0)
"""Pixels of an image REFERENCE_WIDTH wide."""
_MINIFIED = 0.3
"""Size of the picture in a drop, as a fraction of the picture around it."""
_DIRT_OPACITY = (0.35, 0.85)


def drop_rate(condition: Condition, speed: float) -> float:
    """Drops that land and stay on a lens, a second: with the rain and with how fast the car drives into it, and from spray."""
    rain = condition.rain_rate**0.7 * (1 + speed / 15.0) if condition.rain_rate > 0 else 0.0
    return min((2.0 + rain if rain or condition.spray else 0.0), 24.0) / LIFETIME * 2.0


def drops_at(rate: float, t: float, lens_seed: int, *, shape: tuple[int, int]) -> NDArray[np.float64]:
    """The drops (N, 4) on the lens at ``t``: place (right, down) and radius in pixels of an image of ``shape``, and an angle
    that stands for their outline. Births are a Poisson process of ``rate`` a second; a drop slides down slowly and is gone
    after a lifetime."""
    height, width = shape
    last = int(np.floor(t / _WINDOW))
    windows = [_born(rate, window, lens_seed) for window in range(last - _WINDOWS, last + 1)]
    birth, life, u, v, size, slide, outline = np.concatenate(windows).T
    age = t - birth
    there = (age >= 0) & (age < life)
    radius = (_RADIUS[0] + (_RADIUS[1] - _RADIUS[0]) * size**2) * width / REFERENCE_WIDTH
    down = v * height + slide * age * radius
    return np.stack([u * width, down, radius, outline], axis=1)[there]


def _born(rate: float, window: int, lens_seed: int) -> NDArray[np.float64]:
    rng = stream(lens_seed, "drops", window)
    count = int(rng.poisson(rate * _WINDOW))
    table = rng.random((count, 7))
    table[:, 0] = _WINDOW * (window + table[:, 0])
    table[:, 1] = np.minimum(-LIFETIME * np.log1p(-table[:, 1]), _WINDOW * _WINDOWS)
    table[:, 5] = np.where(table[:, 5] > 0.7, table[:, 5] - 0.7, 0.0)  # most stick
    table[:, 6] *= 2 * np.pi
    return table


def add_drops(linear: NDArray[np.float32], drops: NDArray[np.float64]) -> None:
    """Show the image (H, W, 3) through the drops, in place: each holds the picture upside down, small and soft."""
    if not len(drops):
        return
    height, width = linear.shape[:2]
    small = cv2.resize(linear, (max(width // 4, 2), max(height // 4, 2)), interpolation=cv2.INTER_AREA)
    _refract(drops, cv2.blur(small, (3, 3)), linear)


@jit
def _refract(drops, small, image):
    height, width, channels = image.shape
    rows, columns = small.shape[0], small.shape[1]
    for k in range(len(drops)):
        x, y, radius, outline = drops[k]
        reach = 1.3 * radius + 0.5
        for i in range(int(max(y - reach, 0.0)), int(min(y + reach + 1, height))):
            for j in range(int(max(x - reach, 0.0)), int(min(x + reach + 1, width))):
                dx, dy = j + 0.5 - x, i + 0.5 - y
                turn = np.arctan2(dy, dx)
                rim = radius * (1 + 0.12 * np.cos(2 * turn + outline) + 0.08 * np.cos(3 * turn - 2 * outline))
                a = min(max((rim - np.hypot(dx, dy)) / (0.4 * radius + 0.5) + 0.5, 0.0), 1.0)
                if a <= 0:
                    continue
                # Upside down and small; what lies beyond the picture is like its border.
                row = min(max((y - dy / _MINIFIED) * rows / height - 0.5, 0.0), rows - 1.001)
                column = min(max((x - dx / _MINIFIED) * columns / width - 0.5, 0.0), columns - 1.001)
                r, c, p, q = int(row), int(column), row % 1.0, column % 1.0
                for n in range(channels):
                    upper = small[r, c, n] * (1 - q) + small[r, c + 1, n] * q
                    lower = small[r + 1, c, n] * (1 - q) + small[r + 1, c + 1, n] * q
                    image[i, j, n] += 0.9 * a * (upper * (1 - p) + lower * p - image[i, j, n])


def dirt_cover(dirt: float, lens_seed: int, *, shape: tuple[int, int]) -> NDArray[np.float32]:
    """How opaque (H, W) the dirt on the lens is, 0 clean. Blotches far out of focus cover the fraction ``dirt`` of the image on
    average: the number of circles that leave exp(-density pi E[r^2]) of the plane bare."""
    height, width = shape
    cover = np.zeros(shape, np.float32)
    rng = stream(lens_seed, "dirt")
    low, high = (radius * width / REFERENCE_WIDTH for radius in _BLOTCH)
    square = (low**2 + low * high + high**2) / 3
    area = (height + 2 * high) * (width + 2 * high)
    count = int(rng.poisson(-np.log1p(-min(dirt, 0.95)) * area / (np.pi * square)))
    place = rng.random((count, 2)) * [width + 2 * high, height + 2 * high] - high
    stamp(cover, place, rng.uniform(low, high, count), rng.uniform(*_DIRT_OPACITY, count), 0.5)
    return cover


def add_dirt(linear: NDArray[np.float32], cover: NDArray[np.float32], sunlight: NDArray[np.float64]) -> None:
    """Lay dirt over the image (H, W, 3), in place. It is as bright as a grey layer before the scene's mean light, and more
    where the sun shines on it: ``sunlight`` (3,) lux on the lens."""
    veil = 0.35 * linear.mean(axis=(0, 1)) + (0.15 / np.pi * sunlight).astype(np.float32)
    linear += cover[..., None] * (veil - linear)


@jit
def stamp(canvas, place, radius, opacity, softness):
    """Discs laid over each other on ``canvas`` (H, W): centres (N, 2) as (right, down), ``softness`` the fraction of the radius
    over which they fade out, half of it inside."""
    height, width = canvas.shape
    for k in range(len(radius)):
        x, y = place[k]
        soft = softness * radius[k] + 0.5
        reach = radius[k] + 0.5 * soft
        for i in range(int(max(y - reach, 0.0)), int(min(y + reach + 1, height))):
            for j in range(int(max(x - reach, 0.0)), int(min(x + reach + 1, width))):
                off = np.hypot(j + 0.5 - x, i + 0.5 - y)
                a = opacity[k] * min(max((radius[k] - off) / soft + 0.5, 0.0), 1.0)
                canvas[i, j] = 1 - (1 - canvas[i, j]) * (1 - a)
