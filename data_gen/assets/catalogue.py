"""Every body of the scenes by kind, variant and paint. Nothing is left to chance: same arguments, same object."""

from collections.abc import Callable
from functools import cache

from data_gen.assets.bodies import bicycles, buses, cars, construction, motorcycles, people, trailers, trucks
from data_gen.assets.decoys import decoy_of, scaled_decoy
from data_gen.assets.shapes.mesh import Asset
from data_gen.assets.shapes.palette import (
    BICYCLE_PAINTS,
    BUS_PAINTS,
    MOTORCYCLE_PAINTS,
    TRAILER_PAINTS,
    TRUCK_PAINTS,
)
from data_gen.assets.street import furniture as street
from data_gen.assets.street import nature, posts, roadworks, signs

__all__ = ["PAINTS", "PROPS", "VARIANTS", "VARIANT_NAMES", "build_asset", "decoy_of", "scaled_decoy"]

Painted = tuple[Callable[..., Asset], tuple[str, ...], tuple]
# kind: what builds a variant in a paint, names of the variants, paints; below, what comes in one paint only
_OBJECTS: dict[str, Painted] = {
    "car": (cars.car, tuple(cars.SHAPES), cars.PAINTS),
    "truck": (trucks.truck, tuple(trucks.TRUCK_SIZES), TRUCK_PAINTS),
    "bus": (buses.bus, tuple(buses.SIZES), BUS_PAINTS),
    "trailer": (trailers.trailer, tuple(trailers.TRAILER_SIZES), TRAILER_PAINTS),
    "construction_vehicle": (construction.construction_vehicle, tuple(construction.MACHINES), construction.PAINTS),
    "pedestrian": (people.pedestrian, tuple(people.PEOPLE), tuple(range(len(people.PAINTS)))),
    "motorcycle": (motorcycles.motorcycle, motorcycles.MOTORCYCLES, tuple(range(len(MOTORCYCLE_PAINTS)))),
    "bicycle": (bicycles.bicycle, bicycles.BICYCLES, tuple(range(len(BICYCLE_PAINTS)))),
}
_PLAIN: dict[str, tuple[Callable[[str], Asset], tuple[str, ...]]] = {
    "traffic_cone": (roadworks.traffic_cone, tuple(roadworks.CONES)),
    "barrier": (roadworks.barrier, roadworks.BARRIERS),
    "tree": (nature.tree, tuple(nature.TREES)),
    "bush": (nature.bush, (*nature.BUSHES, *nature.GRASSES)),
    "grove": (nature.grove, tuple(nature.GROVES)),
    "pole": (posts.pole, ("mast", "bollard", "marker")),
    "street_lamp": (posts.street_lamp, ("arm", "double", "top")),
    "traffic_light": (posts.traffic_light, ("post red", "post green", "arm red", "arm green")),
    "sign_post": (signs.sign_post, (*signs.SIGNS, *signs.TOWNS)),
    "gantry": (signs.gantry, ("bridge", "cantilever")),
    "guard_rail": (street.guard_rail, ("steel", "concrete")),
    "metal_plate": (street.metal_plate, ("plate", "cover")),
    "billboard": (street.billboard, tuple(street.BILLBOARDS)),
    "bench": (street.bench, ("timber", "stone")),
}
PROPS = tuple(_PLAIN)[2:]
"""Kinds that are no objects of the detector."""
VARIANT_NAMES: dict[str, tuple[str, ...]] = {
    **{kind: names for kind, (_, names, _) in _OBJECTS.items()},
    **{kind: names for kind, (_, names) in _PLAIN.items()},
}
"""Names of the variants of each kind; a variant's number is its place. A cycle's ends in "rider" or "parked"."""
VARIANTS = {kind: len(names) for kind, names in VARIANT_NAMES.items()}
PAINTS = {kind: len(_OBJECTS[kind][2]) if kind in _OBJECTS else 1 for kind in VARIANT_NAMES}


@cache
def _build(kind: str, variant: int, paint: int) -> Asset:
    if kind in _PLAIN:
        return _PLAIN[kind][0](_PLAIN[kind][1][variant])
    builder, names, paints = _OBJECTS[kind]
    return builder(names[variant], paints[paint])


def build_asset(kind: str, variant: int = 0, paint: int = 0) -> Asset:
    """The body of ``kind`` in shape ``variant`` < ``VARIANTS[kind]`` and colours ``paint`` < ``PAINTS[kind]``.

    The same arguments give the same object, so that trees and textures can be kept by identity.
    """
    if kind not in VARIANTS:
        raise ValueError(f"build_asset: kind '{kind}' is not one of {', '.join(VARIANTS)}")
    for name, value, count in (("variant", variant, VARIANTS[kind]), ("paint", paint, PAINTS[kind])):
        if not 0 <= value < count:
            raise ValueError(f"build_asset: {name}={value} of '{kind}' is not within 0..{count - 1}")
    return _build(kind, variant, paint)
