"""Houses along the road: boxes with a facade, flat or gabled, balconies and chimneys, and what a radar sees of their fronts."""

import numpy as np
from numpy.typing import NDArray

from data_gen.assets.shapes.mesh import TEXTURES, Mesh, Scatterers, Surface

BAY = 2.8
"""Width of a bay of a facade in metres. Houses stand on a grid of it, so that a front begins and ends with a whole one."""
STOREY = 3.2
"""Height of a storey in metres."""
Array = NDArray[np.float64]

WALLS = np.array(
    [
        (0.45, 0.40, 0.33), (0.55, 0.52, 0.47), (0.36, 0.19, 0.14), (0.50, 0.42, 0.28), (0.30, 0.32, 0.35),
        (0.60, 0.58, 0.55), (0.52, 0.33, 0.20), (0.55, 0.37, 0.32), (0.33, 0.38, 0.34), (0.62, 0.56, 0.40),
        (0.28, 0.12, 0.09), (0.40, 0.45, 0.52),
    ],
    np.float32,
)  # fmt: skip
"""Linear albedo of plaster, brick and concrete fronts."""
ROOFS = np.array([(0.25, 0.10, 0.07), (0.12, 0.12, 0.13), (0.20, 0.17, 0.14), (0.30, 0.14, 0.09)], np.float32)
RAILINGS = np.array([(0.05, 0.05, 0.055), (0.55, 0.54, 0.51), (0.22, 0.30, 0.32), (0.30, 0.16, 0.10)], np.float32)
EAVES = 0.5
"""Metres that a gabled roof reaches beyond the walls."""
_BALCONY = (2.2, 1.05, 1.0)
"""Width, depth and height of a balcony in metres."""

# A unit house: x depth (0 front .. -1 back), y width, z height; the ridge runs along y at mid-depth. The roof has corners
# of its own, which reach beyond the walls.
_WALL = [(0, -0.5, 0), (0, 0.5, 0), (-1, 0.5, 0), (-1, -0.5, 0), (0, -0.5, 1), (0, 0.5, 1), (-1, 0.5, 1), (-1, -0.5, 1),
         (-0.5, -0.5, 1), (-0.5, 0.5, 1)]  # fmt: skip
_CORNERS = np.array(_WALL + _WALL[4:], float)
_OUT = np.array([(1, -1), (1, 1), (-1, 1), (-1, -1), (0, -1), (0, 1)], float)  # of the roof's corners: ahead, left
_FACES = np.array(
    [(0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7),  # walls
     (5, 6, 9), (7, 4, 8),  # gables
     (10, 11, 15), (10, 15, 14), (12, 13, 14), (12, 14, 15)]  # roof
)  # fmt: skip
_WALL_FACES = 10
_BOX = np.array([(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)], float)
_BOX_FACES = np.array([(4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7),
                       (1, 7, 3), (0, 1, 3), (0, 3, 2)])  # fmt: skip


def fitted(front: Array, outward: Array, size: Array) -> tuple[Array, Array]:
    """Fronts (K, 2) moved back and along by less than a bay, and sizes (K, 3) rounded, so that the facade's bays and storeys
    come out whole on every wall. ``outward`` (K, 2) points from the street to the house."""
    width, depth = (BAY * np.maximum(np.rint(size[:, k] / BAY), 3.0) for k in (0, 1))
    height = STOREY * np.maximum(np.rint(size[:, 2] / STOREY), 1.0) + 0.5
    left = np.stack([outward[:, 1], -outward[:, 0]], axis=1)
    across = np.einsum("ki,ki->k", front, left) - width / 2
    back = np.einsum("ki,ki->k", front, outward)
    shift = BAY * np.rint(across / BAY) - across
    moved = front + shift[:, None] * left + (BAY * np.ceil(back / BAY) - back)[:, None] * outward
    return moved, np.stack([width, depth, height], axis=1)


def build_houses(front: Array, yaw: Array, size: Array, *, rng: np.random.Generator) -> tuple[Mesh, Scatterers]:
    """Houses with the middle of their front at ``front`` (K, 2), facing ``yaw`` (K,), of ``size`` (K, 3): width along the
    street, depth, height of the eaves in metres."""
    count = len(front)
    axes = np.zeros((count, 3, 3))  # rows: ahead, left, up
    axes[:, 0, :2] = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    axes[:, 1, :2] = np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
    axes[:, 2, 2] = 1.0
    origin = np.append(front, np.zeros((count, 1)), axis=1)
    gabled = (rng.random(count) < 0.5) & (size[:, 2] < 11)
    gable = np.where(gabled, rng.uniform(2.0, 4.0, count), 0.0)
    local = _CORNERS[None] * size[:, None, [1, 0, 2]]
    local[:, 10:, :2] += EAVES * gabled[:, None, None] * _OUT
    local[:, 10:14, 2] -= (gable * EAVES / (size[:, 1] / 2))[:, None]
    local[:, [8, 9, 14, 15], 2] += gable[:, None]
    faces = (_FACES[None] + len(_CORNERS) * np.arange(count)[:, None, None]).reshape(-1, 3).astype(np.int32)
    vertices = origin[:, None] + local @ axes
    houses = Mesh(vertices.reshape(-1, 3).astype(np.float32), faces, _surface(count, gabled, rng))
    boxes = [_balconies(size, rng), _roof_boxes(size, gable, rng)]
    extras = [_boxes(origin[k], axes[k], low, high, colour) for k, low, high, colour in boxes]
    return Mesh.concatenate([houses, *extras]), _front_scatterers(front, axes[:, 0, :2], axes[:, 1, :2], size, rng)


