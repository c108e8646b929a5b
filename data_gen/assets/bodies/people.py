"""People with legs, arms and a head: walking and standing adults, children, road workers, police; riders too."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from data_gen.assets.shapes.mesh import Asset, Mesh
from data_gen.assets.shapes.palette import (
    CLOTHES,
    HAIRS,
    HI_VIS_ORANGE,
    HI_VIS_YELLOW,
    LEATHER,
    SKINS,
    WHITE_SHEETING,
    Material,
    cloth,
    lacquer,
)
from data_gen.assets.shapes.profiles import animated, assemble, at, ball, box, loft
from data_gen.assets.shapes.reflectors import cloud


@dataclass(frozen=True)
class Look:
    """Clothes: ``band`` is a stripe around the chest, ``hat`` replaces the hair, ``skirt`` covers the thighs."""

    top: Material
    bottom: Material
    shoes: Material
    skin: Material
    hair: Material
    band: Material | None = None
    hat: Material | None = None
    skirt: Material | None = None
    long_hair: bool = False


@dataclass(frozen=True)
class Joints:
    """Where the joints are, in metres: hips' and shoulders' centres, and left then right of the limbs' joints."""

    hips: ArrayLike
    shoulders: ArrayLike
    head: ArrayLike
    knees: Sequence[ArrayLike]
    ankles: Sequence[ArrayLike]
    elbows: Sequence[ArrayLike]
    hands: Sequence[ArrayLike]


PHASES = 8
"""Poses of a stride."""
STRIDE = 0.68
"""Length of a stride, two steps, in body heights."""
KNEE = (7.0, 13.0, 8.0, 8.0, 17.0, 32.0, 48.0, 25.0, 7.0)
"""Degrees that the knee is bent at eighths of a stride, from heel strike to heel strike."""
NAVY = cloth((0.012, 0.018, 0.05))
WORK_TROUSERS = cloth((0.05, 0.06, 0.10))
YELLOW_HELMET, WHITE_HELMET = lacquer((0.80, 0.50, 0.02)), lacquer((0.75, 0.75, 0.73))

# kind: (nuScenes category, height, breadth of the build, walking)
PEOPLE = {
    "man walking": ("adult", 1.80, 1.0, True),
    "woman walking": ("adult", 1.68, 0.88, True),
    "child walking": ("child", 1.22, 0.98, True),
    "worker walking": ("construction_worker", 1.80, 1.08, True),
    "police walking": ("police_officer", 1.84, 1.05, True),
    "man standing": ("adult", 1.77, 1.04, False),
    "woman standing": ("adult", 1.65, 0.9, False),
    "child standing": ("child", 1.05, 1.0, False),
    "worker standing": ("construction_worker", 1.75, 1.1, False),
    "police standing": ("police_officer", 1.80, 1.05, False),
    "man bag walking": ("adult", 1.75, 1.06, True),
}


def pedestrian(variant: str, paint: int) -> Asset:
    """A person of the named kind in the outfit number ``paint``; who walks moves legs and arms."""
    kind, height, build, walks = PEOPLE[variant]
    poses = (
        [_walking(height, build, phase / PHASES) for phase in range(PHASES)]
        if walks
        else [_standing(height, build, phone="woman" in variant)]
    )
    phases = [figure(joints, _look(variant, paint), height, build) for joints in poses]
    if "bag" in variant:
        for joints, parts in zip(poses, phases, strict=True):
            hand = np.asarray(joints.hands[1])
            parts.append(box(at(hand, -0.2, -0.06, -0.38), at(hand, 0.2, 0.06, -0.06), LEATHER))
    category = f"human.pedestrian.{kind}"
    asset = assemble(f"pedestrian {variant}", category, phases[0], lambda size: _echoes(size, kind))
    return animated(asset, phases, STRIDE * height) if walks else asset


def _echoes(size: tuple[float, float, float], kind: str):
    tall = size[2]
    return cloud(
        [(0, 0, 0.75 * tall), (0, 0, 0.5 * tall), (0.1, 0.1, 0.25 * tall), (-0.1, -0.1, 0.25 * tall)],
        -5.0 if kind == "child" else -2.0,
    )


def _look(variant: str, paint: int) -> Look:
    top, bottom, shoes = CLOTHES[paint]
    skin, hair = SKINS[paint % len(SKINS)], HAIRS[paint % len(HAIRS)]
    if "worker" in variant:
        vest = (HI_VIS_YELLOW, HI_VIS_ORANGE)[paint % 2]
        return Look(
            vest, WORK_TROUSERS, LEATHER, skin, hair, band=WHITE_SHEETING, hat=(YELLOW_HELMET, WHITE_HELMET)[paint % 2]
        )
    if "police" in variant:
        return Look(NAVY, NAVY, LEATHER, skin, hair, band=WHITE_SHEETING, hat=NAVY)
    if "woman" in variant:
        return Look(top, bottom, shoes, skin, hair, skirt=top if paint % 2 else bottom, long_hair=True)
    return Look(top, bottom, shoes, skin, hair)


