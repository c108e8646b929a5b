"""Buses: a long body whose glass runs round it as one band; city bus, coach, bendy bus, minibus."""

from data_gen.assets.shapes.mesh import Asset, Mesh
from data_gen.assets.shapes.palette import AMBER, CHASSIS, GLASS, HEAD_LAMP, PLATE, TAIL_LAMP, TRIM, Material
from data_gen.assets.shapes.profiles import arch, assemble, axle, box, end_pair, end_patch, extrude, side_patch
from data_gen.assets.shapes.reflectors import body

SIZES = {"city": (11.9, 2.55, 3.1), "coach": (12.4, 2.55, 3.65), "bendy": (17.8, 2.55, 3.1), "mini": (7.4, 2.2, 2.75)}
DISPLAY = Material((0.9, 0.42, 0.02), 0.3, emission=1.5)
BELLOWS = Material((0.03, 0.03, 0.032), 0.15, "fabric")
ROOF_GREY = Material((0.5, 0.5, 0.5), 0.4)


def bus(variant: str, paint: Material) -> Asset:
    """A bus of the named kind; the paint covers the body below and above the window band."""
    size = length, width, height = SIZES[variant]
    half = length / 2
    wheels: tuple[float, ...]
    if variant == "bendy":
        joint = half - 9.6
        spans = [(-half, joint - 0.55), (joint + 0.55, half)]
        wheels = (half - 2.7, half - 8.3, -half + 3.0)
        bellows = box((joint - 0.6, -width / 2 + 0.09, 0.45), (joint + 0.6, width / 2 - 0.09, height - 0.12), BELLOWS)
        folds = [
            box((joint + x, -width / 2 + 0.04, 0.42), (joint + x + 0.1, width / 2 - 0.04, height - 0.08), BELLOWS)
            for x in (-0.4, -0.05, 0.3)
        ]
        parts = [bellows, *folds]
    else:
        spans = [(-half, half)]
        wheels = (half - (1.5 if variant == "mini" else 2.7), -half + (1.7 if variant == "mini" else 3.0))
        parts = []
    radius = 0.40 if variant == "mini" else 0.5
    for rear, front in spans:
        own = [x for x in wheels if rear < x < front]
        parts += _shell(variant, rear, front, own, radius, width, height, paint, nose=front == half)
    parts += [w for x in wheels for w in axle(x, width / 2 - 0.02, radius, 0.3, sections=10)]
    parts += [*_face(variant, half, width, height), *_stern(variant, -half, width, height)]
    mini = variant == "mini"
    return assemble(
        f"bus {variant}",
        "vehicle.bus.bendy" if variant == "bendy" else "vehicle.bus.rigid",
        parts,
        lambda size: body(size, end=18.0 if mini else 20.0, side=22.0 if mini else 24.5, wheels=wheels, height=0.8),
        size=size,
    )


def _band(variant: str, height: float) -> tuple[float, float]:
    """Lower and upper edge of the windows."""
    return (
        (1.75, height - 0.5)
        if variant == "coach"
        else (1.1, height - 0.45)
        if variant == "mini"
        else (1.15, height - 0.55)
    )


def _shell(
    variant: str,
    rear: float,
    front: float,
    wheels: list[float],
    radius: float,
    width: float,
    height: float,
    paint: Material,
    *,
    nose: bool,
) -> list[Mesh]:
    low, high = _band(variant, height)
    w, floor = width / 2, 0.32
    rake = 0.35 if variant == "coach" else 0.7 if variant == "mini" else 0.12
    screen = low - 0.25 if nose else low
    face = [
        (front - 0.05, floor, TRIM),
        (front, 0.55),
        (front - 0.02, screen, GLASS if nose else paint),
        (front - (rake if nose else 0.02), high + 0.1),
        (front - (rake + 0.25 if nose else 0.02), height, ROOF_GREY),
    ]
    if variant == "mini":
        face[1:3] = [(front, 0.55), (front - 0.03, 0.95), (front - 0.45, screen + 0.2, GLASS)]
        face[-2:] = [(front - 1.15, high + 0.1), (front - 1.5, height, ROOF_GREY)]
    outline = [
        (rear + 0.03, floor, TRIM),
        *(point for x in sorted(wheels) for point in arch(x, radius, floor)),
        *face,
        (rear + 0.12, height),
        (rear, height - 0.2),
        (rear, 0.6),
    ]

    def taper(x, z):
        return w - 0.01 - 0.10 * (z > high + 0.09)

    lead = {"mini": 0.95, "coach": 0.3}.get(variant, 0.16) if nose else 0.1
    glass = (rear + 0.25, front - lead)
    count = max(2, round((glass[1] - glass[0]) / 1.5))
    step = (glass[1] - glass[0]) / count
    panes = [
        side_patch(
            [
                (glass[0] + i * step + 0.05, low),
                (glass[0] + (i + 1) * step - 0.05, low),
                (glass[0] + (i + 1) * step - 0.05, high),
                (glass[0] + i * step + 0.05, high),
            ],
            w - 0.01,
            GLASS,
        )
        for i in range(count)
    ]
    skirt = []
    if variant == "coach":
        skirt = [
            side_patch(
                [(rear + 0.2, 1.05), (front - 0.3, 1.05), (front - 0.9, 1.5), (rear + 0.2, 1.2)], w - 0.01, COACH_STRIPE
            )
        ]
    return [extrude(outline, taper, paint), *panes, *skirt]


COACH_STRIPE = Material((0.78, 0.55, 0.05), 0.5, specular=0.1)


def _face(variant: str, x: float, width: float, height: float) -> list[Mesh]:
    """Lamps, bumper, plate, destination display."""
    w = width / 2
    parts = [
        end_pair(x + 0.006, (0.62 * w, 0.90 * w), (0.62, 0.82), HEAD_LAMP),
        end_pair(x + 0.006, (0.50 * w, 0.60 * w), (0.64, 0.80), AMBER),
        end_patch(x + 0.006, (-0.28, 0.28), (0.45, 0.57), PLATE),
        end_patch(x + 0.004, (-0.45 * w, 0.45 * w), (0.62, 0.82), TRIM),
    ]
    if variant in ("city", "bendy"):
        parts.append(end_patch(x - 0.10, (-0.75 * w, 0.75 * w), (height - 0.5, height - 0.24), DISPLAY))
        doors = [[(x - a - 1.15, 0.42), (x - a, 0.42), (x - a, 2.45), (x - a - 1.15, 2.45)] for a in (0.35, 5.1)]
        parts += [side_patch(door, w - 0.01, GLASS, proud=0.02) for door in doors]
    if variant != "mini":
        parts += [box((x - 0.25, y - 0.06, 1.95), (x - 0.02, y + 0.06, 2.45), TRIM) for y in (-w + 0.07, w - 0.07)]
    return parts


def _stern(variant: str, x: float, width: float, height: float) -> list[Mesh]:
    """Rear window, engine grille, lamps, plate."""
    w, (low, high) = width / 2, _band(variant, height)
    return [
        end_patch(x - 0.006, (-0.78 * w, 0.78 * w), (low + 0.1, high), GLASS, facing=-1),
        end_patch(x - 0.006, (-0.6 * w, 0.6 * w), (0.62, 0.98), CHASSIS, facing=-1),
        end_pair(x - 0.010, (0.74 * w, 0.95 * w), (0.7, 1.15), TAIL_LAMP, facing=-1),
        end_patch(x - 0.012, (-0.28, 0.28), (0.72, 0.84), PLATE, facing=-1),
    ]
