"""Posts and what they carry: masts, lamps, signals, signs, sign bridges.

What has a front shows it to a driver who comes along +x: its face looks towards -x. Arms reach to the left (+y).
"""

import numpy as np

from data_gen.assets.palette import (
    BLUE_SHEETING,
    DARK_STEEL,
    GREEN_SHEETING,
    RED_SHEETING,
    STEEL,
    TIMBER,
    TRIM,
    WHITE_SHEETING,
    Material,
)
from data_gen.assets.profiles import assemble, box, end_patch, extrude, loft, moved
from data_gen.assets.radar import line, points
from data_gen.assets.roadworks import PLASTIC_WHITE
from data_gen.mesh import Asset, Mesh, Scatterers


def pole(variant: str) -> Asset:
    """A plain post: a timber mast, a steel bollard, a striped marker post."""
    if variant == "mast":
        parts = [
            loft([(0, 0, 0), (0, 0, 8.5)], [0.15, 0.10], TIMBER, sections=7),
            box((-0.06, -0.9, 7.7), (0.06, 0.9, 7.85), TIMBER),
        ]
    elif variant == "bollard":
        parts = [loft([(0, 0, z) for z in (0, 0.7, 0.85, 1.0)], [0.09] * 4, [DARK_STEEL, WHITE_SHEETING, DARK_STEEL])]
    else:
        parts = [
            loft(
                [(0, 0, z) for z in (0, 0.72, 0.92, 1.05)],
                [(0.05, 0.07)] * 4,
                [PLASTIC_WHITE, TRIM, PLASTIC_WHITE],
                sections=6,
            )
        ]
    return assemble(
        f"pole {variant}",
        "",
        parts,
        lambda size: points([(0, 0, min(1.0, 0.6 * size[2]))], 0.0 if variant == "mast" else -6.0),
    )


def street_lamp(variant: str) -> Asset:
    """A lamp post, with an arm over the road or a head on top."""
    height, reach = {"arm": (8.0, 2.0), "double": (9.0, 2.2), "top": (4.5, 0.0)}[variant]
    parts = [loft([(0, 0, 0), (0, 0, 1.2), (0, 0, height)], [0.11, 0.09, 0.05], STEEL, sections=7)]
    if variant == "top":
        parts.append(
            loft(
                [(0, 0, height - 0.05), (0, 0, height + 0.35), (0, 0, height + 0.42)],
                [0.16, 0.26, 0.14],
                [LAMP, DARK_STEEL],
                sections=8,
            )
        )
    for side in (1,) if variant == "arm" else (1, -1) if variant == "double" else ():
        parts.append(loft([(0, 0, height - 0.1), (0, side * reach, height + 0.35)], [0.05, 0.04], STEEL, sections=5))
        y = sorted((side * (reach - 0.35), side * (reach + 0.45)))
        parts.append(box((-0.16, y[0], height + 0.28), (0.16, y[1], height + 0.44), DARK_STEEL, bottom=LAMP))

    def scatter(size) -> Scatterers:
        foot = -size[1] / 2 + 0.11 if variant == "arm" else 0.0
        return points([(0, foot, 1.0), (0, foot, 3.0)], (-2.0, -4.0))

    return assemble(f"street lamp {variant}", "", parts, scatter)


LAMP = Material((0.95, 0.85, 0.62), 0.4, emission=40.0)
SIGNAL_RED = Material((0.85, 0.02, 0.01), 0.4, emission=6.0)
SIGNAL_GREEN = Material((0.01, 0.75, 0.30), 0.4, emission=6.0)
SIGNAL_OFF = Material((0.02, 0.02, 0.02), 0.2)


def traffic_light(variant: str) -> Asset:
    """A signal head on a post, or on an arm over the road, red or green."""
    arm = variant.startswith("arm")
    lit = {"red": 0, "green": 2}[variant.split()[1]]
    colours = [SIGNAL_OFF, SIGNAL_OFF, SIGNAL_OFF]
    colours[lit] = (SIGNAL_RED, SIGNAL_OFF, SIGNAL_GREEN)[lit]
    heads = [(0.0, 2.4), (3.6, 5.0)] if arm else [(0.0, 2.4)]
    height = 5.7 if arm else 3.4
    parts = [loft([(0, 0, 0), (0, 0, height)], [0.09, 0.07], DARK_STEEL, sections=7)]
    if arm:
        parts.append(loft([(0, 0, 5.6), (0, 4.0, 5.9)], [0.07, 0.05], DARK_STEEL, sections=6))
    for y, z in heads:
        parts.append(box((-0.32, y - 0.17, z), (-0.08, y + 0.17, z + 0.95), TRIM))
        parts += [
            end_patch(-0.328, (y - 0.11, y + 0.11), (z + 0.67 - 0.3 * i, z + 0.89 - 0.3 * i), c, facing=-1)
            for i, c in enumerate(colours)
        ]
    return assemble(
        f"traffic light {variant}",
        "",
        parts,
        lambda size: points([(0, -size[1] / 2 + 0.17, 1.0), (0, -size[1] / 2 + 0.17, 2.8)], (-3.0, 0.0)),
    )


