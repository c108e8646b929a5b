"""Lorries: box truck, tipper, tractor unit, flatbed."""

from data_gen.assets.shapes.lettering import side_text
from data_gen.assets.shapes.mesh import Asset, Mesh
from data_gen.assets.shapes.palette import (
    ALUMINIUM,
    AMBER,
    CHASSIS,
    CHROME,
    EARTH,
    GLASS,
    HEAD_LAMP,
    PLATE,
    RED_SHEETING,
    STEEL,
    TAIL_LAMP,
    TIMBER,
    TRIM,
    Material,
)
from data_gen.assets.shapes.profiles import assemble, axle, box, end_pair, end_patch, extrude, loft, side_patch
from data_gen.assets.shapes.reflectors import body

TRUCK_SIZES = {
    "box": (7.6, 2.5, 3.3),
    "tipper": (7.0, 2.5, 2.95),
    "tractor": (6.0, 2.5, 3.6),
    "flatbed": (7.4, 2.45, 2.7),
    "small box": (5.9, 2.2, 2.75),
}


def truck(variant: str, paint: Material) -> Asset:
    """A rigid truck or a tractor unit of the named kind; the cab wears the paint."""
    size = length, width, height = TRUCK_SIZES[variant]
    half, cab_length = length / 2, {"tractor": 2.2, "small box": 1.5}.get(variant, 1.75)
    cab_height = {"tractor": height, "small box": 2.2, "box": 2.75}.get(variant, 2.7)
    radius = 0.40 if variant == "small box" else 0.5
    wheels = _truck_wheels(variant, half)
    parts = [
        *_cab(half, cab_length, cab_height, width, paint),
        box((-half + 0.02, -0.45, 0.62), (half - cab_length, 0.45, 0.98), CHASSIS),
        *stern(-half, width, 0.62, 0.9),
        *_load(variant, -half, half - cab_length - 0.12, width, height, paint),
        *(side for x in wheels for side in axle(x, width / 2 - 0.02, radius, 0.36 if x < 1 else 0.28, sections=9)),
    ]
    for side in (-1, 1):  # tanks and guards between the axles
        y = sorted((side * 0.55, side * (width / 2 - 0.05)))
        parts.append(box((wheels[1] + 0.65, y[0], 0.42), (wheels[0] - 0.65, y[1], 0.92), CHASSIS))
    small = variant == "small box"
    return assemble(
        f"truck {variant}",
        "vehicle.truck",
        parts,
        lambda size: body(size, end=18.0 if small else 20.0, side=22.0 if small else 24.0, wheels=wheels, height=0.8),
        size=size,
    )


def _truck_wheels(variant: str, half: float) -> tuple[float, ...]:
    front = half - 1.25 if variant != "small box" else half - 0.95
    return (front, -half + 2.3, -half + 1.05) if variant in ("tipper", "tractor") else (front, -half + 1.7)


def _cab(half: float, length: float, height: float, width: float, paint: Material) -> list[Mesh]:
    """A cab over the engine: raked windscreen, side windows, grille, lamps, bumper."""
    w = width / 2
    sill, top = 0.42 * height + 0.28, 0.42 * height + 1.12
    outline = [
        (half - length, 0.45, TRIM),
        (half - 0.08, 0.38, TRIM),
        (half - 0.03, 0.72),
        (half - 0.02, sill, GLASS),
        (half - 0.20, top),
        (half - 0.55, height - 0.02),
        (half - length + 0.2, height),
        (half - length, height - 0.12),
    ]

    def taper(x, z):
        return w - 0.03 - 0.12 * (z > top)

    window = [
        (half - 0.16, sill + 0.02),
        (half - 0.30, top - 0.1),
        (half - 0.62 * length, top - 0.1),
        (half - 0.62 * length, sill + 0.02),
    ]
    step = [
        (half - 1.75 if length > 1.7 else half - 1.4, 0.46),
        (half - 0.2, 0.46),
        (half - 0.2, 0.66),
        (half - length + 0.3, 0.66),
    ]
    return [
        extrude(outline, taper, paint),
        side_patch(window, taper, GLASS),
        side_patch(step, taper, TRIM),
        end_patch(half + 0.004, (-0.62 * w, 0.62 * w), (0.76, sill - 0.12), TRIM),
        end_patch(half + 0.008, (-0.5 * w, 0.5 * w), (0.98, 1.06), CHROME),
        end_pair(half + 0.012, (0.55 * w, 0.88 * w), (0.5, 0.70), HEAD_LAMP),
        end_patch(half + 0.012, (-0.26, 0.26), (0.45, 0.57), PLATE),
        end_pair(half - 0.5, (0.5 * w, 0.62 * w), (height - 0.12, height - 0.04), AMBER),
    ]


def stern(x: float, width: float, low: float, high: float) -> list[Mesh]:
    """The under-run bar with tail lamps, plate and chequered marking, at the rear end ``x``."""
    w = width / 2
    return [
        box((x, -w + 0.06, low), (x + 0.10, w - 0.06, high), TRIM),
        end_pair(x - 0.008, (0.62 * w, 0.90 * w), (low + 0.03, high - 0.03), TAIL_LAMP, facing=-1),
        end_pair(x - 0.008, (0.30 * w, 0.58 * w), (low + 0.05, high - 0.08), RED_SHEETING, facing=-1),
        end_patch(x - 0.008, (-0.26, 0.26), (low + 0.05, low + 0.17), PLATE, facing=-1),
    ]


