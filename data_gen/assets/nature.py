"""Trees and bushes: a trunk with branches under uneven crowns of low-poly leaves."""

import numpy as np
import trimesh

from data_gen.assets.palette import BARK, Material
from data_gen.assets.profiles import assemble, loft
from data_gen.assets.radar import cloud
from data_gen.mesh import Asset, Mesh
from data_gen.random import stream

LEAVES = tuple(
    Material(rgb, 0.5, "foliage")
    for rgb in ((0.07, 0.15, 0.03), (0.10, 0.18, 0.035), (0.045, 0.11, 0.035), (0.15, 0.17, 0.03))
)
# name: trunk's height, trunk's radius, crowns as (x, y, z, radius, flattening)
TREES = {
    "lime": (
        3.0,
        0.20,
        (
            (0, 0, 4.6, 1.9, 0.9),
            (1.1, 0.5, 3.9, 1.3, 0.8),
            (-0.9, 0.8, 4.1, 1.4, 0.8),
            (0.1, -1.1, 4.0, 1.3, 0.8),
            (0.2, 0.1, 6.2, 1.3, 0.9),
        ),
    ),
    "oak": (
        2.4,
        0.32,
        (
            (0, 0, 4.2, 2.0, 0.75),
            (1.9, 0.3, 3.7, 1.6, 0.75),
            (-1.6, 1.0, 3.6, 1.6, 0.7),
            (-0.3, -1.8, 3.6, 1.6, 0.75),
            (0.3, 0.4, 5.5, 1.6, 0.7),
        ),
    ),
    "poplar": (
        1.6,
        0.18,
        ((0, 0, 3.0, 1.1, 1.3), (0.15, 0.1, 5.2, 1.1, 1.4), (-0.1, 0.05, 7.2, 0.85, 1.4), (0.0, 0.0, 8.8, 0.5, 1.6)),
    ),
    "sapling": (1.5, 0.07, ((0, 0, 2.2, 0.8, 1.0), (0.35, 0.2, 1.8, 0.5, 0.9), (-0.2, -0.3, 2.9, 0.55, 1.0))),
}
BUSHES = {
    "round": ((0, 0, 0.55, 0.7, 0.8), (0.5, 0.3, 0.4, 0.5, 0.8), (-0.4, 0.4, 0.45, 0.5, 0.8)),
    "hedge": tuple((x, 0.0, 0.6, 0.62, 1.0) for x in (-1.2, -0.4, 0.4, 1.2)),
    "tall": ((0, 0, 0.9, 0.65, 1.3), (0.4, -0.2, 0.6, 0.5, 1.1), (-0.35, 0.25, 0.7, 0.5, 1.2)),
}


def _crown(blob: tuple[float, float, float, float, float], leaves: Material, key: tuple[str, int]) -> Mesh:
    """An icosphere whose corners are pushed in and out by up to a fifth, the same way each time."""
    x, y, z, radius, flat = blob
    sphere = trimesh.creation.icosphere(subdivisions=1, radius=radius)
    bumps = stream(0, "crown", *key).uniform(0.8, 1.15, (len(sphere.vertices), 1))
    vertices = sphere.vertices * bumps * (1, 1, flat) + (x, y, z)
    shade = np.clip(0.75 + 0.4 * (vertices[sphere.faces].mean(axis=1)[:, 2] - z) / (radius * flat), 0.45, 1.2)
    surface = leaves.on(len(sphere.faces))
    surface.albedo[:] = np.asarray(leaves.albedo) * shade[:, None]
    return Mesh(vertices.astype(np.float32), sphere.faces.astype(np.int32), surface)


def tree(variant: str) -> Asset:
    """A tree of the named habit."""
    height, radius, crowns = TREES[variant]
    leaves = LEAVES[list(TREES).index(variant) % len(LEAVES)]
    parts = [
        loft(
            [(0, 0, 0), (0.02, 0.0, 0.3), (0.05, -0.03, height + 0.4)],
            [1.5 * radius, radius, 0.7 * radius],
            BARK,
            sections=7,
        )
    ]
    parts += [
        loft([(0.04, -0.02, 0.8 * height), (0.7 * x, 0.7 * y, z)], [0.5 * radius, 0.25 * radius], BARK, sections=5)
        for x, y, z, *_ in crowns[1:4]
    ]
    parts += [_crown(blob, leaves, (variant, i)) for i, blob in enumerate(crowns)]
    return assemble(
        f"tree {variant}", "", parts, lambda size: cloud([(0, 0, 0.7), (0, 0, 1.5), (0, 0, 0.5 * size[2])], -1.0)
    )


def bush(variant: str) -> Asset:
    """A bush or a piece of hedge along x."""
    leaves = LEAVES[list(BUSHES).index(variant) % len(LEAVES)]
    parts = [_crown(blob, leaves, (variant, i)) for i, blob in enumerate(BUSHES[variant])]
    return assemble(f"bush {variant}", "", parts, lambda size: cloud([(0, 0, 0.5 * size[2])], -8.0))