def sign_post(variant: str) -> Asset:
    """A sign of a person's height on a post: round, triangle, rectangle, or an octagon."""
    sections, radius, rim, panel = {
        "round": (12, 0.33, RED_SHEETING, WHITE_SHEETING),
        "triangle": (3, 0.42, RED_SHEETING, WHITE_SHEETING),
        "rectangle": (4, 0.38, WHITE_SHEETING, BLUE_SHEETING),
        "octagon": (8, 0.34, WHITE_SHEETING, RED_SHEETING),
    }[variant]
    height = {"round": 1.75, "triangle": 1.70, "rectangle": 1.62, "octagon": 1.85}[variant]
    centre = height - radius
    post = loft([(0.03, 0, 0), (0.03, 0, height - 0.1)], [0.035, 0.035], STEEL, sections=6)
    layers = [
        _plate(sections, radius, centre, -0.010, 0.000, STEEL),
        _plate(sections, radius, centre, -0.020, -0.010, rim),
        _plate(sections, 0.74 * radius, centre, -0.028, -0.020, panel),
    ]
    bars = []
    if variant != "triangle":
        mark = TRIM if panel is WHITE_SHEETING else WHITE_SHEETING
        bars = [end_patch(-0.032, (-0.45 * radius, 0.45 * radius), (centre - 0.09, centre + 0.09), mark, facing=-1)]
    return assemble(
        f"sign post {variant}",
        "",
        [post, *layers, *bars],
        lambda size: points([(0, 0, centre), (0, 0, 0.6)], (3.0, -6.0)),
    )


def _plate(sections: int, radius: float, z: float, low: float, high: float, skin: Material) -> Mesh:
    """A regular polygon across the road from x = ``low`` to ``high``; triangles stand on a side."""
    angle = np.pi / 2 + (np.arange(sections) + (0.5 if sections % 2 == 0 else 0.0)) * 2 * np.pi / sections
    outline = [(radius * np.cos(a), z + radius * np.sin(a)) for a in angle]
    return moved(extrude(outline, (high - low) / 2, skin), offset=((low + high) / 2, 0, 0), yaw=-np.pi / 2)


def gantry(variant: str) -> Asset:
    """A sign bridge over the carriageway, or a cantilever over its right half."""
    reach = 7.0
    parts = [
        box((-0.15, y - 0.15, 0), (0.15, y + 0.15, 6.6), STEEL)
        for y in ((-reach, reach) if variant == "bridge" else (-reach,))
    ]
    end = reach if variant == "bridge" else 0.5
    parts += [
        box((x - 0.05, -reach, z - 0.06), (x + 0.05, end, z + 0.06), STEEL) for x in (-0.3, 0.3) for z in (5.7, 6.6)
    ]
    spans = [(-5.8, -1.6), (-0.9, 2.6), (3.2, 6.2)] if variant == "bridge" else [(-5.2, 0.2)]
    for low, high in spans:
        skin = GREEN_SHEETING if high - low < 4 else BLUE_SHEETING
        parts.append(box((-0.46, low, 5.3), (-0.38, high, 7.1), STEEL, back=WHITE_SHEETING))
        parts.append(end_patch(-0.47, (low + 0.08, high - 0.08), (5.38, 7.02), skin, facing=-1))
        for z, share in ((6.45, 0.75), (5.95, 0.55)):
            parts.append(
                end_patch(
                    -0.48,
                    (high - 0.4 - share * (high - low - 0.8), high - 0.4),
                    (z - 0.12, z + 0.12),
                    WHITE_SHEETING,
                    facing=-1,
                )
            )

    def scatter(size) -> Scatterers:
        half = size[1] / 2
        feet = [(0, -half + 0.15, 1.0), (0, half - 0.15, 1.0)][: 2 if variant == "bridge" else 1]
        return Scatterers.concatenate([points(feet, 8.0), line((0, -half, 6.2), (0, half, 6.2), per_metre=6.0)])

    return assemble(f"gantry {variant}", "", parts, scatter)
