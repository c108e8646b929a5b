"""Motorcycles, ridden and parked: sports machine, tourer with cases, scooter."""

from data_gen.assets.bodies.people import Joints, Look, figure
from data_gen.assets.shapes.mesh import Asset, Mesh
from data_gen.assets.shapes.palette import (
    CHROME,
    CLOTHES,
    DARK_STEEL,
    GLASS,
    HAIRS,
    HEAD_LAMP,
    LEATHER,
    MOTORCYCLE_PAINTS,
    PLATE,
    RIM,
    SKINS,
    STEEL,
    TAIL_LAMP,
    TRIM,
    TYRE,
    Material,
)
from data_gen.assets.shapes.profiles import assemble, box, end_patch, extrude, loft, rod
from data_gen.assets.shapes.reflectors import body

MOTORCYCLES = ("sport rider", "touring rider", "scooter rider", "sport parked", "touring parked", "scooter parked")


def _rider(hips, shoulders, head, knee, ankle, elbow, hand, look: Look, height: float = 1.76) -> list[Mesh]:
    """A person whose limbs are symmetric but for the feet: joints (x, y, z) of the left, mirrored to the right."""

    def pair(point):
        return [point, (point[0], -point[1], point[2])]

    knees, ankles = pair(knee), pair(ankle)
    return figure(Joints(hips, shoulders, head, knees, ankles, pair(elbow), pair(hand)), look, height)


def motorcycle(variant: str, paint: int) -> Asset:
    """The named motorcycle; ``paint`` picks its lacquer and what the rider wears."""
    skin = MOTORCYCLE_PAINTS[paint]
    kind, use = variant.split()
    parts = {"sport": _sport, "touring": _touring, "scooter": _scooter}[kind](skin)
    if use == "rider":
        top, bottom, _ = CLOTHES[(2 * paint + 3) % len(CLOTHES)]
        look = Look(LEATHER if kind == "sport" else top, bottom, LEATHER, SKINS[0], HAIRS[0], hat=skin)
        if kind == "scooter":
            parts += _rider(
                (-0.32, 0, 0.86),
                (-0.22, 0, 1.36),
                (-0.18, 0, 1.58),
                (0.12, 0.16, 0.78),
                (0.10, 0.14, 0.36),
                (-0.02, 0.27, 1.15),
                (0.33, 0.28, 1.08),
                look,
            )
        else:
            x = 0.16 if kind == "sport" else -0.02
            parts += _rider(
                (-0.32, 0, 0.90),
                (-0.10 + x, 0, 1.34),
                (0.0 + x, 0, 1.55),
                (0.08, 0.20, 0.72),
                (-0.22, 0.19, 0.38),
                (0.20, 0.33, 1.10),
                (0.45, 0.30, 1.02),
                look,
            )

    def scatter(size):
        return body(size, end=4.0, side=6.5, wheels=(0.6, -0.6), height=0.55, spacing=0.9)

    return assemble(f"motorcycle {variant}", "vehicle.motorcycle", parts, scatter)


def _rolling(x_front: float, x_rear: float, radius: float) -> list[Mesh]:
    """Two solid wheels with rims."""
    return [
        loft(
            [(x, y, radius) for y in (-0.075, -0.07, 0, 0.07, 0.075)],
            [0.55 * radius, 0.88 * radius, radius, 0.88 * radius, 0.55 * radius],
            TYRE,
            sections=10,
            caps=(RIM, RIM),
        )
        for x in (x_front, x_rear)
    ]


def _lights(front: float, rear: float, z_front: float, z_rear: float) -> list[Mesh]:
    return [
        end_patch(front, (-0.09, 0.09), (z_front - 0.07, z_front + 0.07), HEAD_LAMP),
        end_patch(rear, (-0.09, 0.09), (z_rear - 0.04, z_rear + 0.04), TAIL_LAMP, facing=-1),
        end_patch(rear + 0.01, (-0.09, 0.09), (z_rear - 0.20, z_rear - 0.06), PLATE, facing=-1),
    ]


