"""Bicycles, ridden and parked: city, racing, cargo. The wheels are hoops that one sees through."""

import numpy as np

from data_gen.assets.bodies.people import Joints, Look, figure
from data_gen.assets.shapes.mesh import Asset, Mesh, Scatterers
from data_gen.assets.shapes.palette import (
    BICYCLE_PAINTS,
    CLOTHES,
    DARK_STEEL,
    HAIRS,
    HEAD_LAMP,
    LEATHER,
    PLATE,
    SKINS,
    TAIL_LAMP,
    TRIM,
    TYRE,
    Material,
    lacquer,
)
from data_gen.assets.shapes.profiles import assemble, at, ball, box, end_patch, extrude, loft, moved, ring, rod
from data_gen.assets.shapes.reflectors import cloud

BICYCLES = ("city rider", "racing rider", "cargo rider", "city parked", "racing parked", "cargo parked")


def bicycle(variant: str, paint: int) -> Asset:
    """The named bicycle; ``paint`` picks the frame's lacquer and what the rider wears."""
    skin = BICYCLE_PAINTS[paint]
    kind, use = variant.split()
    parts = {"city": _city, "racing": _racing, "cargo": _cargo}[kind](skin)
    if use == "rider":
        parts += _cyclist(kind, paint)
        if kind == "cargo":  # a child looks over the edge
            parts.append(ball((0.36, 0, 0.88), (0.10, 0.09, 0.12), SKINS[0], sections=6))
    total = 1.5 if use == "rider" else -2.5

    def scatter(size) -> Scatterers:
        x = size[0] / 2 - 0.34
        return cloud([(x, 0, 0.35), (-x, 0, 0.35), (0, 0, 0.5), (-0.1, 0, 0.75 * size[2])], total)

    return assemble(f"bicycle {variant}", "vehicle.bicycle", parts, scatter)


def _cyclist(kind: str, paint: int) -> list[Mesh]:
    top, bottom, shoes = CLOTHES[(3 * paint) % len(CLOTHES)]
    helmet = lacquer((0.70, 0.70, 0.68)) if kind == "racing" else None
    look = Look(top, bottom, shoes, SKINS[paint % 3], HAIRS[paint % 4], hat=helmet)
    lean = {"city": 0.10, "racing": 0.42, "cargo": 0.06}[kind]
    shift = -0.42 if kind == "cargo" else 0.0
    hips = np.array([-0.26 + shift, 0, 0.98])
    shoulders = at(hips, lean, 0, (0.50**2 - lean**2) ** 0.5)
    head = at(shoulders, 0.08 + 0.25 * lean, 0, 0.20)
    hand = at((0.52, 0.25, 0.92) if kind == "racing" else (0.40, 0.25, 1.02), shift)
    elbow = (at(shoulders, 0, 0.22, 0) + hand) / 2 + np.array([-0.05, 0.05, -0.10])
    knees = [np.array([0.12 + shift, 0.10, 0.86]), np.array([0.02 + shift, -0.10, 0.60])]
    ankles = [np.array([-0.06 + shift, 0.11, 0.46]), np.array([-0.08 + shift, -0.11, 0.18])]
    mirror = np.array([1, -1, 1])
    return figure(
        Joints(hips, shoulders, head, knees, ankles, [elbow, elbow * mirror], [hand, hand * mirror]), look, 1.74
    )


def _hoops(front: float, rear: float, radius: float, width: float) -> list[Mesh]:
    return [ring((x, 0, radius), radius, 0.055, width, TYRE, sections=12) for x in (front, rear)]


def _frame(skin: Material, front: float, rear: float, radius: float, head: float, low: bool) -> list[Mesh]:
    """Diamond (or step-through) frame, fork, chain stays, cranks, seat post and saddle."""
    crank, post, top = (-0.05, 0, 0.30), (-0.24, 0, 0.88), (head, 0, 0.86)
    down = [(crank[0], 0, crank[2] + (0.14 if low else 0.5)), top]
    return [
        rod([crank, post], 0.026, skin),
        rod([crank, top], 0.03, skin),
        rod([(-0.20, 0, 0.80), top] if not low else down, 0.026, skin),
        rod([crank, (rear, 0, radius)], 0.024, skin),
        rod([(-0.2, 0, 0.8), (rear, 0, radius)], 0.02, skin),
        rod([(front, 0, radius), (head - 0.05, 0, 1.0)], 0.028, DARK_STEEL),
        rod([(-0.12, 0.11, 0.36), (0.02, -0.11, 0.24)], 0.02, DARK_STEEL),
        box((-0.38, -0.08, 0.88), (-0.12, 0.08, 0.95), LEATHER),
    ]


def _city(skin: Material) -> list[Mesh]:
    bars = [rod([(0.34, -0.29, 1.05), (0.34, 0.29, 1.05)], 0.022, TRIM)]
    rack = box((-0.82, -0.09, 0.72), (-0.36, 0.09, 0.76), DARK_STEEL)
    basket = box((0.42, -0.18, 0.80), (0.72, 0.18, 1.04), TRIM)
    lamps = [
        end_patch(-0.825, (-0.05, 0.05), (0.64, 0.74), TAIL_LAMP, facing=-1),
        end_patch(0.725, (-0.04, 0.04), (0.82, 0.9), HEAD_LAMP),
    ]
    return [*_hoops(0.55, -0.53, 0.34, 0.05), *_frame(skin, 0.55, -0.53, 0.34, 0.36, True), *bars, rack, basket, *lamps]


def _racing(skin: Material) -> list[Mesh]:
    drops = [rod([(0.42, y, 1.0), (0.56, y, 0.98), (0.54, y, 0.86)], 0.02, TRIM) for y in (-0.22, 0.22)]
    bars = rod([(0.42, -0.23, 1.0), (0.42, 0.23, 1.0)], 0.022, TRIM)
    bottle = loft([(0.10, 0, 0.45), (0.20, 0, 0.62)], [0.04, 0.04], PLATE, sections=5)
    return [*_hoops(0.52, -0.50, 0.34, 0.035), *_frame(skin, 0.52, -0.50, 0.34, 0.38, False), *drops, bars, bottle]


def _cargo(skin: Material) -> list[Mesh]:
    """A long one with a box before the handlebars."""
    back = [moved(m, offset=(-0.42, 0, 0)) for m in _frame(skin, 0.30, -0.53, 0.34, 0.36, True)]
    tub = extrude([(0.10, 0.34), (0.62, 0.34), (0.80, 0.80), (0.02, 0.80)], 0.29, skin)
    bars = rod([(-0.08, -0.29, 1.05), (-0.08, 0.29, 1.05)], 0.022, TRIM)
    beam = rod([(-0.35, 0, 0.33), (1.02, 0, 0.30)], 0.03, DARK_STEEL)
    return [
        ring((-0.95, 0, 0.34), 0.34, 0.055, 0.05, TYRE, sections=12),
        ring((1.02, 0, 0.25), 0.25, 0.055, 0.05, TYRE, sections=12),
        *back,
        tub,
        bars,
        beam,
    ]
