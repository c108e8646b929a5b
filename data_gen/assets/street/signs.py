"""Traffic signs on posts and over the road, with symbols and words. A sign shows its face to a driver who comes along +x."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data_gen.assets.shapes.lettering import ARROW, end_text, symbol, width_of
from data_gen.assets.shapes.mesh import Asset, Mesh, Scatterers
from data_gen.assets.shapes.palette import (
    BLUE_SHEETING,
    GREEN_SHEETING,
    RED_SHEETING,
    STEEL,
    TRIM,
    WHITE_SHEETING,
    YELLOW_SHEETING,
    Material,
)
from data_gen.assets.shapes.profiles import assemble, box, end_patch, extrude, face_patch, loft, moved
from data_gen.assets.shapes.reflectors import line, points


@dataclass(frozen=True)
class Sign:
    """A plate: its top's height and radius in metres, corners, turn in units of a corner, colours of rim and panel, and
    what is on it."""

    top: float
    radius: float
    corners: int
    turn: float
    rim: Material
    panel: Material
    marks: Callable[[float, float], list[Mesh]]  # of the middle's height and the radius


_X = -0.032  # of what is printed


def _bar(z: float, r: float) -> list[Mesh]:
    return [end_patch(_X, (-0.5 * r, 0.5 * r), (z - 0.13 * r, z + 0.13 * r), WHITE_SHEETING, facing=-1)]


def _word(word: str, share: float, material: Material) -> Callable[[float, float], list[Mesh]]:
    return lambda z, r: end_text(word, _X, (0.0, z), share * r, material)


def _warning(z: float, r: float) -> list[Mesh]:
    return [
        end_patch(_X, (-0.07 * r, 0.07 * r), (z - 0.05 * r, z + 0.42 * r), TRIM, facing=-1),
        end_patch(_X, (-0.07 * r, 0.07 * r), (z - 0.25 * r, z - 0.13 * r), TRIM, facing=-1),
    ]


def _bend(z: float, r: float) -> list[Mesh]:
    outline = [(0.1, -0.3), (0.1, 0.0), (-0.1, 0.2), (-0.02, 0.28), (-0.3, 0.3), (-0.28, 0.02), (-0.2, 0.1), (-0.02, -0.08),
               (-0.02, -0.3)]  # fmt: skip
    return [symbol(outline, _X, (0.0, z), r, TRIM)]


def _walker(z: float, r: float) -> list[Mesh]:
    """A dark figure that strides, on a white triangle."""
    ground = symbol([(-0.62, -0.5), (0.62, -0.5), (0.0, 0.55)], _X + 0.003, (0.0, z), r, WHITE_SHEETING)
    body = [(-0.25, -0.42), (-0.12, -0.42), (0.0, -0.18), (0.12, -0.42), (0.25, -0.42), (0.07, 0.02), (0.07, 0.14),
            (-0.07, 0.14), (-0.07, 0.02)]  # fmt: skip
    head = [(0.07 * np.cos(a), 0.23 + 0.07 * np.sin(a)) for a in np.arange(6) * np.pi / 3]
    return [ground, symbol(body, _X, (0.0, z), r, TRIM), symbol(head, _X, (0.0, z), r, TRIM)]


def _arrow(z: float, r: float) -> list[Mesh]:
    return [symbol(ARROW, _X, (0.0, z), 1.25 * r, WHITE_SHEETING)]


def _nothing(z: float, r: float) -> list[Mesh]:
    return []


# Half of them are as tall as a person, and are mistaken for one by the LiDAR; people pass below the others.
SIGNS = {
    "round": Sign(1.75, 0.33, 12, 0.0, RED_SHEETING, RED_SHEETING, _bar),
    "triangle": Sign(1.70, 0.42, 3, 0.0, RED_SHEETING, WHITE_SHEETING, _warning),
    "rectangle": Sign(1.62, 0.38, 4, 0.5, WHITE_SHEETING, BLUE_SHEETING, _word("P", 0.8, WHITE_SHEETING)),
    "octagon": Sign(1.85, 0.36, 8, 0.5, WHITE_SHEETING, RED_SHEETING, _word("STOP", 0.45, WHITE_SHEETING)),
    "ahead": Sign(1.68, 0.32, 12, 0.0, BLUE_SHEETING, BLUE_SHEETING, _arrow),
    "yield": Sign(1.78, 0.44, 3, 0.5, RED_SHEETING, WHITE_SHEETING, _nothing),
    "limit 50": Sign(2.92, 0.35, 12, 0.0, RED_SHEETING, WHITE_SHEETING, _word("50", 0.7, TRIM)),
    "limit 80": Sign(3.0, 0.38, 12, 0.0, RED_SHEETING, WHITE_SHEETING, _word("80", 0.7, TRIM)),
    "bend": Sign(2.95, 0.48, 3, 0.0, RED_SHEETING, WHITE_SHEETING, _bend),
    "crossing": Sign(2.9, 0.46, 4, 0.5, WHITE_SHEETING, BLUE_SHEETING, _walker),
    "priority": Sign(3.05, 0.42, 4, 0.0, WHITE_SHEETING, YELLOW_SHEETING, _nothing),
}
TOWNS = {"finger": ("CENTRE", WHITE_SHEETING, TRIM), "finger far": ("RIVERTON", BLUE_SHEETING, WHITE_SHEETING)}
"""Signs in the shape of an arrow that name a place."""


def sign_post(variant: str) -> Asset:
    """A sign on a post, of a person's height or above their heads."""
    if variant in TOWNS:
        return _finger_post(variant)
    sign = SIGNS[variant]
    turned = sign.corners % 2 == 1 and sign.turn
    centre = sign.top - sign.radius * (0.5 if turned else np.cos(np.pi / sign.corners) if sign.turn else 1.0)
    post = loft([(0.03, 0, 0), (0.03, 0, sign.top - 0.1)], [0.035, 0.035], STEEL, sections=6)
    layers = [
        _plate(sign, 1.0, centre, -0.010, 0.000, STEEL),
        _plate(sign, 1.0, centre, -0.020, -0.010, sign.rim),
        _plate(sign, 0.80 if sign.corners > 3 else 0.68, centre, -0.028, -0.020, sign.panel),
    ]
    return assemble(
        f"sign post {variant}",
        "",
        [post, *layers, *sign.marks(centre, sign.radius)],
        lambda size: points([(0, 0, centre), (0, 0, 0.6)], (3.0, -6.0)),
    )