def _sport(skin: Material) -> list[Mesh]:
    fairing = extrude(
        [
            (0.25, 0.35),
            (0.62, 0.62),
            (0.80, 0.88),
            (0.62, 1.10),
            (0.45, 0.98),
            (0.10, 0.92),
            (-0.15, 0.60),
            (-0.05, 0.35),
        ],
        lambda x, z: 0.20 - 0.08 * (x > 0.5),
        skin,
    )
    screen = extrude([(0.62, 1.08), (0.50, 1.24), (0.42, 1.0)], 0.11, GLASS)
    tail = extrude(
        [(-0.15, 0.80, LEATHER), (-0.55, 0.86, LEATHER), (-0.95, 1.02), (-0.98, 0.94), (-0.50, 0.70), (-0.15, 0.66)],
        lambda x, z: 0.15 - 0.06 * (x < -0.8),
        skin,
    )
    engine = box((-0.30, -0.17, 0.30), (0.25, 0.17, 0.68), DARK_STEEL)
    exhaust = loft([(0.0, -0.20, 0.32), (-0.75, -0.22, 0.60)], [0.06, 0.08], CHROME, sections=6)
    fork = [rod([(0.74, y, 0.32), (0.50, y, 1.0)], 0.035, STEEL) for y in (-0.09, 0.09)]
    swing = [rod([(-0.70, y, 0.32), (-0.15, y, 0.45)], 0.04, DARK_STEEL) for y in (-0.10, 0.10)]
    bars = rod([(0.45, -0.33, 0.99), (0.45, 0.33, 0.99)], 0.025, TRIM)
    return [
        *_rolling(0.74, -0.70, 0.32),
        fairing,
        screen,
        tail,
        engine,
        exhaust,
        *fork,
        *swing,
        bars,
        *_lights(0.81, -0.99, 0.88, 0.97),
    ]


def _touring(skin: Material) -> list[Mesh]:
    tank = extrude([(0.35, 0.80), (0.38, 1.0), (0.05, 1.05), (-0.20, 0.86), (-0.20, 0.74)], 0.17, skin)
    seat = extrude([(-0.18, 0.76), (-0.20, 0.88), (-0.62, 0.90), (-0.95, 0.98), (-1.0, 0.80)], 0.17, LEATHER)
    screen = extrude([(0.56, 0.95, GLASS), (0.40, 1.42, GLASS), (0.34, 1.40), (0.42, 0.95)], 0.20, skin)
    cases = [box((-1.02, y - 0.12, 0.48), (-0.50, y + 0.12, 0.84), skin) for y in (-0.31, 0.31)]
    top_case = box((-1.14, -0.22, 0.98), (-0.78, 0.22, 1.26), skin)
    engine = box((-0.32, -0.26, 0.30), (0.28, 0.26, 0.70), DARK_STEEL)
    pipe = loft([(0.15, -0.24, 0.30), (-0.95, -0.26, 0.36)], [0.05, 0.065], CHROME, sections=6)
    fork = [rod([(0.86, y, 0.34), (0.45, y, 1.08)], 0.04, CHROME) for y in (-0.10, 0.10)]
    guard = extrude(
        [(0.55, 0.62), (0.72, 0.74), (1.0, 0.72), (1.14, 0.55), (1.1, 0.5), (0.9, 0.66), (0.62, 0.55)], 0.09, skin
    )
    bars = rod([(0.38, -0.40, 1.12), (0.38, 0.40, 1.12)], 0.025, CHROME)
    return [
        *_rolling(0.86, -0.74, 0.34),
        tank,
        seat,
        screen,
        *cases,
        top_case,
        engine,
        pipe,
        *fork,
        guard,
        bars,
        *_lights(0.60, -1.15, 0.98, 0.92),
    ]


def _scooter(skin: Material) -> list[Mesh]:
    shield = extrude([(0.60, 0.30), (0.66, 0.40), (0.48, 1.02), (0.38, 1.04), (0.44, 0.62), (0.30, 0.32)], 0.22, skin)
    step = box((-0.20, -0.20, 0.26), (0.36, 0.20, 0.34), TRIM)
    rear = extrude(
        [(-0.15, 0.28), (-0.12, 0.62), (-0.05, 0.74), (-0.85, 0.80), (-0.95, 0.66), (-0.62, 0.36)], 0.20, skin
    )
    seat = extrude([(-0.06, 0.74), (-0.10, 0.84), (-0.72, 0.88), (-0.82, 0.80)], 0.17, LEATHER)
    stem = rod([(0.66, 0, 0.24), (0.44, 0, 1.0)], 0.045, DARK_STEEL)
    bars = rod([(0.38, -0.33, 1.06), (0.38, 0.33, 1.06)], 0.03, TRIM)
    case = box((-1.0, -0.2, 0.84), (-0.66, 0.2, 1.16), skin)
    return [
        *_rolling(0.66, -0.60, 0.24),
        shield,
        step,
        rear,
        seat,
        stem,
        bars,
        case,
        *_lights(0.60, -1.005, 0.86, 0.72),
    ]
