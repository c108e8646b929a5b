"""Trees and bushes: trunks that branch into clumps, each a dark core in a shell of leafy sprigs that one sees between."""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from data_gen.assets.shapes.mesh import Asset, Mesh
from data_gen.assets.shapes.palette import BARK, BIRCH_BARK, Material
from data_gen.assets.shapes.profiles import assemble, loft
from data_gen.assets.shapes.reflectors import cloud
from fusion_net.common.random import stream

Clump = tuple[float, float, float, float, float]
"""x, y, z of the middle, radius, flattening."""


@dataclass(frozen=True)
class Habit:
    """How a tree grows: height and radius of the trunk, the clumps of its crown, its leaves, sprigs a clump and their size
    as a share of the clump's radius."""

    height: float
    radius: float
    clumps: tuple[Clump, ...]
    leaves: Material
    sprigs: int = 24
    sprig: float = 0.42
    bark: Material = BARK


def _leaves(r: float, g: float, b: float) -> Material:
    return Material((r, g, b), 0.5, "foliage")


LIME, OAK, OLIVE, DARK, YELLOW = (
    _leaves(0.075, 0.16, 0.03), _leaves(0.06, 0.125, 0.03), _leaves(0.13, 0.165, 0.055), _leaves(0.03, 0.075, 0.03),
    _leaves(0.135, 0.165, 0.035),
)  # fmt: skip
STRAW = _leaves(0.24, 0.22, 0.09)
TREES = {
    "lime": Habit(
        2.8, 0.19,
        ((0.1, 0, 5.2, 1.6, 0.95), (1.3, 0.5, 4.1, 1.25, 0.8), (-1.1, 0.9, 4.4, 1.3, 0.8), (0.1, -1.3, 4.2, 1.25, 0.8),
         (0.2, 0.2, 6.7, 1.0, 1.0)),
        LIME,
    ),
    "oak": Habit(
        2.3, 0.32,
        ((0.2, 0.2, 5.3, 1.6, 0.75), (2.0, 0.3, 4.0, 1.5, 0.7), (-1.7, 1.1, 3.9, 1.5, 0.7), (-0.4, -1.9, 3.9, 1.5, 0.7),
         (0.7, 1.9, 4.4, 1.2, 0.7)),
        OAK,
    ),
    "poplar": Habit(
        1.4, 0.18,
        ((0, 0, 2.9, 0.85, 1.5), (0.25, 0.1, 4.9, 0.85, 1.5), (-0.2, 0.05, 6.8, 0.75, 1.5), (0.05, 0, 8.6, 0.45, 1.9)),
        OLIVE, 26, 0.55,
    ),
    "sapling": Habit(
        1.5, 0.06, ((0, 0, 2.4, 0.65, 1.1), (0.35, 0.2, 1.9, 0.45, 0.9), (-0.3, -0.3, 2.9, 0.5, 1.0)), LIME, 24, 0.5
    ),
    "birch": Habit(
        2.6, 0.13,
        ((0, 0, 3.9, 0.9, 1.0), (0.9, 0.3, 4.6, 0.8, 1.1), (-0.7, 0.6, 5.0, 0.8, 1.1), (0.1, -0.8, 5.3, 0.8, 1.1),
         (0.1, 0.1, 6.6, 0.7, 1.3)),
        YELLOW, 26, 0.40, BIRCH_BARK,
    ),
    "spruce": Habit(
        1.0, 0.17, tuple((0.0, 0.0, 1.3 + 1.15 * k, 1.75 - 0.26 * k, 0.55) for k in range(6)), DARK, 22, 0.5
    ),
}  # fmt: skip
BUSHES = {
    "round": (((0, 0, 0.55, 0.6, 0.8), (0.5, 0.3, 0.4, 0.45, 0.8), (-0.4, 0.4, 0.45, 0.45, 0.8)), OAK),
    "hedge": (tuple((x, 0.0, 0.6, 0.55, 1.0) for x in (-1.2, -0.4, 0.4, 1.2)), DARK),
    "tall": (((0, 0, 0.9, 0.6, 1.3), (0.4, -0.2, 0.6, 0.45, 1.1), (-0.35, 0.25, 0.7, 0.45, 1.2)), OLIVE),
}
GRASSES = {"grass": (44, 0.45, LIME), "straw": (40, 0.7, STRAW)}
"""Number of blades, height, colour."""
GROVES = {"broadleaf": (5.5, 0.8, (LIME, OAK, OLIVE, OAK)), "spruce": (7.5, 1.9, (DARK, DARK, OAK, DARK))}


