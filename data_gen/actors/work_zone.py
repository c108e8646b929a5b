"""Work zones: a taper of cones, a row of barriers, machines and workers behind it."""

import numpy as np

from data_gen.actors.roadside_actors import sample_asset
from data_gen.actors.roadside_settings import Roadside
from data_gen.actors.stage import Spot, Stage
from data_gen.assets.catalogue import decoy_of
from data_gen.assets.shapes.mesh import Asset
from data_gen.road.track import Track
from fusion_net.common.random import uniform


def work_zone(stage: Stage, roadside: Roadside) -> int:
    """A closed strip of the road's side, or of its outer lane where nobody drives. Returns how many actors it has."""
    rng, before = stage.rng, len(stage.actors)
    spot = stage.spot(1.0)
    if spot is None:
        return 0
    length, depth = uniform(rng, roadside.work_zone_length), rng.uniform(2.5, 4.5)
    inner = -spot.lane.width[spot.i] + 0.4 if _lane_is_free(stage, spot, length) else 0.25
    cone, barrier = sample_asset("traffic_cone", rng), sample_asset("barrier", rng)
    taper = rng.uniform(5.0, 9.0)
    for s in np.arange(0.0, taper, rng.uniform(1.7, 2.6)):
        _put(stage, spot, cone, inner + (1.0 - s / taper) * (depth - inner), s)
    row, gap = (barrier, rng.uniform(0.1, 1.0)) if rng.uniform() < 0.8 else (cone, rng.uniform(1.6, 2.6))
    for s in np.arange(taper, taper + length, max(row.size[:2]) + gap):
        _put(stage, spot, row, inner, s)
    for _ in range(rng.integers(1, 3)):
        kind = "construction_vehicle" if rng.uniform() < 0.85 else "truck"
        machine = sample_asset(kind, rng)
        out = max(inner, 0.3) + 0.5 + machine.size[1] / 2 + rng.uniform(0.0, 2.0)
        is_decoy = rng.uniform() < roadside.decoy_probability
        attribute = "" if is_decoy else "vehicle.parked"
        _put(
            stage,
            spot,
            decoy_of(machine) if is_decoy else machine,
            out,
            rng.uniform(taper, taper + length),
            attribute,
            turn=rng.normal(0.0, 0.3) + np.pi * rng.integers(2),
        )
    for _ in range(rng.integers(1, 4)):
        _worker(stage, spot, roadside, inner, taper + rng.uniform(0.0, length))
    return len(stage.actors) - before


def _put(
    stage: Stage, spot: Spot, asset: Asset, out: float, along: float, attribute: str = "", turn: float = 0.0
) -> bool:
    """One piece at (along, out) from the spot, if there is room; a row's piece lies across its longer side."""
    if asset.category == "movable_object.barrier" and asset.size[1] > asset.size[0]:
        turn += np.pi / 2
    track = Track.static([*spot.beside(out, along), 0.0], spot.yaw + turn + stage.rng.normal(0.0, 0.03))
    return stage.place(asset, track, attribute, margin=0.05)


def _worker(stage: Stage, spot: Spot, roadside: Roadside, inner: float, along: float) -> None:
    rng = stage.rng
    point, heading = spot.beside(inner + rng.uniform(0.8, 3.0), along), rng.uniform(-np.pi, np.pi)
    speed = rng.uniform(0.5, 1.4) * (rng.uniform() < 0.4)
    asset = sample_asset("pedestrian", rng, "worker", "walking" if speed else "standing")
    velocity = speed * np.array([[np.cos(heading), np.sin(heading), 0.0]])
    if not speed and rng.uniform() < roadside.decoy_probability:
        stage.place(decoy_of(asset), Track.static([*point, 0.0], heading))
    else:
        track = Track(np.zeros(1), np.array([[*point, 0.0]]), np.array([heading]), velocity)
        stage.place(asset, track, "pedestrian.moving" if speed else "pedestrian.standing")


def _lane_is_free(stage: Stage, spot: Spot, length: float) -> bool:
    """Whether nobody drives on the outer lane beside the zone, nor will in the next second, and the ego is elsewhere."""
    width = float(spot.lane.width[spot.i])
    return all(
        stage.occupancy.free(point, spot.yaw, (5.0, width), 1.0) and stage.corridor.free(point, spot.yaw, (5.0, width))
        for point in (spot.beside(-width / 2, along) for along in np.arange(-8.0, length + 8.0, 4.0))
    )