def _plate(sign: Sign, share: float, z: float, low: float, high: float, skin: Material) -> Mesh:
    """The plate's polygon, ``share`` of its radius, across the road from x = ``low`` to ``high``; the first corner is on
    top but for the turn."""
    angle = np.pi / 2 + (np.arange(sign.corners) + sign.turn) * 2 * np.pi / sign.corners
    outline = [(share * sign.radius * np.cos(a), z + share * sign.radius * np.sin(a)) for a in angle]
    return moved(extrude(outline, (high - low) / 2, skin), offset=((low + high) / 2, 0, 0), yaw=-np.pi / 2)


def _finger_post(variant: str) -> Asset:
    word, skin, ink = TOWNS[variant]
    half, z = width_of(word, 0.2) / 2 + 0.12, 2.55
    outline = [(half, z - 0.2), (half, z + 0.2), (-half, z + 0.2), (-half - 0.22, z), (-half, z - 0.2)]
    back = moved(extrude([(-y, z) for y, z in outline], 0.01, STEEL), yaw=-np.pi / 2)
    board = [back, face_patch(-0.012, outline, skin, facing=-1)]
    post = loft([(0.045, 0, 0), (0.045, 0, z + 0.15)], [0.035, 0.035], STEEL, sections=6)
    return assemble(
        f"sign post {variant}",
        "",
        [post, *board, *end_text(word, -0.02, (0.0, z), 0.2, ink)],
        lambda size: points([(0, 0, z), (0, 0, 0.6)], (6.0, -6.0)),
    )


# One panel of a gantry: from y to y, colour, words; an arrow points down to the lane
_PANELS: dict[str, list[tuple[tuple[float, float], Material, tuple[str, ...]]]] = {
    "bridge": [
        ((-5.8, -1.6), BLUE_SHEETING, ("CENTRE", "A 17")),
        ((-0.9, 2.6), GREEN_SHEETING, ("LAKES", "E 45")),
        ((3.2, 6.2), GREEN_SHEETING, ("NORTH",)),
    ],
    "cantilever": [((-5.2, 0.2), BLUE_SHEETING, ("AIRPORT", "EXIT 23"))],
}
_DOWN = [(y, -z) for y, z in ARROW[::-1]]


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
    for (low, high), skin, words in _PANELS[variant]:
        parts.append(box((-0.46, low, 5.3), (-0.38, high, 7.3), STEEL, back=WHITE_SHEETING))
        parts.append(end_patch(-0.47, (low + 0.08, high - 0.08), (5.38, 7.22), skin, facing=-1))
        middle = (low + high) / 2
        for i, word in enumerate(words):
            parts += end_text(word, -0.48, (middle + 0.45, 6.75 - 0.62 * i), 0.42, WHITE_SHEETING)
        parts.append(symbol(_DOWN, -0.48, (low + 0.55, 6.1), 0.9, WHITE_SHEETING))

    def scatter(size) -> Scatterers:
        half = size[1] / 2
        feet = [(0, -half + 0.15, 1.0), (0, half - 0.15, 1.0)][: 2 if variant == "bridge" else 1]
        return Scatterers.concatenate([points(feet, 8.0), line((0, -half, 6.2), (0, half, 6.2), per_metre=6.0)])

    return assemble(f"gantry {variant}", "", parts, scatter)
