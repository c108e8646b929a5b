"""Passenger cars: a lower body with wheel houses, a tapered glass house, wheels, lamps, bumpers and plates."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from data_gen.assets.shapes.mesh import Asset, Mesh
from data_gen.assets.shapes.palette import CAR_PAINTS, GLASS, HEAD_LAMP, PLATE, TAIL_LAMP, TRIM, Material
from data_gen.assets.shapes.profiles import arch, assemble, axle, box, end_pair, end_patch, extrude, side_patch
from data_gen.assets.shapes.reflectors import body


@dataclass(frozen=True)
class Shape:
    """A car's side view in metres. ``glass`` is x of the windscreen's foot, the roof's front and rear edge and the rear
    screen's foot; ``belt`` the height of the glass house's foot at the windscreen and at the rear; ``nose`` the height
    of the bonnet's front edge, ``tail`` that of the body's rear edge; ``pillars`` x of the posts between side
    windows."""

    size: tuple[float, float, float]
    wheelbase: float
    radius: float
    nose: float
    belt: tuple[float, float]
    tail: float
    glass: tuple[float, float, float, float]
    pillars: tuple[float, ...]
    floor: float = 0.22
    roof_inset: float = 0.20
    bed: bool = False  # an open load bed behind the glass house
    bed_floor: float = 0.90
    blind: float = -99.0  # side windows end at this x: panel vans


SHAPES = {
    "sedan": Shape((4.75, 1.85, 1.46), 2.80, 0.33, 0.72, (0.97, 1.02), 0.98, (0.98, 0.22, -0.95, -1.68), (-0.32,)),
    "hatchback": Shape((4.05, 1.77, 1.50), 2.55, 0.31, 0.76, (0.99, 1.04), 0.96, (1.02, 0.35, -1.45, -1.90), (-0.22,)),
    "suv": Shape(
        (4.72, 1.96, 1.74), 2.80, 0.38, 0.94, (1.14, 1.18), 1.10, (1.02, 0.42, -1.75, -2.20), (-0.25, -1.25), floor=0.30
    ),
    "estate": Shape(
        (4.80, 1.86, 1.52), 2.85, 0.33, 0.73, (0.97, 1.00), 0.94, (1.00, 0.25, -1.95, -2.30), (-0.30, -1.30)
    ),
    "van": Shape(
        (5.10, 1.98, 2.02),
        3.05,
        0.34,
        0.92,
        (1.16, 1.18),
        1.12,
        (1.72, 1.00, -2.42, -2.50),
        (0.15, -1.10),
        floor=0.24,
        roof_inset=0.14,
    ),
    "pickup": Shape(
        (5.35, 1.95, 1.84),
        3.25,
        0.40,
        1.00,
        (1.18, 1.20),
        1.16,
        (0.95, 0.40, -0.62, -0.78),
        (-0.10,),
        floor=0.38,
        bed=True,
    ),
    "coupe": Shape(
        (4.45, 1.86, 1.33), 2.60, 0.34, 0.66, (0.88, 0.95), 0.90, (0.75, -0.02, -0.72, -1.75), (-0.62,), floor=0.17
    ),
    "panel van": Shape(
        (5.60, 2.05, 2.45),
        3.40,
        0.35,
        1.00,
        (1.26, 1.26),
        1.20,
        (2.00, 1.30, -2.72, -2.78),
        (),
        floor=0.28,
        roof_inset=0.12,
        blind=0.45,
    ),
}


def car(variant: str, paint: Material) -> Asset:
    """A car of the named shape in the given paint."""
    shape = SHAPES[variant]
    parts = [_lower_body(shape, paint), *_glass_house(shape, paint), *_ends(shape, paint)]
    for x in _wheels(shape):
        parts += axle(x, shape.size[1] / 2 - 0.015, shape.radius, 0.22)
    parts += _doors(shape, paint)
    if shape.bed:
        parts += _bed(shape, paint)
    big = shape.size[2] > 1.9
    wheels = _wheels(shape)
    return assemble(
        f"car {variant}",
        "vehicle.car",
        parts,
        lambda size: body(size, end=11.9, side=19.5 if big else 18.0, wheels=wheels, height=0.55),
        size=shape.size,
    )


def _wheels(shape: Shape) -> tuple[float, float]:
    return shape.wheelbase / 2 + 0.06, -shape.wheelbase / 2 + 0.06


def _lower_body(shape: Shape, paint: Material) -> Mesh:
    half, floor = shape.size[0] / 2, shape.floor
    front, rear = _wheels(shape)
    top = [(shape.glass[0] + 0.02, shape.belt[0]), (shape.glass[3] + 0.02, shape.belt[1])]
    if shape.bed:
        top.append((top[1][0] - 0.02, shape.bed_floor))
    stern = shape.bed_floor if shape.bed else shape.tail
    outline = [
        (-half + 0.10, floor, TRIM),
        (-half + 0.36, floor, TRIM),
        *arch(rear, shape.radius, floor),
        *arch(front, shape.radius, floor),
        (half - 0.40, floor, TRIM),
        (half - 0.10, floor, TRIM),
        (half - 0.015, floor + 0.12, TRIM),
        (half, 0.52 * (floor + shape.nose)),
        (half - 0.07, shape.nose),
        (half - 0.40, shape.nose + 0.25 * (shape.belt[0] - shape.nose)),
        *top,
        (-half + 0.36, stern),
        (-half + 0.03, stern),
        (-half, 0.42 * (floor + shape.tail), TRIM),
        (-half + 0.03, floor + 0.14, TRIM),
    ]
    return extrude(outline, lambda x, z: _plan(shape, x), paint)


def _plan(shape: Shape, x: np.ndarray) -> np.ndarray:
    """Half-width of the lower body seen from above: the ends are drawn in."""
    reach = np.abs(x) / (shape.size[0] / 2)
    return shape.size[1] / 2 * np.where(reach > 0.95, 0.92, 1.0)


def _glass_house(shape: Shape, paint: Material) -> list[Mesh]:
    foot, roof_front, roof_rear, rear_foot = shape.glass
    height, half_width = shape.size[2], shape.size[1] / 2

    def taper(x, z):
        low = shape.belt[0]
        return half_width - 0.05 - shape.roof_inset * np.clip((z - low) / (height - low), 0, 1)

    low, high = max(shape.belt) + 0.03, height - 0.11
    house = [
        (foot, shape.belt[0] - 0.03, GLASS),
        (roof_front, height - 0.04),
        (0.6 * roof_front + 0.4 * roof_rear, height),
        (roof_rear, height - 0.03, paint if shape.blind > -9 else GLASS),
        (rear_foot, shape.belt[1] - 0.03),
    ]

    def edge(z, bottom, top, foot_z):
        return bottom + (top - bottom) * (z - foot_z) / (height - 0.03 - foot_z)

    starts = [(edge(z, foot, roof_front, shape.belt[0]) - 0.12) for z in (low, high)]
    ends = [max(edge(z, rear_foot, roof_rear, shape.belt[1]) + 0.16, shape.blind) for z in (low, high)]
    posts = [(starts[0], starts[1]), *((x, x) for x in shape.pillars), (ends[0], ends[1])]
    windows = [
        side_patch([(a[0] - 0.04, low), (b[0] + 0.04, low), (b[1] + 0.04, high), (a[1] - 0.04, high)], taper, GLASS)
        for a, b in pairwise(posts)
    ]
    return [extrude(house, taper, paint), *windows]


def _doors(shape: Shape, paint: Material) -> list[Mesh]:
    """The gaps around the doors, their handles, and mirrors at the foot of the windscreen."""
    half_width, low = shape.size[1] / 2, shape.floor + 0.14
    front, rear = shape.glass[0] - 0.22, _wheels(shape)[1] + shape.radius + 0.10
    seams = [front, *(x for x in shape.pillars if rear < x < front)]
    seams.append(rear if not seams[1:] or seams[-1] > rear + 0.35 else seams.pop())
    parts = []
    for x in seams:
        top = float(np.interp(x, [shape.glass[3], shape.glass[0]], shape.belt[::-1])) - 0.02
        gap = [(x - 0.012, low), (x + 0.012, low), (x + 0.012, top), (x - 0.012, top)]
        parts.append(side_patch(gap, half_width, GAP))
        if x != front:
            handle = [(x + 0.10, top - 0.16), (x + 0.30, top - 0.16), (x + 0.30, top - 0.11), (x + 0.10, top - 0.11)]
            parts.append(side_patch(handle, half_width, TRIM))
    z = shape.belt[0]
    mirrors = [sorted((side * (half_width - 0.19), side * (half_width - 0.01))) for side in (-1, 1)]
    return [*parts, *(box((front - 0.10, y[0], z), (front + 0.02, y[1], z + 0.15), paint, back=GLASS) for y in mirrors)]


def _ends(shape: Shape, paint: Material) -> list[Mesh]:
    half, half_width, nose, floor = shape.size[0] / 2, shape.size[1] / 2, shape.nose, shape.floor
    tail = shape.tail
    lamp = (nose - 0.17, nose - 0.03)
    rear = (tail - 0.24, tail - 0.05) if shape.size[2] < 1.6 else (tail - 0.35, tail + 0.02)
    parts = [
        end_pair(half + 0.004, (0.52 * half_width, 0.89 * half_width), lamp, HEAD_LAMP),
        end_patch(half + 0.004, (-0.46 * half_width, 0.46 * half_width), (lamp[0] - 0.02, lamp[1]), TRIM),
        end_patch(half + 0.008, (-0.26, 0.26), (floor + 0.18, floor + 0.29), PLATE),
        end_pair(-half - 0.004, (0.58 * half_width, 0.90 * half_width), rear, TAIL_LAMP, facing=-1),
        end_patch(-half - 0.008, (-0.26, 0.26), (tail - 0.26, tail - 0.15), PLATE, facing=-1),
    ]
    if shape.blind > -9:  # the rear doors of a panel van have small windows
        glass = (shape.belt[1] + 0.18, shape.size[2] - 0.32)
        parts.append(end_pair(-half - 0.006, (0.06, 0.62 * half_width), glass, GLASS, facing=-1))
    return parts


def _bed(shape: Shape, paint: Material) -> list[Mesh]:
    """The walls of a pickup's load bed."""
    half, half_width, top = shape.size[0] / 2, shape.size[1] / 2, shape.tail
    front, floor = shape.glass[3], shape.bed_floor
    walls = [
        box(
            (-half + 0.06, side * half_width - 0.07 * (side > 0), floor - 0.02),
            (front, side * half_width + 0.07 * (side < 0), top),
            paint,
        )
        for side in (-1, 1)
    ]
    gate = box((-half, -half_width + 0.06, 0.60), (-half + 0.06, half_width - 0.06, top), paint)
    sheet = box((-half + 0.06, -half_width + 0.07, floor - 0.02), (front, half_width - 0.07, floor + 0.015), TRIM)
    return [*walls, gate, sheet]


GAP = Material((0.012, 0.012, 0.013), 0.05)
PAINTS = CAR_PAINTS
