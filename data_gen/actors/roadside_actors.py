"""What stands, walks and cycles beside the road: parked vehicles, pedestrians, cyclists, and their decoys.

A decoy is placed by the same code as what it imitates, and nothing but its body depends on whether it is one, so that place,
heading and (im)mobility tell nothing.
"""

import numpy as np

from data_gen.actors.roadside_settings import CYCLES, Roadside
from data_gen.actors.stage import Spot, Stage
from data_gen.assets.catalogue import PAINTS, VARIANT_NAMES, build_asset, decoy_of, scaled_decoy
from data_gen.assets.shapes.mesh import Asset
from data_gen.road.track import Track
from data_gen.world.marks import crossings
from fusion_net.common.random import uniform

LARGE = ("truck", "bus", "trailer", "construction_vehicle")
"""Classes of which parked ones may be decoys."""


def sample_asset(kind: str, rng: np.random.Generator, *words: str) -> Asset:
    """A random variant in a random paint, of those variants whose names have all the ``words``."""
    variants = [v for v, name in enumerate(VARIANT_NAMES[kind]) if all(word in name for word in words)]
    return build_asset(kind, variants[rng.integers(len(variants))], int(rng.integers(PAINTS[kind])))


def standing(spot: Spot, out: float, yaw: float) -> Track:
    """At rest ``out`` metres off the road, turned by ``yaw`` from the lane's travel."""
    return Track.static([*spot.beside(out), 0.0], spot.yaw + yaw)


def park(stage: Stage, kind: str, roadside: Roadside, *, tries: int = 6) -> bool:
    """A vehicle parked beside the road: mostly in line with it, now and then across, some farther off."""
    rng = stage.rng
    asset = sample_asset(kind, rng, *(("parked",) if kind in CYCLES else ()))
    is_decoy = rng.uniform() < roadside.decoy_probability and kind in LARGE
    asset = decoy_of(asset) if is_decoy else asset
    length, width, _ = asset.size
    for _ in range(tries):
        across = rng.uniform() < (0.5 if kind in CYCLES else 0.12)
        yaw = (np.pi / 2 if across else 0.0) + np.pi * rng.integers(2) + rng.normal(0.0, 0.04)
        depth = length if across else width
        out = depth / 2 + 0.35 + (rng.uniform(0, 0.5) if rng.uniform() < 0.6 else rng.uniform(0.5, 6.0))
        spot = stage.spot(out)
        if spot is None or not _off_road(stage, spot.beside(out), spot.yaw + yaw, asset):
            continue
        attribute = "" if is_decoy else "cycle.without_rider" if kind in CYCLES else "vehicle.parked"
        if stage.place(asset, standing(spot, out, yaw), attribute):
            return True
    return False


def _off_road(stage: Stage, center: np.ndarray, yaw: float, asset: Asset) -> bool:
    ahead = np.array([np.cos(yaw), np.sin(yaw)]) * asset.size[0] / 2
    left = np.array([-np.sin(yaw), np.cos(yaw)]) * asset.size[1] / 2
    corners = center + np.array([ahead + left, ahead - left, -ahead + left, -ahead - left, left, -left])
    return bool((stage.clearance(corners) > 0.0).all())


def stand(stage: Stage, roadside: Roadside) -> bool:
    """Somebody who stands on the pavement, facing anywhere; some of them are dummies."""
    rng = stage.rng
    asset = sample_asset("pedestrian", rng, "standing")
    is_decoy = rng.uniform() < roadside.decoy_probability
    out = rng.uniform(0.7, 5.0)
    spot = stage.spot(out)
    if spot is None:
        return False
    attribute = "" if is_decoy else "pedestrian.standing"
    track = standing(spot, out, rng.uniform(-np.pi, np.pi))
    return stage.place(decoy_of(asset) if is_decoy else asset, track, attribute)