def _surface(count: int, gabled: NDArray[np.bool_], rng: np.random.Generator) -> Surface:
    shape = (count, len(_FACES))
    albedo = np.empty((*shape, 3), np.float32)
    shade = rng.uniform(0.75, 1.15, (count, 1, 1)).astype(np.float32)
    albedo[:, :_WALL_FACES] = WALLS[rng.integers(len(WALLS), size=count), None] * shade
    albedo[:, _WALL_FACES:] = ROOFS[rng.integers(len(ROOFS), size=count), None]
    texture = np.full(shape, TEXTURES.index("facade"), np.uint8)
    texture[:, 8:_WALL_FACES] = TEXTURES.index("brick")
    texture[:, _WALL_FACES:] = np.where(gabled, TEXTURES.index("tiles"), TEXTURES.index("gravel"))[:, None]
    flat = np.zeros(shape, np.float32)
    reflectivity = np.broadcast_to(rng.uniform(0.25, 0.6, (count, 1)), shape).astype(np.float32)
    return Surface(albedo.reshape(-1, 3), texture.ravel(), flat.ravel(), flat.ravel().copy(), reflectivity.ravel())


def _balconies(size: Array, rng: np.random.Generator) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """House (B,), lowest and highest corner (B, 3) in its frame and albedo (B, 3) of balconies before every other bay, from
    the first floor up, on a third of the houses."""
    width, depth, height = _BALCONY
    kept = rng.random(len(size)) < 0.34
    first = rng.integers(2, size=len(size))
    house, bay, storey = np.indices((len(size), 8, 8)).reshape(3, -1)
    room = (bay < size[house, 0] / BAY - 0.5) & (storey > 0) & ((storey + 1) * STOREY < size[house, 2])
    house, bay, storey = (index[room & kept[house] & ((bay + first[house]) % 2 == 0)] for index in (house, bay, storey))
    middle = (bay + 0.5) * BAY - size[house, 0] / 2
    low = np.stack([np.zeros(len(house)), middle - width / 2, storey * STOREY - 0.1], axis=1)
    colour = RAILINGS[rng.integers(len(RAILINGS), size=len(size))]
    return house, low, low + np.array([depth, width, height + 0.1]), colour[house]


def _roof_boxes(size: Array, gable: Array, rng: np.random.Generator) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """A chimney on a gabled roof, the top of the lift's shaft on a flat one: as :func:`_balconies`."""
    house = np.flatnonzero(rng.random(len(size)) < 0.7)
    flat = gable[house] == 0
    extent = np.where(flat[:, None], (3.0, 3.6, 2.2), (0.6, 0.9, 1.0))
    low = np.stack([-size[house, 1] / 2, rng.uniform(-0.3, 0.3, len(house)) * size[house, 0], size[house, 2]], axis=1)
    low[:, 2] += np.where(flat, 0.0, 0.7 * gable[house])
    high = low + extent + np.stack([0 * low[:, 0], 0 * low[:, 0], 0.3 * gable[house]], axis=1)
    return house, low, high, np.where(flat[:, None], (0.34, 0.34, 0.34), (0.22, 0.10, 0.07))


def _boxes(origin: Array, axes: Array, low: Array, high: Array, albedo: Array) -> Mesh:
    """Boxes from ``low`` to ``high`` (B, 3) in frames with ``origin`` (B, 3) and ``axes`` (B, 3, 3), one albedo (B, 3) each."""
    count = len(low)
    vertices = origin[:, None] + (low[:, None] + _BOX * (high - low)[:, None]) @ axes
    faces = (_BOX_FACES[None] + 8 * np.arange(count)[:, None, None]).reshape(-1, 3).astype(np.int32)
    surface = Surface.uniform(len(faces), (0.3, 0.3, 0.3), 0.35, texture="gravel")
    surface.albedo[:] = np.repeat(albedo, len(_BOX_FACES), axis=0)
    return Mesh(vertices.reshape(-1, 3).astype(np.float32), faces, surface)


def _front_scatterers(front: Array, ahead: Array, left: Array, size: Array, rng: np.random.Generator) -> Scatterers:
    """Six points a front, 10-20 dBsm, seen from the street only; window reveals and doors are corner reflectors."""
    count = len(front)
    across = rng.uniform(-0.48, 0.48, (count, 6, 1)) * size[:, None, :1]
    place = front[:, None] + across * left[:, None] + 0.05 * ahead[:, None]
    height = rng.uniform(0.4, np.minimum(5.0, size[:, 2])[:, None, None], (count, 6, 1))
    normal = np.broadcast_to(np.append(ahead, np.zeros((count, 1)), axis=1)[:, None], (count, 6, 3))
    return Scatterers(
        np.concatenate([place, height], axis=2).reshape(-1, 3).astype(np.float32),
        normal.reshape(-1, 3).astype(np.float32),
        rng.uniform(10.0, 20.0, count * 6).astype(np.float32),
    )
