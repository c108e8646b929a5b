"""Who takes part: a body for every simulated vehicle, and people, parked vehicles, work zones and decoys around them."""

import numpy as np

from data_gen.actors.roadside_actors import (
    LARGE,
    cross,
    cycle,
    park,
    place_scaled_decoy,
    sample_asset,
    stand,
    walk,
)
from data_gen.actors.roadside_settings import CYCLES, IN_VIEW, Roadside
from data_gen.actors.stage import Array, Stage
from data_gen.actors.work_zone import work_zone
from data_gen.assets.catalogue import build_asset
from data_gen.assets.shapes.mesh import Asset
from data_gen.rig.coverage import FRONT, Sector
from data_gen.road.footprints import Occupancy
from data_gen.road.layout import Layout
from data_gen.road.track import Track
from data_gen.road.traffic_settings import DRIVEN, Traffic
from data_gen.scene.scene import Actor
from data_gen.scene.spray import LEAST_SPEED
from fusion_net.common.geometry import wrap_angle
from fusion_net.common.random import stream

TRUCK_AHEAD = [("truck", 0.4), ("bus", 0.4), ("truck", 0.1), ("truck", 0.1)]
"""What is tried for a truck ahead of the ego, and with how much room in metres around it."""
SUCCESS = {
    "car": 0.65,
    "motorcycle": 0.50,
    "bicycle": 0.54,
    "truck": 0.45,
    "bus": 0.36,
    "trailer": 0.36,
    "construction_vehicle": 0.48,
}
"""Fraction of the tries that end as an object in sight, measured over 480 scenes: not every spot has room, and a quarter of
the LARGE became decoys (MEASURED_DECOYS)."""
MEASURED_DECOYS = 0.25


def populate(
    layout: Layout,
    *,
    seed: int,
    traffic: Traffic,
    roadside: Roadside,
    view: Sector = FRONT,
    truck_ahead: bool = False,
) -> list[Actor]:
    """All actors of an episode: labelled objects and decoys (category ""). The rig's ``view`` is filled as densely as a front
    camera's. With ``truck_ahead`` one of those who drive fast ahead of the ego is a truck or a bus, where there is room.

    No two footprints touch at any time, and nothing at rest stands in the ego's way.
    """
    stage = Stage(layout, stream(seed, "traffic", layout.name), view)
    rng, density = stage.rng, roadside.density * (view.half / FRONT.half)
    _drive(stage, traffic, layout.vehicles, _leaders(layout) if truck_ahead else [])
    if rng.uniform() < roadside.work_zone_probability * density:
        work_zone(stage, roadside)
    for kind in rng.permutation(sorted(IN_VIEW)):
        _fill_up(stage, str(kind), roadside, density)
    for act, mean in (
        (walk, roadside.walking),
        (stand, roadside.standing),
        (cross, roadside.crossing),
        (place_scaled_decoy, roadside.scaled_decoys),
    ):
        for _ in range(rng.poisson(mean * density)):
            act(stage, roadside)
    for _ in range(rng.poisson(roadside.metal_plates * density)):
        _plate(stage)
    return stage.actors


def _leaders(layout: Layout) -> list[int]:
    """Indices of the vehicles that drive ahead of the ego, its way and fast enough for spray, the nearest first."""
    t = float(layout.ego.times[-1]) / 2
    position, yaw, _ = layout.ego.at(t)
    ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    states = [track.at(t) for track in layout.vehicles]
    gap = [(there - position)[:2] for there, _, _ in states]
    fast = [velocity[:2] @ ahead > LEAST_SPEED for _, _, velocity in states]
    found = [i for i, d in enumerate(gap) if fast[i] and 8.0 < d @ ahead < 45.0 and abs(d @ left) < 8.0]
    return sorted(found, key=lambda i: float(gap[i] @ ahead))


def _drive(stage: Stage, traffic: Traffic, tracks: list[Track], leaders: list[int]) -> None:
    """A body for every simulated vehicle, as long as the gaps to all others allow; a truck or bus for the first of the
    ``leaders`` who has the room."""
    first = set(leaders)
    tracks = [*(tracks[i] for i in leaders), *(track for i, track in enumerate(tracks) if i not in first)]
    waiting = Occupancy(len(stage.times))
    paths = [stage.path(track) for track in tracks]
    for path in paths:
        waiting.add(*path, (5.1, 2.05))
    wanted = len(leaders)
    for index, (track, path) in enumerate(zip(tracks, paths, strict=True)):
        waiting.drop_first()
        speed = np.linalg.norm(track.velocity, axis=1).mean()
        kind = str(stage.rng.choice(DRIVEN, p=traffic.class_probabilities()))
        kind = "truck" if kind == "construction_vehicle" and speed > traffic.max_construction_speed else kind
        tries = [(kind, 0.4), ("car", 0.02), ("car", 0.0), ("car", 0.0)]
        for choice, margin in TRUCK_AHEAD + tries if index < wanted else tries:
            asset = sample_asset(choice, stage.rng, *(("rider",) if choice == "motorcycle" else ()))
            if _fits(stage, waiting, asset, path, margin):
                stage.place(asset, track, _state(choice), margin)
                wanted = 0 if choice in ("truck", "bus") and index < wanted else wanted
                if choice == "truck" and stage.rng.uniform() < traffic.trailer_probability:
                    _tow(stage, waiting, asset, track)
                break


