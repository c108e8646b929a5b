"""Machines of a construction site: excavator, wheel loader, road roller, articulated dumper."""

from collections.abc import Callable

from data_gen.assets.shapes.mesh import Asset, Mesh
from data_gen.assets.shapes.palette import (
    AMBER,
    DARK_STEEL,
    EARTH,
    GLASS,
    HEAD_LAMP,
    MACHINE_ORANGE,
    MACHINE_YELLOW,
    STEEL,
    TAIL_LAMP,
    TRIM,
    TYRE,
    Material,
)
from data_gen.assets.shapes.profiles import assemble, axle, box, end_pair, extrude, loft, moved, side_patch
from data_gen.assets.shapes.reflectors import body

YELLOW = MACHINE_YELLOW


def construction_vehicle(variant: str, paint: Material) -> Asset:
    """The named machine; the paint is the maker's yellow or orange."""
    parts, wheels, size = MACHINES[variant](paint)
    return assemble(
        f"construction vehicle {variant}",
        "vehicle.construction",
        parts,
        lambda size: body(size, end=18.0, side=22.0, wheels=wheels, height=0.9),
        size=size,
    )


Built = tuple[list[Mesh], tuple[float, ...], tuple[float, float, float]]


def _cabin(
    rear: float, front: float, y: float, half_width: float, low: float, high: float, paint: Material
) -> list[Mesh]:
    """A cabin nearly all of glass under a painted roof, with a beacon on top."""
    outline = [
        (rear, low),
        (front, low, GLASS),
        (front + 0.05, low + 0.5, GLASS),
        (front - 0.12, high - 0.1),
        (front - 0.1, high),
        (rear - 0.03, high),
        (rear - 0.03, high - 0.1, GLASS),
        (rear, low + 0.5),
    ]
    length = front - rear
    panes = [
        (rear + 0.1, low + 0.15),
        (rear + 0.52 * length, low + 0.15),
        (rear + 0.52 * length, high - 0.16),
        (rear + 0.1, high - 0.16),
    ]
    door = [
        (rear + 0.60 * length, low + 0.15),
        (front - 0.06, low + 0.15),
        (front - 0.16, high - 0.16),
        (rear + 0.60 * length, high - 0.16),
    ]
    glass = [moved(side_patch(p, half_width, GLASS), offset=(0, y, 0)) for p in (panes, door)]
    beacon = loft([(rear + 0.2, y, high), (rear + 0.2, y, high + 0.14)], [0.08, 0.06], AMBER, sections=6)
    return [extrude(outline, half_width, paint, y=y), *glass, beacon]


def _excavator(paint: Material) -> Built:
    """Tracks, an upper carriage with counterweight, and an arm that folds down in front."""
    stadium = [
        (-1.85, 0.35),
        (-1.55, 0.02),
        (1.55, 0.02),
        (1.85, 0.35),
        (1.85, 0.55),
        (1.55, 0.85),
        (-1.55, 0.85),
        (-1.85, 0.55),
    ]
    tracks = [extrude(stadium, 0.3, TYRE, sides=DARK_STEEL, y=y) for y in (-1.1, 1.1)]
    rollers = [
        loft([(x, side * 1.38, 0.42), (x, side * 1.43, 0.42)], [0.24, 0.2], STEEL, sections=6)
        for x in (-1.3, 0, 1.3)
        for side in (-1, 1)
    ]
    deck = extrude(
        [
            (-2.35, 1.05, DARK_STEEL),
            (1.35, 1.05),
            (1.35, 1.35),
            (0.2, 1.4),
            (-0.2, 1.95),
            (-1.5, 2.1),
            (-2.45, 2.05),
            (-2.5, 1.3),
        ],
        1.3,
        paint,
    )
    rear = box((-2.62, -1.25, 1.12), (-2.35, 1.25, 1.98), DARK_STEEL)
    boom = extrude(
        [(0.9, 1.3), (1.25, 1.25), (2.55, 2.75), (3.55, 2.72), (3.6, 3.0), (2.4, 3.18), (2.1, 3.0), (0.85, 1.7)],
        0.2,
        paint,
        y=-0.25,
    )
    stick = extrude([(3.3, 3.12), (3.62, 3.0), (3.75, 1.15), (3.5, 1.1)], 0.15, paint, y=-0.25)
    ram = loft([(1.15, -0.25, 1.75), (2.3, -0.25, 2.65)], [0.06, 0.06], STEEL, sections=6)
    bucket = extrude(
        [(3.65, 1.3), (3.75, 0.95), (3.6, 0.5), (3.1, 0.35), (2.75, 0.55), (2.75, 0.75), (3.1, 0.8), (3.4, 1.25)],
        0.5,
        DARK_STEEL,
        y=-0.25,
    )
    house = _cabin(0.05, 1.3, 0.8, 0.48, 1.3, 2.9, paint)
    base = loft([(0, 0, 0.6), (0, 0, 1.06)], [0.75, 0.75], DARK_STEEL, sections=8)
    stripe = side_patch([(-2.3, 1.45), (-0.6, 1.45), (-0.7, 1.75), (-2.3, 1.75)], 1.3, TRIM)
    body_parts = [*tracks, *rollers, base, deck, rear, stripe, boom, stick, ram, bucket, *house]
    return body_parts, (-1.3, 1.3), (6.4, 2.8, 3.2)


