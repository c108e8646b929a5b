"""What lies along or on the road: guard rails, steel plates, billboards, benches. Fronts look towards -x."""

import numpy as np

from data_gen.assets.shapes.lettering import end_text, symbol
from data_gen.assets.shapes.mesh import Asset, Scatterers
from data_gen.assets.shapes.palette import (
    CONCRETE,
    DARK_STEEL,
    STEEL,
    TIMBER,
    Material,
    lacquer,
)
from data_gen.assets.shapes.profiles import assemble, box, end_patch, extrude, loft, moved
from data_gen.assets.shapes.reflectors import cloud, line, points
from data_gen.assets.street.roadworks import jersey

PRINT, SUNNY, CRIMSON, INK = (
    Material(rgb, 0.5) for rgb in ((0.78, 0.78, 0.76), (0.85, 0.60, 0.04), (0.48, 0.02, 0.04), (0.02, 0.03, 0.05))
)


def guard_rail(variant: str) -> Asset:
    """Four metres of guard rail along x: a two-wave beam of steel, or a concrete wall. Both sides reflect radar."""
    if variant == "concrete":
        parts, per_metre = [jersey(-2.0, 2.0, 0.85, CONCRETE)], 5.0
    else:
        wave = [(-0.02, 0.44), (-0.09, 0.51), (-0.02, 0.58), (-0.02, 0.62), (-0.09, 0.69), (-0.02, 0.75)]
        profile = wave + [(x + 0.012, z) for x, z in wave[::-1]]
        beam = [moved(extrude(profile, 2.0, STEEL), yaw=yaw) for yaw in (-np.pi / 2, np.pi / 2)]
        parts = [*beam, *(box((x - 0.05, -0.02, 0), (x + 0.05, 0.02, 0.74), DARK_STEEL) for x in (-1.0, 1.0))]
        per_metre = 8.0

    def scatter(size) -> Scatterers:
        return Scatterers.concatenate(
            [
                line((-2, y, 0.6), (2, y, 0.6), per_metre=per_metre, normal=(0, np.sign(y), 0))
                for y in (-size[1] / 2, size[1] / 2)
            ]
        )

    return assemble(f"guard rail {variant}", "", parts, scatter)


def metal_plate(variant: str) -> Asset:
    """A steel plate or a manhole cover flat on the road: nothing to the LiDAR, a loud echo to the radar."""
    if variant == "cover":
        parts = [loft([(0, 0, 0), (0, 0, 0.015)], [0.4, 0.4], DARK_STEEL, sections=10)]
    else:
        parts = [box((-0.75, -0.5, 0), (0.75, 0.5, 0.02), DARK_STEEL)]
    return assemble(
        f"metal plate {variant}", "", parts, lambda size: points([(0, 0, 0.02)], 8.0 if variant == "cover" else 15.0)
    )


# name: height of the lower edge, what the picture is on, words as (text, middle (y, z), letter height, colour)
BILLBOARDS = {
    "low": (0.2, Material((0.75, 0.55, 0.05), 0.5, "billboard"), ()),
    "high": (2.2, lacquer((0.03, 0.30, 0.55)), (("SALE", (0.0, 2.1), 0.9, PRINT), ("50 %", (0.0, 0.85), 0.8, SUNNY))),
    "poster": (
        0.6,
        lacquer((0.70, 0.66, 0.55)),
        (("FRESH", (0.7, 2.2), 0.55, CRIMSON), ("DAILY", (0.7, 1.3), 0.55, INK)),
    ),
    "tall poster": (
        2.4,
        lacquer((0.42, 0.03, 0.05)),
        (("RADIO", (0.2, 2.1), 0.7, PRINT), ("96 5", (0.6, 1.0), 0.8, SUNNY)),
    ),
}


def billboard(variant: str) -> Asset:
    """A billboard of 6 by 3 metres on two posts, or down on the ground: a builder's stripes, or a poster."""
    low, ground, words = BILLBOARDS[variant]
    frame = lacquer((0.10, 0.10, 0.11))
    parts = [box((0.06, y - 0.1, 0), (0.26, y + 0.1, low + 2.8), frame) for y in (-2.0, 2.0)]
    parts += [
        box((-0.06, -3.0, low), (0.06, 3.0, low + 3.0), frame),
        end_patch(-0.072, (-2.88, 2.88), (low + 0.12, low + 2.88), ground, facing=-1),
    ]
    for word, (y, z), height, ink in words:
        parts += end_text(word, -0.085, (y, low + z), height, ink)
    if words:  # what is for sale: a disc, and a band below it
        disc = [(0.62 * np.cos(a), 0.62 * np.sin(a)) for a in np.arange(12) * np.pi / 6]
        parts.append(symbol(disc, -0.08, (-2.1, low + 1.7), 1.0, words[-1][3]))
        parts.append(end_patch(-0.08, (-2.88, 2.88), (low + 0.12, low + 0.38), words[0][3], facing=-1))

    def scatter(size) -> Scatterers:
        flat = line((-size[0] / 2, -2.5, low + 1.0), (-size[0] / 2, 2.5, low + 1.0), per_metre=11.0, normal=(-1, 0, 0))
        return Scatterers.concatenate([flat, points([(0, -2, 0.8), (0, 2, 0.8)], 0.0)])

    return assemble(f"billboard {variant}", "", parts, scatter)


def bench(variant: str) -> Asset:
    """A park bench along y, or a stone block."""
    if variant == "stone":
        parts = [box((-0.25, -0.8, 0), (0.25, 0.8, 0.45), CONCRETE)]
    else:
        planks = [box((x, -0.85, 0.42), (x + 0.12, 0.85, 0.46), TIMBER) for x in (-0.25, -0.10, 0.05)]
        back = [box((0.20, -0.85, z), (0.24, 0.85, z + 0.12), TIMBER) for z in (0.58, 0.76)]
        legs = [box((-0.24, y - 0.04, 0), (0.24, y + 0.04, 0.42), DARK_STEEL) for y in (-0.7, 0.7)]
        parts = [
            *planks,
            *back,
            *legs,
            *(box((0.24, y - 0.04, 0), (0.28, y + 0.04, 0.9), DARK_STEEL) for y in (-0.7, 0.7)),
        ]
    return assemble(f"bench {variant}", "", parts, lambda size: cloud([(0, -0.6, 0.4), (0, 0.6, 0.4)], -4.0))
