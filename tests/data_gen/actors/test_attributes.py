"""Attributes of labels follow the motion at each keyframe, as nuScenes' annotators see it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_gen.recording.record import record_scene
from data_gen.recording.schedule import keyframe_times
from data_gen.recording.tokens import token
from data_gen.rig.mounts import Lidar
from data_gen.rig.rig import Rig
from data_gen.road.track import Track
from data_gen.scene.scene import STANDSTILL, Actor
from tests.fixtures.box_world import at, car, scene
from tests.fixtures.lidar_models import HDL32E

KEYFRAMES = 5
RIG = Rig(
    name="one",
    cameras={},
    radars={},
    lidars={"LIDAR_TOP": Lidar(translation=[0.9, 0.0, 1.8], rate=10.0, columns=360, model=HDL32E)},
)


def moving(start, speed_at):
    """A track along x whose speed in m/s is a function of the time in seconds."""
    times = np.linspace(0.0, 4.0, 81)
    speed = np.array([speed_at(t) for t in times], float)
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(times))])
    flat = np.zeros((len(times), 2))
    return Track(times, start + np.column_stack([way, flat]), 0 * times, np.column_stack([speed, flat]))


def brakes(t):
    """4 m/s, to a halt within two seconds."""
    return max(4.0 - 4.0 * max(t - 0.8, 0.0), 0.0)


@pytest.fixture(scope="module")
def labels(tmp_path_factory):
    """Attribute names and speeds at the keyframes: of a car that brakes to a halt, of one that sets off, of a parked one, of a
    pedestrian who stops, of a cyclist who does."""
    root = tmp_path_factory.mktemp("tree")
    for folder in ("samples/LIDAR_TOP", "sweeps/LIDAR_TOP", "maps"):
        (root / folder).mkdir(parents=True)
    who = [
        ("vehicle.car", "vehicle.moving", brakes),
        ("vehicle.car", "vehicle.moving", lambda t: max(2.0 * (t - 1.5), 0.0)),
        ("vehicle.car", "vehicle.parked", lambda t: 0.0),
        ("human.pedestrian.adult", "pedestrian.moving", lambda t: 1.2 * (t < 1.0)),
        ("vehicle.bicycle", "cycle.with_rider", brakes),
    ]
    actors = [(replace(car(), category=c), moving(at(10.0, 5.0 * i - 10.0, 0.0), v)) for i, (c, _, v) in enumerate(who)]
    world = scene(actors=actors)
    world.actors[:] = [replace(actor, attribute=a) for actor, (_, a, _) in zip(world.actors, who, strict=True)]
    rows = record_scene(world, RIG, root=root, dataset="t", index=0, keyframes=KEYFRAMES, seed=1, layout="boxes")
    names = ("vehicle.moving", "vehicle.stopped", "vehicle.parked", "pedestrian.moving", "pedestrian.standing")
    known = {token("attribute", name): name for name in (*names, "cycle.with_rider")}
    found: list[list[tuple[str, float]]] = [[] for _ in who]
    instances = [token(f"t-{world.name}", "instance", actor.instance) for actor in world.actors]
    for row in rows["sample_annotation"]:
        (attribute,) = row["attribute_tokens"]
        found[instances.index(row["instance_token"])].append((known[attribute], float(np.hypot(*row["velocity"]))))
    return found


def test_a_car_that_halts_has_stopped_and_one_that_sets_off_moves(labels):
    assert len(keyframe_times(RIG, KEYFRAMES)) == KEYFRAMES
    halts, sets_off = ([name for name, _ in track] for track in labels[:2])
    assert halts[0] == sets_off[-1] == "vehicle.moving"
    assert halts[-1] == sets_off[0] == "vehicle.stopped"


def test_the_attribute_agrees_with_the_velocity_of_the_same_label(labels):
    for track, (on_the_way, at_rest) in zip(
        labels,
        [("vehicle.moving", "vehicle.stopped")] * 2
        + [("vehicle.parked",) * 2, ("pedestrian.moving", "pedestrian.standing"), ("cycle.with_rider",) * 2],
        strict=True,
    ):
        assert len(track) == KEYFRAMES
        for name, speed in track:
            assert name == (at_rest if speed < STANDSTILL else on_the_way)


@given(st.floats(0.0, 40.0))
def test_only_who_takes_part_in_traffic_changes_state(speed):
    def told(attribute):
        return Actor(0, car(), Track.static((0, 0, 0), 0.0), attribute).attribute_at(speed)

    for fixed in ("vehicle.parked", "cycle.with_rider", "cycle.without_rider", "pedestrian.standing", ""):
        assert told(fixed) == fixed
    assert told("vehicle.moving") == ("vehicle.stopped" if speed < STANDSTILL else "vehicle.moving")
    assert STANDSTILL <= 0.2
