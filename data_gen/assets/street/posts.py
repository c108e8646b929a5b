"""Posts and what they carry: masts, lamps, signals.

What has a front shows it to a driver who comes along +x: its face looks towards -x. Arms reach to the left (+y).
"""

from data_gen.assets.shapes.mesh import Asset, Scatterers
from data_gen.assets.shapes.palette import (
    DARK_STEEL,
    STEEL,
    TIMBER,
    TRIM,
    WHITE_SHEETING,
    Material,
)
from data_gen.assets.shapes.profiles import assemble, box, end_patch, loft
from data_gen.assets.shapes.reflectors import points
from data_gen.assets.street.roadworks import PLASTIC_WHITE


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
        lambda size: points([(0, 0, min(1.0, 0.6 * size[2]))], 6.0 if variant == "mast" else -4.0),
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
        return points([(0, foot, 1.0), (0, foot, 3.0)], (3.0, 1.0))

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
        lambda size: points([(0, -size[1] / 2 + 0.17, 1.0), (0, -size[1] / 2 + 0.17, 2.8)], (2.0, 3.0)),
    )