def _sprigs(
    middle: NDArray, ahead: NDArray, size: NDArray, leaves: Material, rng: np.random.Generator, *, girth: float = 1.0
) -> Mesh:
    """Tetrahedra at ``middle`` (N, 3) that point along ``ahead`` (N, 3): leafy twigs of ``size`` (N,) metres, blades if their
    ``girth`` is small."""
    count = len(middle)
    side = np.cross(ahead, rng.normal(size=(count, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(ahead, side)
    corners = np.array([(-0.4, 0.6, 0.0), (-0.4, -0.35, 0.5), (-0.4, -0.35, -0.5), (0.65, 0.0, 0.0)]) * (
        1,
        girth,
        girth,
    )
    frame = np.stack([ahead, side, other], axis=1) * size[:, None, None]
    vertices = middle[:, None] + corners @ frame
    faces = np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]) + 4 * np.arange(count)[:, None, None]
    surface = leaves.on(4 * count)
    surface.albedo[:] *= np.repeat(rng.uniform(0.65, 1.35, count), 4)[:, None]
    return Mesh(vertices.reshape(-1, 3).astype(np.float32), faces.reshape(-1, 3).astype(np.int32), surface)


def _clump(blob: Clump, leaves: Material, sprigs: int, sprig: float, key: tuple[str, int]) -> Mesh:
    """A core of 20 faces and ``sprigs`` that stand out from it on a spiral of even density, brighter at the top."""
    x, y, z, radius, flat = blob
    rng = stream(0, "crown", *key)
    core = trimesh.creation.icosphere(subdivisions=0, radius=0.66 * radius)
    vertices = core.vertices * rng.uniform(0.8, 1.1, (len(core.vertices), 1)) * (1, 1, flat) + (x, y, z)
    surface = leaves.darker(0.45).on(len(core.faces))
    heart = Mesh(vertices.astype(np.float32), core.faces.astype(np.int32), surface)
    height = 1 - 2 * (np.arange(sprigs) + 0.5) / sprigs
    turn = np.arange(sprigs) * 2.399963 + rng.uniform(0, 6.28)  # golden angle
    around = np.sqrt(1 - height**2)
    out = np.stack([around * np.cos(turn), around * np.sin(turn), height], axis=1)
    ahead = out + rng.normal(0, 0.45, out.shape)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    middle = out * (1, 1, flat) * radius * rng.uniform(0.62, 0.95, (sprigs, 1)) + (x, y, z)
    leafage = _sprigs(middle, ahead, sprig * radius * rng.uniform(0.75, 1.35, sprigs), leaves, rng)
    leafage.surface.albedo[:] *= np.repeat(np.clip(0.85 + 0.35 * height, 0.5, 1.2), 4)[:, None]
    return Mesh.concatenate([heart, leafage])


def _on_ground(mesh: Mesh) -> Mesh:
    """Nothing grows below the ground."""
    return Mesh(np.maximum(mesh.vertices, np.array([-np.inf, -np.inf, 0.0], np.float32)), mesh.faces, mesh.surface)


def tree(variant: str) -> Asset:
    """A tree of the named habit."""
    habit = TREES[variant]
    height, radius = habit.height, habit.radius
    top = habit.clumps[0] if variant in ("lime", "oak") else habit.clumps[-1]
    trunk = [(0, 0, 0), (0.02, 0.0, 0.35), (0.04, -0.03, height), top[:3]]
    parts = [loft(trunk, [1.6 * radius, radius, 0.75 * radius, 0.2 * radius], habit.bark, sections=6)]
    if variant != "spruce":
        parts += [
            loft([(0.03, -0.02, 0.75 * height), (x, y, z)], [0.5 * radius, 0.18 * radius], habit.bark, sections=4)
            for x, y, z, *_ in habit.clumps[1:]
        ]
    parts += [
        _clump(blob, habit.leaves, habit.sprigs, habit.sprig, (variant, i)) for i, blob in enumerate(habit.clumps)
    ]
    return assemble(
        f"tree {variant}", "", parts, lambda size: cloud([(0, 0, 0.7), (0, 0, 1.5), (0, 0, 0.5 * size[2])], 2.0)
    )


def bush(variant: str) -> Asset:
    """A bush, a piece of hedge along x, or a stand of tall grass."""
    if variant in GRASSES:
        return _tall_grass(variant)
    clumps, leaves = BUSHES[variant]
    parts = [_on_ground(_clump(blob, leaves, 24, 0.40, (variant, i))) for i, blob in enumerate(clumps)]
    return assemble(f"bush {variant}", "", parts, lambda size: cloud([(0, 0, 0.5 * size[2])], -8.0))


def _tall_grass(variant: str) -> Asset:
    count, height, leaves = GRASSES[variant]
    rng = stream(0, "grass", variant)
    middle = np.append(rng.uniform(-1.3, 1.3, (count, 2)), np.zeros((count, 1)), axis=1)
    tall = height * rng.uniform(0.5, 1.1, (count, 1))
    ahead = np.append(rng.normal(0, 0.25, (count, 2)), np.ones((count, 1)), axis=1)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    blades = _sprigs(middle + (0, 0, 0.3) * tall, ahead, tall[:, 0], leaves, rng, girth=0.16)
    return assemble(f"bush {variant}", "", [_on_ground(blades)], lambda size: cloud([(0, 0, 0.5 * size[2])], -16.0))


def grove(variant: str) -> Asset:
    """The edge of a wood along x, 16 metres of it, for the distance: crowns of few faces from the ground up."""
    height, slender, kinds = GROVES[variant]
    rng, parts = stream(0, "grove", variant), []
    for i, x in enumerate(np.linspace(-7.0, 7.0, 6)):
        tall = height * rng.uniform(0.75, 1.3)
        radius = tall / 2 / (1.25 if slender < 1 else slender)
        blob = (x + rng.normal(0, 0.4), rng.uniform(-1.2, 1.2), 0.52 * tall, radius, tall / 2 / radius)
        parts.append(_on_ground(_clump(blob, kinds[i % len(kinds)], 16, 0.7, (f"grove {variant}", i))))
    along = [(x, 0, 1.5) for x in (-6.0, -2.0, 2.0, 6.0)]
    return assemble(f"grove {variant}", "", parts, lambda size: cloud(along, 5.0))
