"""Scenarios: what each setting of ``configs/scenario`` does to the scenes, and what it refuses."""

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest

from data_gen.actors.traffic import populate
from data_gen.episode import Scenario
from data_gen.road.layout import LAYOUTS, Layout, record_layout
from data_gen.scene.scene import Actor
from fusion_net.common.cli.flags import UserError
from tests.fixtures.scenarios import MIXED, scenario

SEEDS = range(16)
DURATION = 0.4

Scenes = list[tuple[Layout, list[Actor]]]
RECORDED: dict[str, list[Layout]] = {}


def scenes(chosen: Scenario, layouts: tuple[str, ...] = LAYOUTS) -> Scenes:
    """A few short episodes of a scenario: who takes part, no world and no sensor."""
    key = repr((chosen.traffic, layouts))  # the roads are the same whatever is beside them
    if key not in RECORDED:
        names = [layouts[seed % len(layouts)] for seed in SEEDS]
        RECORDED[key] = [
            record_layout(name, seed=seed, duration=DURATION, traffic=chosen.traffic)
            for seed, name in zip(SEEDS, names, strict=True)
        ]
    return [
        (layout, populate(layout, seed=seed, traffic=chosen.traffic, roadside=chosen.roadside))
        for seed, layout in zip(SEEDS, RECORDED[key], strict=True)
    ]


@pytest.fixture(scope="module")
def mixed() -> Scenes:
    return scenes(MIXED)


def actors(found: Scenes) -> list[Actor]:
    return [actor for _, some in found for actor in some]


def count(found: Scenes, *, asset: str = "", attribute: str = "") -> int:
    """How many actors there are whose asset's name has this word and whose attribute begins so."""
    return sum(asset in a.asset.name and a.attribute.startswith(attribute) for a in actors(found))


def test_highway_only_has_nothing_but_highways():
    chosen = scenario("highway_only")
    for split in ("train", "val", "test"):
        assert {chosen.sample_layout(split, seed=seed) for seed in range(50)} == {"highway"}


def test_a_split_without_weights_of_its_own_has_those_of_train():
    drawn = {split: [MIXED.sample_layout(split, seed=s) for s in range(400)] for split in ("train", "val", "test")}
    assert drawn["val"] == drawn["train"] != drawn["test"]
    assert drawn["test"].count("roundabout") > 1.5 * drawn["train"].count("roundabout")


def test_dense_has_more_of_everything(mixed):
    dense = scenes(scenario("dense"))
    vehicles = [sum(len(layout.vehicles) for layout, _ in found) for found in (mixed, dense)]
    assert vehicles[1] > 1.15 * vehicles[0]
    for attribute in ("vehicle.parked", "pedestrian.standing", "pedestrian.moving"):
        assert count(dense, attribute=attribute) > 1.2 * count(mixed, attribute=attribute), attribute


def test_no_decoys_has_none_and_as_many_objects(mixed):
    honest = scenes(scenario("no_decoys"))
    assert count(mixed, asset="decoy ") > 10
    assert count(mixed, asset="scaled ") > 2
    assert count(mixed, asset="metal plate") > 2
    assert all(actor.asset.category for actor in actors(honest))
    objects = [sum(bool(actor.asset.category) for actor in actors(found)) for found in (mixed, honest)]
    assert 0.85 * objects[0] < objects[1] < 1.3 * objects[0]


def test_a_world_without_anybody():
    empty = scenes(scenario("mixed", "traffic.density=0", "roadside.density=0"))
    assert not actors(empty)
    assert all(not layout.vehicles for layout, _ in empty)


def speeds(found: Scenes, what: Callable[[Actor], bool]) -> list[float]:
    """Speeds in m/s of those who move."""
    tracks = [actor.track for actor in actors(found) if what(actor)]
    moving = [float(np.linalg.norm(track.at(DURATION / 2)[2])) for track in tracks]
    return [speed for speed in moving if speed > 0]


@pytest.mark.parametrize(
    ("setting", "asset", "attribute"),
    [
        ("roadside.walking=20", "walking", "pedestrian.moving"),
        ("roadside.standing=20", "pedestrian", "pedestrian.standing"),
        ("roadside.crossing=15", "walking", "pedestrian.moving"),
        ("roadside.in_view.car=14", "car", "vehicle.parked"),
        ("roadside.in_view.bicycle=6", "bicycle", ""),
        ("roadside.metal_plates=8", "metal plate", ""),
        ("roadside.scaled_decoys=8", "scaled ", ""),
        ("roadside.decoy_probability=0.8", "decoy ", ""),
        ("roadside.work_zone_length=[60,60]", "barrier", ""),
        ("traffic.class_mix.motorcycle=3", "motorcycle", "cycle.with_rider"),
        ("traffic.class_mix.truck=3", "truck", "vehicle.moving"),
        ("traffic.density=2", "", "vehicle.moving"),
    ],
)
def test_more_of_a_setting_is_more_of_it(mixed, setting, asset, attribute):
    more = scenes(scenario("mixed", setting))
    few, many = (count(found, asset=asset, attribute=attribute) for found in (mixed, more))
    assert many > 1.3 * few, (few, many)