def _wheel_loader(paint: Material) -> Built:
    """Big wheels, engine behind, glass cabin amidships, bucket in front."""
    rear = extrude(
        [(-3.3, 0.75, DARK_STEEL), (-0.4, 0.65), (-0.4, 1.75), (-1.2, 1.85), (-3.0, 1.75), (-3.35, 1.5)], 0.75, paint
    )
    neck = extrude([(-0.45, 0.65), (1.5, 0.65), (1.7, 1.0), (1.2, 1.75), (0.7, 1.75), (-0.45, 1.2)], 0.5, paint)
    arms = [
        extrude([(0.8, 1.75), (1.05, 1.45), (2.35, 0.45), (2.6, 0.6), (1.4, 1.75), (1.0, 1.95)], 0.1, paint, y=y)
        for y in (-0.55, 0.55)
    ]
    bucket = extrude(
        [(2.45, 0.1), (3.35, 0.06), (3.4, 0.12), (2.75, 0.3), (2.6, 0.8), (2.95, 1.25), (2.85, 1.35), (2.35, 0.95)],
        1.38,
        DARK_STEEL,
    )
    guards = [
        box((x - 0.7, y - 0.3, 1.5), (x + 0.7, y + 0.3, 1.58), paint) for x in (-1.75, 1.25) for y in (-1.02, 1.02)
    ]
    wheels = [w for x in (-1.75, 1.25) for w in axle(x, 1.36, 0.74, 0.58, sections=12, rim=paint)]
    lamps = [
        end_pair(1.2, (0.3, 0.48), (1.8, 1.95), HEAD_LAMP),
        end_pair(-3.37, (0.45, 0.7), (1.3, 1.48), TAIL_LAMP, facing=-1),
    ]
    stack = loft([(-2.0, 0.4, 1.7), (-2.0, 0.4, 2.5)], [0.07, 0.07], DARK_STEEL, sections=6)
    grille = side_patch([(-3.1, 1.0), (-1.6, 1.0), (-1.6, 1.5), (-3.1, 1.5)], 0.75, TRIM)
    house = _cabin(-1.15, 0.35, 0.0, 0.68, 1.75, 3.25, paint)
    return [rear, neck, *arms, bucket, *guards, *wheels, *lamps, stack, grille, *house], (1.25, -1.75), (6.9, 2.8, 3.3)


