"""What use does to a road: repairs, sealed cracks, tyre tracks, oil, one age of asphalt beside another."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from data_gen.road.layout import Lane
from data_gen.world.brush import Brush

Array = NDArray[np.float64]

AGE = (0.78, 1.45)
"""Factor on the albedo of asphalt, from new and black to old and bleached."""
TRACK = 0.8
"""Half the distance between the tracks of a car's tyres in metres."""


def paint_age(brush: Brush, lanes: Sequence[Lane], paths: Sequence[Array], rng: np.random.Generator) -> None:
    """The road's age, now and then another for a lane that was resurfaced; along each lane's path (N, 2) two tracks that
    tyres have polished and the oil that drips between them."""
    age = rng.uniform(*AGE)
    for lane, path in zip(lanes, paths, strict=True):
        brush.shade(age, [path], lane.width.mean() + 1.0)
    for lane, path in zip(lanes, paths, strict=True):
        own = rng.uniform(*AGE) if rng.random() < 0.15 else age
        if own != age:
            brush.shade(own, [path], lane.width.mean())
        wear = rng.uniform(0.12, 0.38)
        normal = _normals(path)
        brush.shade(own * (1 - wear), [path + side * TRACK * normal for side in (-1, 1)], 0.4)
        brush.shade(own * (1 - rng.uniform(0.0, 0.15)), [path], 0.5)


def paint_repairs(brush: Brush, lanes: Sequence[Lane], rng: np.random.Generator) -> None:
    """Repairs (dark rectangles along the lane), sealed cracks (wandering lines) and covers of drains, each about every 40 m
    of lane."""
    points = np.concatenate([lane.centre[1:-1] for lane in lanes])
    step = np.concatenate([np.diff(lane.centre, axis=0)[1:] for lane in lanes])
    chosen = rng.random(len(points)) < 0.09
    at, ahead = points[chosen], step[chosen] / np.linalg.norm(step[chosen], axis=1, keepdims=True)
    if not len(at):
        return
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    at = at + left * rng.uniform(-1.2, 1.2, (len(at), 1))
    half_l, half_w = rng.uniform(0.4, 3.0, (2, len(at), 1)) * [[[1.0]], [[0.25]]]
    corners = np.stack(
        [at + a * half_l * ahead + b * half_w * left for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))], axis=1
    )
    patches = corners[::3]
    brush.fill("patch", patches)
    brush.stroke("tar", [np.concatenate([ring, ring[:1]]) for ring in patches[::2]], brush.resolution)
    walk = np.cumsum(rng.normal([0.8, 0.0], [0.5, 0.22], (len(at), 9, 2)), axis=1)
    cracks = at[:, None] + walk[..., :1] * ahead[:, None] + walk[..., 1:] * left[:, None]
    brush.stroke("tar", list(cracks[1::3]), brush.resolution)
    angle = np.arange(10) * 2 * np.pi / 10
    brush.fill("patch", at[2::3, None] + 0.33 * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def _normals(path: Array) -> Array:
    tangent = np.gradient(path, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
    return tangent[:, ::-1] * [-1, 1]