def figure(joints: Joints, look: Look, height: float, build: float = 1.0) -> list[Mesh]:
    """The parts of a body over its joints, for a person of ``height`` metres."""
    h, b = height, height * build
    hips, shoulders, head = (np.asarray(p, float) for p in (joints.hips, joints.shoulders, joints.head))
    spine = shoulders - hips
    share = np.array([-0.12, 0.12, 0.42, 0.60, 0.98, 1.16])
    radii = [
        (0.060 * b, 0.088 * b),
        (0.064 * b, 0.092 * b),
        (0.062 * b, 0.086 * b),
        (0.070 * b, 0.100 * b),
        (0.050 * b, 0.108 * b),
        (0.03 * b, 0.035 * b),
    ]
    torso = [look.bottom, look.top, look.band or look.top, look.top, look.top]
    parts = [
        loft(hips + share[:, None] * spine, radii, torso),
        ball(head, (0.056 * h, 0.046 * h, 0.068 * h), look.skin, sections=6),
        _headgear(head, look, h),
    ]
    for i, side in enumerate((1, -1)):
        knee, ankle, elbow, hand = (
            np.asarray(p[i], float) for p in (joints.knees, joints.ankles, joints.elbows, joints.hands)
        )
        hip = at(hips, 0, side * 0.048 * b, 0)
        parts.append(loft([hip, knee, ankle], [0.050 * b, 0.037 * b, 0.026 * b], look.bottom, sections=5))
        foot = at(ankle, 0.045 * h, 0, -0.012 * h)
        parts.append(
            box(at(foot, -0.075 * h, -0.026 * h, -0.024 * h), at(foot, 0.075 * h, 0.026 * h, 0.018 * h), look.shoes)
        )
        shoulder = at(shoulders, 0, side * 0.110 * b, -0.008 * h)
        wrist = elbow + 0.82 * (hand - elbow)
        sleeves = [look.top, look.top, look.skin]
        parts.append(
            loft([shoulder, elbow, wrist, hand], [0.033 * b, 0.027 * b, 0.021 * b, 0.02 * b], sleeves, sections=4)
        )
    if look.skirt:
        knees = (np.asarray(joints.knees[0], float) + np.asarray(joints.knees[1], float)) / 2
        parts.append(
            loft(
                [hips + 0.2 * spine, hips, knees],
                [(0.066 * b, 0.092 * b), (0.080 * b, 0.100 * b), (0.135 * b, 0.115 * b)],
                look.skirt,
            )
        )
    return parts


def _headgear(head: np.ndarray, look: Look, h: float) -> Mesh:
    """Hair, or a helmet or cap with a brim, on the back and the top of the head."""
    if look.hat:
        return loft(
            [at(head, 0.012 * h, 0, 0.024 * h), at(head, 0, 0, 0.045 * h), at(head, -0.005 * h, 0, 0.082 * h)],
            [0.082 * h, 0.068 * h, 0.04 * h],
            look.hat,
            sections=7,
        )
    drop = 0.10 if look.long_hair else 0.02
    centres = [
        at(head, -0.026 * h, 0, -drop * h),
        at(head, -0.016 * h, 0, 0.03 * h),
        at(head, -0.012 * h, 0, 0.078 * h),
    ]
    return loft(centres, [(0.032 * h, 0.046 * h), (0.055 * h, 0.052 * h), (0.03 * h, 0.028 * h)], look.hair, sections=7)


def _swing(origin: np.ndarray, lengths: Sequence[float], angles: Sequence[float]) -> list[np.ndarray]:
    """Joints of a limb that hangs from ``origin``; ``angles`` in degrees forward of straight down, one a bone."""
    points = []
    for length, angle in zip(lengths, np.radians(angles), strict=True):
        origin = origin + length * np.array([np.sin(angle), 0.0, -np.cos(angle)])
        points.append(origin)
    return points


def _pose(
    h: float, b: float, legs: Sequence[Sequence[float]], arms: Sequence[Sequence[float]], *, lean: float, splay: float
) -> Joints:
    """Joints of a body ``h`` tall and ``b`` broad from the angles of left and right limbs; ``splay`` spreads them."""
    hips = np.array([0.0, 0.0, 0.53 * h])
    shoulders = at(hips, lean * h, 0, 0.285 * h)
    limbs = []
    for y, leg, arm in zip((1, -1), legs, arms, strict=True):
        outward = np.array([0, y * splay * b, 0])
        knee, ankle = _swing(at(hips, 0, y * 0.055 * b, 0), (0.245 * h, 0.24 * h), leg)
        elbow, hand = _swing(at(shoulders, 0, y * 0.128 * b, 0), (0.17 * h, 0.20 * h), arm)
        limbs.append((knee + 0.4 * outward, ankle + 0.8 * outward, elbow + outward, hand + 1.3 * outward))
    knees, ankles, elbows, hands = zip(*limbs, strict=True)
    return Joints(
        hips, shoulders, at(shoulders, 0.016 * h + lean * h * 0.3, 0, 0.125 * h), knees, ankles, elbows, hands
    )


def _walking(h: float, build: float, phase: float) -> Joints:
    """A stride: the left heel strikes at ``phase`` 0, the right one at 0.5. Thighs and arms swing as cosines, arms against
    legs; the knee gives a little under load and folds while the leg swings forward."""
    legs, arms = [], []
    for turn in (phase, phase + 0.5):
        swing = np.cos(2 * np.pi * turn)
        thigh, upper = 3.5 + 20.5 * swing, -3.0 - 21.0 * swing
        legs.append((thigh, thigh - np.interp(8 * turn % 8, np.arange(9), KNEE)))
        arms.append((upper, upper + 19.0 - 3.0 * swing))
    return _pose(h, h * build, legs=legs, arms=arms, lean=0.018, splay=0.015)


def _standing(h: float, build: float, *, phone: bool) -> Joints:
    return _pose(
        h, h * build, legs=((2, 0), (-2, -3)), arms=((2, 8), (12, 125) if phone else (-3, 4)), lean=0.0, splay=0.035
    )


PAINTS = CLOTHES