def _load(variant: str, rear: float, front: float, width: float, height: float, paint: Material) -> list[Mesh]:
    if variant in ("box", "small box"):
        return box_body(rear, front, width, 0.98, height, WHITE_BOX, stripe=paint, word="CARGO")
    if variant == "tipper":
        return _tipper(rear, front, width, height)
    if variant == "flatbed":
        return [*flatbed(rear, front, width, 1.0), *_pallets(rear + 0.4, front - 0.3, width, 1.14, height)]
    fifth_wheel = loft([(rear + 1.6, 0, 0.98), (rear + 1.6, 0, 1.12)], [0.5, 0.45], STEEL)
    guards = [
        box((rear + 0.3, y - 0.28, 1.05), (rear + 3.0, y + 0.28, 1.09), TRIM)
        for y in (-width / 2 + 0.31, width / 2 - 0.31)
    ]
    stacks = [
        loft([(front + 0.02, y, 0.9), (front + 0.02, y, height - 0.25)], [0.09, 0.09], CHROME, sections=6)
        for y in (-0.9, 0.9)
    ]
    return [fifth_wheel, *guards, *stacks]


WHITE_BOX = Material((0.70, 0.70, 0.68), 0.6, specular=0.1)


def box_body(
    rear: float, front: float, width: float, low: float, height: float, skin: Material, *, stripe: Material, word: str
) -> list[Mesh]:
    """A closed body: edge rails, a stripe of colour with a ``word`` on it along the sides, doors with bars at the back."""
    w = width / 2
    rail = 0.12
    middle = (low + height) / 2
    doors = [
        end_patch(rear - 0.004, (y, y + 0.05), (low + rail, height - rail), STEEL, facing=-1)
        for y in (-0.55, -0.025, 0.5)
    ]
    return [
        box((rear, -w + 0.01, low), (front, w - 0.01, height), skin, top=ALUMINIUM, bottom=CHASSIS),
        side_patch([(rear, low), (front, low), (front, low + rail), (rear, low + rail)], w - 0.01, STEEL),
        side_patch([(rear, height - rail), (front, height - rail), (front, height), (rear, height)], w - 0.01, STEEL),
        side_patch(
            [
                (rear + 0.5, middle - 0.45),
                (front - 1.1, middle - 0.45),
                (front - 0.5, middle + 0.45),
                (rear + 1.1, middle + 0.45),
            ],
            w - 0.01,
            stripe,
        ),
        *side_text(word, ((rear + front) / 2 + 0.1, middle), 0.5, w - 0.01, skin),
        end_patch(rear - 0.004, (-w + 0.02, w - 0.02), (low, low + rail), RED_SHEETING, facing=-1),
        end_patch(rear - 0.004, (-w + 0.02, w - 0.02), (height - rail, height), STEEL, facing=-1),
        *doors,
    ]


def _tipper(rear: float, front: float, width: float, height: float) -> list[Mesh]:
    w = width / 2
    outline = [
        (rear, 1.05),
        (front, 1.05),
        (front, height - 0.05),
        (rear + 0.1, height - 0.35),
        (rear - 0.0, height - 0.4),
    ]
    ribs = [
        side_patch(
            [(x, 1.07), (x + 0.1, 1.07), (x + 0.1, height - 0.4), (x, height - 0.4)], w - 0.03, STEEL, proud=0.025
        )
        for x in (rear + 0.5, rear + 1.5, rear + 2.5, rear + 3.5)
    ]
    heap = extrude(
        [
            (rear + 0.2, height - 0.45),
            (front - 0.1, height - 0.3),
            (front - 1.2, height + 0.02),
            (rear + 1.2, height - 0.05),
        ],
        lambda x, z: w - 0.2 - 0.6 * (z > height - 0.2),
        EARTH,
    )
    shield = box((front - 0.02, -w + 0.05, height - 0.1), (front + 0.55, w - 0.05, height - 0.04), TIPPER_GREY)
    return [extrude(outline, w - 0.03, TIPPER_GREY), *ribs, heap, shield]


TIPPER_GREY = Material((0.17, 0.18, 0.19), 0.3, "metal", 0.1)


def flatbed(rear: float, front: float, width: float, low: float) -> list[Mesh]:
    """An open bed from x = ``rear`` to ``front``, ``width`` across, its underside at ``low``: metres in the body's frame."""
    w = width / 2
    bed = box((rear, -w, low), (front, w, low + 0.14), STEEL, top=TIMBER)
    board = box((front - 0.08, -w, low + 0.14), (front, w, low + 1.0), STEEL)
    return [bed, board]


def _pallets(rear: float, front: float, width: float, low: float, height: float) -> list[Mesh]:
    """Stacked goods of different heights and colours."""
    w, third = width / 2 - 0.15, (front - rear) / 3
    tops = (height, 0.55 * height + 0.45 * low, 0.8 * height + 0.2 * low)
    return [
        box((rear + i * third, -w, low), (rear + (i + 0.9) * third, w, top), skin)
        for i, (top, skin) in enumerate(zip(tops, (TIMBER, BRICKS, WHITE_BOX), strict=True))
    ]


BRICKS = Material((0.34, 0.09, 0.05), 0.4, "brick")