@pytest.mark.parametrize(
    ("settings", "asset", "attribute"),
    [
        (["roadside.walking=0", "roadside.crossing=0", "roadside.work_zone_probability=0"], "", "pedestrian.moving"),
        (["roadside.standing=0", "roadside.work_zone_probability=0"], "", "pedestrian.standing"),
        (["roadside.work_zone_probability=0"], "traffic_cone", ""),
        (["roadside.in_view.car=0"], "car", "vehicle.parked"),
        (["roadside.ridden_probability=0"], "bicycle", "cycle.with_rider"),
        (["roadside.ridden_probability=1"], "", "cycle.without_rider"),
        (["traffic.trailer_probability=0"], "trailer", "vehicle.moving"),
        (["traffic.max_construction_speed=0"], "construction", "vehicle.moving"),
        (["traffic.class_mix.bus=0"], "bus", "vehicle.moving"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else value,
)
def test_a_setting_can_rule_out_what_it_is_about(settings, asset, attribute):
    assert count(scenes(scenario("mixed", *settings)), asset=asset, attribute=attribute) == 0


def test_speeds_are_within_their_ranges():
    fast = scenario(
        "mixed", "roadside.walking_speed=[4,4.5]", "roadside.crossing=0", "roadside.work_zone_probability=0"
    )
    walking = speeds(scenes(fast), lambda actor: actor.attribute == "pedestrian.moving")
    assert walking
    assert min(walking) > 2.5  # around a bend the outer edge is longer, the inner one shorter
    slow = scenario(
        "mixed", "traffic.speed.highway=[5,5]", "traffic.speed_factor=[1,1]", "traffic.ego_speed_factor=[1,1]"
    )
    found = scenes(slow, ("highway",))
    driven = speeds(found, lambda actor: actor.attribute == "vehicle.moving")
    egos = [float(np.linalg.norm(layout.ego.at(0.0)[2])) for layout, _ in found]
    assert max(driven + egos) < 5.5
    assert np.median(driven) > 3.0


def test_the_ego_waits_as_often_as_it_should():
    waiting = scenario("mixed", "traffic.waiting_probability=1", "traffic.queue_probability=0")
    never = scenario("mixed", "traffic.waiting_probability=0", "traffic.queue_probability=0", "traffic.density=0")

    def standing(chosen):
        tracks = [layout.ego for layout, _ in scenes(chosen)]
        return sum(min(np.linalg.norm(track.at(t)[2]) for t in (0.0, DURATION)) < 0.5 for track in tracks)

    assert standing(waiting) > 0.6 * len(SEEDS)
    assert standing(never) == 0


def test_the_class_mix_counts_relative_to_its_sum():
    double = scenario("mixed", *(f"traffic.class_mix.{k}={2 * v}" for k, v in MIXED.traffic.class_mix.items()))
    assert Counter(a.asset.name for a in actors(scenes(double))) == Counter(a.asset.name for a in actors(scenes(MIXED)))


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("traffic.density=-1", "scenario.traffic.density=-1 must be a finite number, 0 or more"),
        ("traffic.waiting_probability=1.2", "waiting_probability=1.2 is a probability: between 0 and 1"),
        ("traffic.speed.highway=[30,10]", r"speed.highway=\[30.0, 10.0\] must be \[lowest, highest\]"),
        ("traffic.speed.highway=[30]", r"speed.highway=\[30.0\] must be \[lowest, highest\]"),
        ("+traffic.class_mix.lorry=1", "unknown class of class_mix 'lorry'; did you mean 'motorcycle'"),
        (
            "traffic.class_mix={car:0,truck:0,bus:0,motorcycle:0,construction_vehicle:0}",
            "class_mix: none of the weights",
        ),
        ("traffic.class_mix.car=-0.1", "class_mix.car=-0.1 must be a finite number, 0 or more"),
        ("roadside.decoy_probability=25", "scenario.roadside.decoy_probability=25 is a probability"),
        ("+roadside.in_view.pedestrain=1", "unknown class of in_view 'pedestrain'; did you mean"),
        ("roadside.in_view.bus=-2", "in_view.bus=-2.0 must be a finite number"),
        ("roadside.walking_speed=[-1,2]", r"walking_speed=\[-1.0, 2.0\] must be \[lowest, highest\]"),
        ("~roadside.cycling_speed.bicycle", "cycling_speed: the class 'bicycle' is missing"),
        ("~traffic.speed.exit", "speed: the layout 'exit' is missing"),
        ("+layouts.train.roundabuot=1", "unknown layout of layouts.train 'roundabuot'; did you mean 'roundabout'"),
        ("layouts.test.highway=-1", "layouts.test.highway=-1 must be a finite number"),
        ("~layouts.train", "layouts: the split 'train' is missing"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(setting, message):
    with pytest.raises(UserError, match=message) as raised:
        scenario("mixed", setting)
    assert "\n" not in str(raised.value)