def _roller(paint: Material) -> Built:
    """Two steel drums across the full width, a driver's canopy on four posts."""
    drums = [
        loft([(x, -0.84, 0.62), (x, 0.84, 0.62)], [0.62, 0.62], STEEL, sections=14, caps=(DARK_STEEL, DARK_STEEL))
        for x in (-1.65, 1.65)
    ]
    frame = extrude(
        [
            (-0.95, 0.5, DARK_STEEL),
            (0.95, 0.5),
            (1.0, 1.3),
            (2.3, 1.3),
            (2.3, 1.62),
            (0.9, 1.7),
            (-0.9, 1.55),
            (-2.3, 1.55),
            (-2.3, 1.3),
            (-1.0, 1.3),
        ],
        0.88,
        paint,
    )
    yokes = [
        extrude([(x - 0.14, 0.5), (x + 0.14, 0.5), (x + 0.2, 1.32), (x - 0.2, 1.32)], 0.05, paint, y=y)
        for x in (-1.65, 1.65)
        for y in (-0.93, 0.93)
    ]
    posts = [
        box((x - 0.04, y - 0.04, 1.5), (x + 0.04, y + 0.04, 2.85), TRIM) for x in (-0.85, 0.75) for y in (-0.74, 0.74)
    ]
    roof = box((-1.15, -0.9, 2.85), (1.1, 0.9, 2.98), paint)
    seat = extrude([(-0.6, 1.6), (-0.1, 1.6), (-0.1, 1.95), (-0.45, 2.0), (-0.55, 2.5), (-0.7, 2.5)], 0.28, TRIM)
    desk = extrude([(0.25, 1.6), (0.6, 1.6), (0.5, 2.25), (0.3, 2.2)], 0.35, TRIM)
    stripe = side_patch([(-0.85, 0.75), (0.85, 0.75), (0.85, 1.05), (-0.85, 1.05)], 0.88, TRIM)
    lamps = [
        end_pair(2.305, (0.5, 0.75), (1.38, 1.55), HEAD_LAMP),
        end_pair(-2.305, (0.5, 0.75), (1.36, 1.5), TAIL_LAMP, facing=-1),
    ]
    beacon = loft([(0.0, 0, 2.98), (0.0, 0, 3.1)], [0.09, 0.07], AMBER, sections=6)
    return [*drums, frame, *yokes, *posts, roof, seat, desk, stripe, *lamps, beacon], (1.65, -1.65), (4.7, 2.0, 3.1)


def _dumper(paint: Material) -> Built:
    """An articulated dumper: low bonnet and cabin in front, a heaped tub over two axles behind."""
    bonnet = extrude(
        [(1.1, 0.75, DARK_STEEL), (3.5, 0.8), (3.6, 1.1), (3.5, 1.75), (2.4, 1.95), (1.1, 1.95)], 1.05, paint
    )
    house = _cabin(1.15, 2.45, 0.0, 0.85, 1.9, 3.2, paint)
    tub = extrude(
        [
            (-3.0, 1.15),
            (0.55, 1.1),
            (0.85, 1.6),
            (0.85, 2.75),
            (0.95, 3.0),
            (0.6, 3.0),
            (-2.6, 2.55),
            (-3.6, 2.2),
            (-3.55, 1.9),
        ],
        lambda x, z: 0.95 + 0.4 * (z > 1.7),
        paint,
    )
    heap = extrude([(-2.5, 2.45), (0.3, 2.75), (-0.2, 3.15), (-1.5, 3.05)], lambda x, z: 1.05 - 0.6 * (z > 2.9), EARTH)
    spine = box((-3.2, -0.4, 0.65), (1.2, 0.4, 1.15), DARK_STEEL)
    wheels = [w for x in (2.35, -1.0, -2.6) for w in axle(x, 1.4, 0.72, 0.55, sections=11, rim=paint)]
    lamps = [
        end_pair(3.61, (0.55, 0.9), (1.25, 1.45), HEAD_LAMP),
        end_pair(-3.21, (0.15, 0.38), (0.8, 1.0), TAIL_LAMP, facing=-1),
    ]
    grille = box((3.58, -0.5, 1.0), (3.63, 0.5, 1.6), TRIM)
    return [bonnet, *house, tub, heap, spine, *wheels, *lamps, grille], (2.35, -1.0, -2.6), (7.2, 2.85, 3.3)


MACHINES: dict[str, Callable[[Material], Built]] = {
    "excavator": _excavator,
    "wheel loader": _wheel_loader,
    "roller": _roller,
    "dumper": _dumper,
}
PAINTS = (MACHINE_YELLOW, MACHINE_ORANGE)
