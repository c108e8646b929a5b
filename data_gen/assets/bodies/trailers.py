"""Semi-trailers: box, tanker, flatbeds with timber and with containers."""

from data_gen.assets.bodies.trucks import WHITE_BOX, box_body, flatbed, stern
from data_gen.assets.shapes.mesh import Asset, Mesh
from data_gen.assets.shapes.palette import (
    ALUMINIUM,
    CHASSIS,
    STEEL,
    TIMBER,
    Material,
)
from data_gen.assets.shapes.profiles import assemble, axle, box, end_pair, end_patch, loft, side_patch
from data_gen.assets.shapes.reflectors import body

TRAILER_SIZES = {
    "box": (12.4, 2.55, 3.95),
    "tanker": (11.2, 2.5, 3.55),
    "flatbed timber": (12.2, 2.5, 3.3),
    "flatbed container": (12.4, 2.5, 3.9),
}


def trailer(variant: str, paint: Material) -> Asset:
    """A semi-trailer; its front end overlaps the tractor unit's fifth wheel."""
    size = length, width, height = TRAILER_SIZES[variant]
    half, w = length / 2, width / 2
    wheels = (-half + 3.6, -half + 2.3, -half + 1.0)
    legs = [box((half - 2.7, y - 0.07, 0.12), (half - 2.56, y + 0.07, 1.0), STEEL) for y in (-0.7, 0.7)]
    feet = [box((half - 2.8, y - 0.16, 0.08), (half - 2.46, y + 0.16, 0.12), STEEL) for y in (-0.7, 0.7)]
    parts = [
        box((-half + 0.02, -0.5, 0.85), (half - 0.1, 0.5, 1.2), CHASSIS),
        *stern(-half, width, 0.62, 0.92),
        *(side for x in wheels for side in axle(x, w - 0.02, 0.5, 0.38, sections=8)),
        *legs,
        *feet,
    ]
    if variant == "box":
        parts += box_body(
            -half + 0.02,
            half,
            width,
            1.15,
            height,
            WHITE_BOX if paint.albedo[0] < 0.6 else paint,
            stripe=paint,
            word="EUROLINE",
        )
        parts.append(
            side_patch(
                [(-half + 4.3, 0.5), (half - 2.9, 0.5), (half - 2.9, 1.05), (-half + 4.3, 1.05)], w - 0.08, STEEL
            )
        )
    elif variant == "tanker":
        parts += _tank(half, width, height, paint)
    else:
        parts += flatbed(-half, half, width, 1.15)
        parts += _timber(half, w, height) if variant == "flatbed timber" else _container(half, w, height, paint)
    return assemble(
        f"trailer {variant}",
        "vehicle.trailer",
        parts,
        lambda size: body(size, end=20.0, side=25.5, wheels=wheels, height=1.0),
        size=size,
    )


def _tank(half: float, width: float, height: float, paint: Material) -> list[Mesh]:
    w, middle, tall = width / 2, (1.15 + height) / 2, (height - 1.15) / 2
    x = (-half + 0.05, -half + 0.4, -half + 3.5, -half + 3.7, half - 3.7, half - 3.5, half - 0.4, half - 0.05)
    # across an x-directed loft the first radius is along y, the second along z
    radii = [(0.6 * w, 0.6 * tall), *[(0.98 * w, 0.95 * tall)] * 6, (0.6 * w, 0.6 * tall)]
    skins = (ALUMINIUM, ALUMINIUM, paint, ALUMINIUM, paint, ALUMINIUM, ALUMINIUM)
    hatches = [
        loft([(a, 0, height - 0.2), (a, 0, height)], [0.3, 0.3], STEEL, sections=8) for a in (-half + 2, 0.0, half - 2)
    ]
    diamond = end_patch(-half + 0.03, (-0.3, 0.3), (middle - 0.3, middle + 0.3), ORANGE_PLATE, facing=-1)
    return [loft([(a, 0.0, middle) for a in x], radii, skins, sections=12), *hatches, diamond]


ORANGE_PLATE = Material((0.85, 0.25, 0.01), 0.9)


def _timber(half: float, w: float, height: float) -> list[Mesh]:
    """Logs between stanchions."""
    radius, rows = 0.27, []
    for row, z in enumerate((1.56, 2.02, 2.48, 2.94)):
        rows += [
            loft([(-half + 0.3, y, z), (half - 0.35, y, z)], [radius, radius], TIMBER, sections=6, caps=(CUT, CUT))
            for y in ([-0.8, -0.27, 0.27, 0.8] if row % 2 == 0 else [-0.54, 0.0, 0.54])
        ]
    posts = [
        box((x - 0.06, y - 0.05, 1.2), (x + 0.06, y + 0.05, height), STEEL)
        for x in (-half + 1, 0.0, half - 1.2)
        for y in (-w + 0.06, w - 0.06)
    ]
    return [*rows, *posts]


CUT = Material((0.55, 0.38, 0.19), 0.5, "wood")


def _container(half: float, w: float, height: float, paint: Material) -> list[Mesh]:
    """Two sea containers with ribbed sides."""
    parts = []
    other = BRICKS_RED if paint.albedo[0] < 0.3 else CONTAINER_GREEN
    for rear, front, skin in ((-half + 0.05, -0.06, paint), (0.06, half - 0.12, other)):
        parts.append(box((rear, -w + 0.03, 1.3), (front, w - 0.03, height), skin))
        dark = skin.darker(0.55)
        step = (front - rear) / 6
        parts += [
            side_patch(
                [
                    (rear + (i + 0.3) * step, 1.45),
                    (rear + (i + 0.7) * step, 1.45),
                    (rear + (i + 0.7) * step, height - 0.15),
                    (rear + (i + 0.3) * step, height - 0.15),
                ],
                w - 0.03,
                dark,
            )
            for i in range(6)
        ]
    parts.append(end_pair(-half + 0.045, (0.08, w - 0.15), (1.45, height - 0.15), DOOR, facing=-1))
    return parts


BRICKS_RED = Material((0.40, 0.06, 0.03), 0.35, "metal", 0.05)
CONTAINER_GREEN = Material((0.02, 0.20, 0.12), 0.3, "metal", 0.05)
DOOR = WHITE_BOX.darker(0.75)