def _fits(stage: Stage, waiting: Occupancy, asset: Asset, path: tuple[Array, Array], margin: float) -> bool:
    center, yaw = path
    return stage.is_free(asset.size, path, margin) and waiting.free(center, yaw, asset.size[:2], margin)


def _state(kind: str) -> str:
    """The nuScenes attribute of somebody in traffic, on the way."""
    return "cycle.with_rider" if kind == "motorcycle" else "vehicle.moving"


def _tow(stage: Stage, waiting: Occupancy, truck: Asset, track: Track) -> bool:
    """A trailer behind a truck, if there is room."""
    trailer = sample_asset("trailer", stage.rng)
    behind = towed(track, hitch=-truck.size[0] / 2 - 0.4, length=trailer.size[0])
    folded = np.abs(wrap_angle(track.yaw - behind.yaw)).max() > 0.5  # no jack-knife in a tight turn
    fits = not folded and _fits(stage, waiting, trailer, stage.path(behind), 0.3)
    return fits and stage.place(trailer, behind, _state("trailer"), 0.3)


def towed(track: Track, *, hitch: float, length: float) -> Track:
    """The path of a trailer ``length`` metres long whose front end is held at ``hitch`` metres ahead (negative: behind) of
    the towing body's centre: its axle follows the hitch (tractrix). It begins at the steady angle of the bend."""
    ahead = np.stack([np.cos(track.yaw), np.sin(track.yaw)], axis=1)
    pin, arm = track.position[:, :2] + hitch * ahead, 0.75 * length
    rate = (track.yaw[1] - track.yaw[0]) / (track.times[1] - track.times[0]) if len(track.times) > 1 else 0.0
    pull = track.velocity[0, :2] + hitch * rate * np.array([-ahead[0, 1], ahead[0, 0]])
    speed = np.hypot(*pull)
    course = np.arctan2(pull[1], pull[0]) if speed > 0.5 else track.yaw[0]
    yaw = course - np.arcsin(np.clip(arm * rate / max(speed, 0.5), -0.5, 0.5))
    axle = pin[0] - arm * np.array([np.cos(yaw), np.sin(yaw)])
    centers, yaws = np.empty_like(pin), np.empty(len(pin))
    for i, front in enumerate(pin):  # the axle is pulled straight towards the hitch
        pull = (front - axle) / np.linalg.norm(front - axle)
        axle, centers[i], yaws[i] = front - arm * pull, front - length / 2 * pull, np.arctan2(pull[1], pull[0])
    velocity = np.gradient(centers, track.times, axis=0) if len(pin) > 1 else track.velocity[:, :2]
    flat = np.zeros((len(pin), 1))
    return Track(track.times, np.hstack([centers, flat]), np.unwrap(yaws), np.hstack([velocity, flat]))


def _fill_up(stage: Stage, kind: str, roadside: Roadside, density: float) -> None:
    """Parked and cycling ones, until the view shows about as many of a kind as ``roadside.in_view`` says."""
    category = build_asset(kind, 0, 0).category
    missing = density * roadside.in_view.get(kind, 0.0) - stage.shown(".".join(category.split(".")[:2]))
    for _ in range(stage.rng.poisson(max(missing, 0.0) / _success(kind, roadside.decoy_probability))):
        if kind in CYCLES and stage.rng.uniform() < roadside.ridden_probability:
            cycle(stage, kind, roadside)
        else:
            park(stage, kind, roadside)


def _success(kind: str, decoy_probability: float) -> float:
    """Fraction of the tries that end as an object. Where hardly any would, no more tries are made than for a tenth."""
    real = max(1.0 - decoy_probability, 0.1) / (1.0 - MEASURED_DECOYS)
    return SUCCESS[kind] * (real if kind in LARGE else 1.0)


def _plate(stage: Stage) -> None:
    """A steel plate on the road: a strong radar echo and no object."""
    spot = stage.spot(1.0)
    if spot is not None:
        asset = sample_asset("metal_plate", stage.rng)
        out = -stage.rng.uniform(0.8, 2.6) - asset.size[1] / 2 + 0.5
        stage.place(asset, Track.static([*spot.beside(out), 0.0], spot.yaw + stage.rng.normal(0.0, 0.3)))
