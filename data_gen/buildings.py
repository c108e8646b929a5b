"""Houses along the road: boxes with a facade, flat or gabled, and what a radar sees of their fronts."""

import numpy as np
from numpy.typing import NDArray

from data_gen.mesh import TEXTURES, Mesh, Scatterers, Surface

Array = NDArray[np.float64]

WALLS = np.array(
    [
        (0.45, 0.40, 0.33),
        (0.55, 0.52, 0.47),
        (0.36, 0.19, 0.14),
        (0.50, 0.42, 0.28),
        (0.30, 0.32, 0.35),
        (0.60, 0.58, 0.55),
    ],
    np.float32,
)
"""Linear albedo of plaster, brick and concrete fronts."""
ROOFS = np.array([(0.25, 0.10, 0.07), (0.12, 0.12, 0.13), (0.20, 0.17, 0.14)], np.float32)

# A unit house: x depth (0 front .. -1 back), y width, z height; the ridge runs along y at mid-depth.
_CORNERS = np.array(
    [(0, -0.5, 0), (0, 0.5, 0), (-1, 0.5, 0), (-1, -0.5, 0), (0, -0.5, 1), (0, 0.5, 1), (-1, 0.5, 1), (-1, -0.5, 1),
     (-0.5, -0.5, 1), (-0.5, 0.5, 1)]
)  # fmt: skip
_FACES = np.array(
    [(0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7),  # walls
     (5, 6, 9), (7, 4, 8),  # gables
     (4, 5, 9), (4, 9, 8), (6, 7, 8), (6, 8, 9)]  # roof
)  # fmt: skip
_WALL_FACES = 10


def build_houses(front: Array, yaw: Array, size: Array, *, rng: np.random.Generator) -> tuple[Mesh, Scatterers]:
    """Houses with the middle of their front at ``front`` (K, 2), facing ``yaw`` (K,), of ``size`` (K, 3): width along the
    street, depth, height of the eaves in metres."""
    count = len(front)
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    gable = np.where((rng.random(count) < 0.5) & (size[:, 2] < 11), rng.uniform(2.0, 4.0, count), 0.0)
    local = _CORNERS[None] * size[:, None, [1, 0, 2]]
    vertices = np.empty((count, len(_CORNERS), 3), np.float32)
    vertices[..., :2] = front[:, None] + local[..., :1] * ahead[:, None] + local[..., 1:2] * left[:, None]
    vertices[..., 2] = local[..., 2]
    vertices[:, 8:, 2] += gable[:, None]
    faces = (_FACES[None] + len(_CORNERS) * np.arange(count)[:, None, None]).reshape(-1, 3).astype(np.int32)
    surface = _surface(count, rng)
    return Mesh(vertices.reshape(-1, 3), faces, surface), _front_scatterers(front, ahead, left, size, rng)


def _surface(count: int, rng: np.random.Generator) -> Surface:
    shape = (count, len(_FACES))
    albedo = np.empty((*shape, 3), np.float32)
    shade = rng.uniform(0.75, 1.15, (count, 1, 1)).astype(np.float32)
    albedo[:, :_WALL_FACES] = WALLS[rng.integers(len(WALLS), size=count), None] * shade
    albedo[:, _WALL_FACES:] = ROOFS[rng.integers(len(ROOFS), size=count), None]
    texture = np.full(shape, TEXTURES.index("facade"), np.uint8)
    texture[:, 8:_WALL_FACES] = TEXTURES.index("brick")
    texture[:, _WALL_FACES:] = TEXTURES.index("concrete")
    flat = np.zeros(shape, np.float32)
    reflectivity = np.broadcast_to(rng.uniform(0.25, 0.6, (count, 1)), shape).astype(np.float32)
    return Surface(albedo.reshape(-1, 3), texture.ravel(), flat.ravel(), flat.ravel().copy(), reflectivity.ravel())


def _front_scatterers(front: Array, ahead: Array, left: Array, size: Array, rng: np.random.Generator) -> Scatterers:
    """Six points a front, 10-20 dBsm, seen from the street only; window reveals and doors are corner reflectors."""
    count = len(front)
    across = rng.uniform(-0.48, 0.48, (count, 6, 1)) * size[:, None, :1]
    place = front[:, None] + across * left[:, None] + 0.05 * ahead[:, None]
    height = rng.uniform(0.4, 5.0, (count, 6, 1))
    normal = np.broadcast_to(np.append(ahead, np.zeros((count, 1)), axis=1)[:, None], (count, 6, 3))
    return Scatterers(
        np.concatenate([place, height], axis=2).reshape(-1, 3).astype(np.float32),
        normal.reshape(-1, 3).astype(np.float32),
        rng.uniform(10.0, 20.0, count * 6).astype(np.float32),
    )
