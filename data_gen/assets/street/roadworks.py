"""Cones and barriers."""

from itertools import pairwise

import numpy as np

from data_gen.assets.shapes.mesh import Asset, Mesh, Scatterers
from data_gen.assets.shapes.palette import (
    CONCRETE,
    DARK_STEEL,
    RED_SHEETING,
    STEEL,
    WHITE_SHEETING,
    Material,
)
from data_gen.assets.shapes.profiles import assemble, box, extrude, loft, moved
from data_gen.assets.shapes.reflectors import cloud, line

CONE_ORANGE = Material((0.88, 0.17, 0.01), 0.45)
CONE_RED = Material((0.62, 0.03, 0.02), 0.4)
CONE_LIME = Material((0.55, 0.75, 0.03), 0.5)
PLASTIC_RED = Material((0.60, 0.02, 0.02), 0.45, specular=0.1)
PLASTIC_WHITE = Material((0.72, 0.72, 0.70), 0.6, specular=0.1)
CONES = {
    "large orange": (1.05, 0.42, CONE_ORANGE),
    "small red": (0.75, 0.36, CONE_RED),
    "lime": (0.90, 0.40, CONE_LIME),
}
BARRIERS = ("plastic", "concrete", "fence")


def traffic_cone(variant: str) -> Asset:
    """A cone on a square foot with two white bands."""
    height, base, skin = CONES[variant]
    levels = np.array([0.05, 0.38, 0.55, 0.68, 0.82, 1.0]) * height
    radii = list(0.37 * base * (1.16 - levels / height))
    skins = [skin, WHITE_SHEETING, skin, WHITE_SHEETING, skin]
    half = base / 2
    parts = [box((-half, -half, 0), (half, half, 0.05 * height), skin), loft([(0, 0, z) for z in levels], radii, skins)]
    return assemble(
        f"traffic cone {variant}", "movable_object.trafficcone", parts, lambda size: cloud([(0, 0, size[2] / 2)], -12.0)
    )


def barrier(variant: str) -> Asset:
    """A road barrier; as in nuScenes its long side is its width (across, along y), its length is the thin side."""
    build, per_metre = {"plastic": (_plastic, -3.0), "concrete": (_concrete, 4.0), "fence": (_fence, 6.0)}[variant]

    def scatter(size) -> Scatterers:
        reach = size[1] / 2
        return line((0, -reach, 0.5), (0, reach, 0.5), per_metre=per_metre)

    return assemble(f"barrier {variant}", "movable_object.barrier", [moved(m, yaw=np.pi / 2) for m in build()], scatter)


def jersey(x0: float, x1: float, height: float, skin: Material) -> Mesh:
    """A New Jersey profile along x."""
    profile = [
        (-0.26, 0),
        (0.26, 0),
        (0.26, 0.14),
        (0.14, 0.36),
        (0.08, height),
        (-0.08, height),
        (-0.14, 0.36),
        (-0.26, 0.14),
    ]
    section = extrude(profile, (x1 - x0) / 2, skin, y=(x0 + x1) / 2)
    return moved(section, yaw=-np.pi / 2)


def _plastic() -> list[Mesh]:
    edges = np.linspace(-1.25, 1.25, 6)
    return [jersey(a, b, 0.95, (PLASTIC_RED, PLASTIC_WHITE)[i % 2]) for i, (a, b) in enumerate(pairwise(edges))]


def _concrete() -> list[Mesh]:
    studs = [box((x - 0.07, -0.30, 0.42), (x + 0.07, 0.30, 0.50), AMBER_STUD) for x in (-0.8, 0.8)]
    return [jersey(-1.3, 1.3, 0.90, CONCRETE), *[_narrow(s) for s in studs]]


AMBER_STUD = Material((0.80, 0.40, 0.02), 0.9)


def _narrow(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices * (1.0, 0.5, 1.0), mesh.faces, mesh.surface)


def _fence() -> list[Mesh]:
    """A steel crowd barrier: frame, bars, flat feet, a red and white board along the top."""
    rails = [box((-1.2, -0.025, z - 0.025), (1.2, 0.025, z + 0.025), STEEL) for z in (0.22, 1.05)]
    bars = [box((x - 0.02, -0.015, 0.22), (x + 0.02, 0.015, 1.05), STEEL) for x in np.linspace(-1.18, 1.18, 15)]
    feet = [box((x - 0.05, -0.28, 0.0), (x + 0.05, 0.28, 0.04), DARK_STEEL) for x in (-0.9, 0.9)]
    legs = [box((x - 0.025, -0.025, 0.03), (x + 0.025, 0.025, 0.22), STEEL) for x in (-0.9, 0.9)]
    edges = np.linspace(-1.2, 1.2, 7)
    board = [
        box((a, -0.035, 0.72), (b, 0.035, 0.94), (RED_SHEETING, WHITE_SHEETING)[i % 2])
        for i, (a, b) in enumerate(pairwise(edges))
    ]
    return [*rails, *bars, *feet, *legs, *board]