def walk(stage: Stage, roadside: Roadside) -> bool:
    """Somebody who walks along the pavement, either way."""
    rng = stage.rng
    asset = sample_asset("pedestrian", rng, "walking")
    out, speed = rng.uniform(0.8, 4.0), uniform(rng, roadside.walking_speed) * rng.choice((-1, 1))
    spot = stage.spot(out)
    if spot is None:
        return False
    track = spot.walk(out, float(speed), stage.duration)
    off_road = (stage.clearance(track.position[:, :2]) > 0.3).all()
    return bool(off_road) and _smooth(track) and stage.place(asset, track, "pedestrian.moving")


def _smooth(track: Track) -> bool:
    """Whether the path has no kink: beside a tight bend the inner edge has."""
    return bool((np.abs(np.diff(track.yaw)) < 0.2).all())


def cross(stage: Stage, roadside: Roadside) -> bool:
    """Somebody who crosses the road, where nobody drives meanwhile: mostly on a zebra crossing, where one is in sight."""
    rng = stage.rng
    asset = sample_asset("pedestrian", rng, "walking")
    place = (_zebra(stage) if rng.uniform() < roadside.zebra_probability else None) or _edge(stage)
    if place is None:
        return False
    start, heading = place
    speed, heading = uniform(rng, roadside.crossing_speed), heading + rng.normal(0.0, 0.1)
    velocity = speed * np.array([np.cos(heading), np.sin(heading), 0.0])
    track = Track(np.zeros(1), np.array([[*start, 0.0]]), np.array([heading]), velocity[None])
    position = track.at(stage.times)[0][:, :2]
    away = stage.corridor.free(position[0], 0.0, (3.0, 3.0)) and stage.corridor.free(position[-1], 0.0, (3.0, 3.0))
    return away and stage.place(asset, track, "pedestrian.moving", margin=0.6)


def _zebra(stage: Stage) -> tuple[np.ndarray, float] | None:
    """A start (2,) on a zebra crossing in sight, near its end, and the way across."""
    shown = [zebra for zebra in crossings(stage.layout) if stage.visibility(zebra.middle) > 0.3]
    if not shown:
        return None
    zebra, side = shown[stage.rng.integers(len(shown))], stage.rng.choice((-1, 1))
    left, ahead = (np.array([-np.sin(zebra.yaw), np.cos(zebra.yaw)]), np.array([np.cos(zebra.yaw), np.sin(zebra.yaw)]))
    across, along = zebra.width / 2 + stage.rng.uniform(-3.0, 1.0), stage.rng.uniform(-1.0, 1.0)
    return zebra.middle + side * across * left + along * ahead, zebra.yaw - side * np.pi / 2


def _edge(stage: Stage) -> tuple[np.ndarray, float] | None:
    """A start (2,) near the road's edge and the way across."""
    spot = stage.spot(1.0)
    if spot is None:
        return None
    return spot.beside(stage.rng.uniform(-3.0, 1.0)), spot.yaw - spot.side * np.pi / 2


def cycle(stage: Stage, kind: str, roadside: Roadside) -> bool:
    """A cyclist or a motorcyclist along the road's edge, with the traffic."""
    rng = stage.rng
    asset = sample_asset(kind, rng, "rider")
    waits = rng.uniform() < 0.15
    speed = 0.0 if waits else uniform(rng, roadside.cycling_speed[kind])
    out = rng.uniform(-0.5, 0.8) if kind == "bicycle" else rng.uniform(-0.8, 0.3)
    spot = stage.spot(1.0)
    if spot is None:
        return False
    track = standing(spot, out, 0.0) if waits else spot.walk(out, float(speed), stage.duration)
    return _smooth(track) and stage.place(asset, track, "cycle.with_rider")


def place_scaled_decoy(stage: Stage, roadside: Roadside) -> bool:
    """A figure twice a person's size, farther off: the same pixels as a person at half the distance."""
    asset = scaled_decoy(sample_asset("pedestrian", stage.rng))
    out = stage.rng.uniform(4.0, 12.0)
    spot = stage.spot(out)
    if spot is None or np.linalg.norm(spot.edge - stage.layout.ego.position[0, :2]) < 22.0:
        return False
    return stage.place(asset, standing(spot, out, stage.rng.uniform(-np.pi, np.pi)))
