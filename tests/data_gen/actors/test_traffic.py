from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.stats import binom, ks_2samp

from data_gen.actors.stage import Stage
from data_gen.actors.traffic import populate, towed
from data_gen.road.ego import REAR_AXLE
from data_gen.road.footprints import Occupancy, overlaps
from data_gen.road.layout import LAYOUTS, Layout, record_layout
from data_gen.road.track import Track
from data_gen.scene.scene import STANDSTILL, Actor
from data_gen.world.marks import crossings
from fusion_net.common.nuscenes_format import CATEGORY_TO_CLASS, CLASSES
from tests.fixtures.scenarios import MIXED

DURATION = 1.6


@pytest.fixture(scope="module")
def scenes() -> list[tuple[Layout, list[Actor]]]:
    layouts = [
        record_layout(LAYOUTS[seed % len(LAYOUTS)], seed=seed, duration=DURATION, traffic=MIXED.traffic)
        for seed in range(24)
    ]
    return [
        (layout, populate(layout, seed=seed, traffic=MIXED.traffic, roadside=MIXED.roadside))
        for seed, layout in enumerate(layouts)
    ]


def test_no_two_bodies_ever_overlap(scenes: list[tuple[Layout, list[Actor]]]) -> None:
    t = np.linspace(0.0, DURATION, 33)
    for layout, actors in scenes:
        paths = [actor.track.at(t) for actor in actors]
        position, yaw, _ = layout.ego.at(t)
        ego = position[:, :2] + REAR_AXLE * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        center = np.stack([ego, *(path[0][:, :2] for path in paths)])
        yaws = np.stack([yaw, *(path[1] for path in paths)])
        size = np.array([(4.8, 1.9), *(actor.asset.size[:2] for actor in actors)])[:, None]
        a, b = np.triu_indices(len(center), 1)
        touching = overlaps(center[a], yaws[a], size[a], center[b], yaws[b], size[b]).any(axis=1)
        assert not touching.any(), [(layout.name, a[i], b[i]) for i in np.flatnonzero(touching)]


def test_the_ego_may_drive_on_for_a_second(scenes: list[tuple[Layout, list[Actor]]]) -> None:
    """Nothing at rest off the lanes' traffic stands where the ego is going."""
    t = np.linspace(0.0, DURATION + 1.0, 20)
    for layout, actors in scenes:
        position, yaw, _ = layout.ego.at(t)
        ego = position[:, :2] + REAR_AXLE * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        for actor in actors:
            if len(actor.track.times) == 1 and not actor.track.velocity.any():
                body = actor.track.position[0], actor.track.yaw[0], actor.asset.size[:2]
                assert not overlaps(ego, yaw, (4.8, 1.9), *body).any()


def test_attributes_tell_the_state(scenes: list[tuple[Layout, list[Actor]]]) -> None:
    for actor in (actor for _, actors in scenes for actor in actors):
        speeds = np.linalg.norm(actor.track.at(np.linspace(0, DURATION, 9))[2], axis=1)
        speed = speeds.mean()
        family = actor.attribute.split(".")[0]
        name = CATEGORY_TO_CLASS.get(actor.asset.category, "")
        if not name or name in ("traffic_cone", "barrier"):
            assert actor.attribute == ""
            assert speed == 0.0
        elif name in ("motorcycle", "bicycle"):
            assert actor.attribute == ("cycle.with_rider" if "rider" in actor.asset.name else "cycle.without_rider")
        elif name == "pedestrian":
            assert actor.attribute == ("pedestrian.moving" if speed > 0.1 else "pedestrian.standing")
        else:
            assert family == "vehicle"
            told = [actor.attribute_at(float(v)) for v in speeds]
            assert all((a == "vehicle.moving") == (v >= STANDSTILL) for a, v in zip(told, speeds, strict=True))
            assert (
                ("vehicle.parked" in told) == (actor.attribute == "vehicle.parked") == (set(told) == {"vehicle.parked"})
            )
            assert len(actor.track.times) == 1 or actor.attribute != "vehicle.parked"


def test_what_moves_faces_where_it_goes(scenes: list[tuple[Layout, list[Actor]]]) -> None:
    for actor in (actor for _, actors in scenes for actor in actors):
        position, yaw, velocity = actor.track.at(np.linspace(0, DURATION, 9))
        assert np.all(position[:, 2] == 0.0)
        quick = np.linalg.norm(velocity, axis=1) > 2.0
        ahead = velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw)
        assert np.all(ahead[quick] > 0.85 * np.linalg.norm(velocity[quick], axis=1))


def test_all_classes_occur_and_instances_are_distinct(scenes: list[tuple[Layout, list[Actor]]]) -> None:
    count = Counter(CATEGORY_TO_CLASS.get(actor.asset.category) for _, actors in scenes for actor in actors)
    assert set(CLASSES) <= set(count)
    for _, actors in scenes:
        assert [actor.instance for actor in actors] == list(range(len(actors)))


@pytest.fixture(scope="module")
def standing() -> dict[str, dict[bool, np.ndarray]]:
    """What may be a decoy, of many scenes: by kind, whether it is one: distance from the road's edge, from the ego (m) and
    heading against the nearest lane (rad, 0..pi/2), one row a body. Kinds that share one way of placing are pooled."""
    rows: dict[str, dict[bool, list]] = {kind: {True: [], False: []} for kind in ("large", "machine", "pedestrian")}
    for seed in range(100, 180):
        layout = record_layout(LAYOUTS[seed % len(LAYOUTS)], seed=seed, duration=0.4, traffic=MIXED.traffic)
        centres, yaw = (np.concatenate([getattr(lane, key) for lane in layout.lanes]) for key in ("centre", "yaw"))
        tree, half = cKDTree(centres), np.concatenate([lane.width for lane in layout.lanes]) / 2
        for actor in populate(layout, seed=seed, traffic=MIXED.traffic, roadside=MIXED.roadside):
            is_decoy = actor.asset.name.startswith("decoy ")
            if not is_decoy and actor.attribute not in ("vehicle.parked", "pedestrian.standing"):
                continue
            kind = actor.asset.name.removeprefix("decoy ").split()[0]
            place = {"construction": "machine", "pedestrian": "pedestrian", "car": ""}.get(kind, "large")
            if place:
                at = actor.track.position[0, :2]
                distance, near = tree.query(at)
                turn = abs((actor.track.yaw[0] - yaw[near] + np.pi / 2) % np.pi - np.pi / 2)
                ego = np.linalg.norm(at - layout.ego.position[0, :2])
                rows[place][is_decoy].append((distance - half[near], ego, turn))
                assert actor.asset.category == ("" if is_decoy else actor.asset.category)
                assert len(actor.track.times) == 1
                assert not actor.track.velocity.any()
    return {kind: {key: np.array(values) for key, values in pair.items()} for kind, pair in rows.items()}


@pytest.mark.parametrize("kind", ["large", "machine", "pedestrian"])
def test_the_stated_fraction_of_what_stands_is_a_decoy(standing, kind) -> None:
    """Every body that may be a decoy is one with probability ``decoy_probability``: the count is binomial."""
    decoys, real = len(standing[kind][True]), len(standing[kind][False])
    low, high = binom.interval(0.999, decoys + real, MIXED.roadside.decoy_probability)
    assert low <= decoys <= high, (kind, decoys, real)


@pytest.mark.parametrize("kind", ["large", "machine", "pedestrian"])
@pytest.mark.parametrize("quantity", [0, 1, 2], ids=["off the road", "from the ego", "heading"])
def test_decoys_stand_where_and_how_real_ones_stand(standing, kind, quantity) -> None:
    """Neither place nor heading tells a decoy: both samples may come from one distribution (Kolmogorov-Smirnov)."""
    decoys, real = (standing[kind][key][:, quantity] for key in (True, False))
    assert ks_2samp(decoys, real).pvalue > 1e-3


def test_most_who_cross_the_road_in_sight_of_a_zebra_crossing_do_so_on_it() -> None:
    on, off = 0, 0
    for seed in range(200, 260):
        layout = record_layout(
            ("two_way", "intersection", "roundabout")[seed % 3], seed=seed, duration=0.4, traffic=MIXED.traffic
        )
        lanes = cKDTree(np.concatenate([lane.centre for lane in layout.lanes]))
        yaw = np.concatenate([lane.yaw for lane in layout.lanes])
        view = Stage(layout, np.random.default_rng(0))
        zebras = [zebra for zebra in crossings(layout) if view.visibility(zebra.middle) > 0.3]
        if not zebras:
            continue
        for actor in populate(layout, seed=seed, traffic=MIXED.traffic, roadside=MIXED.roadside):
            at, heading = actor.track.position[0, :2], actor.track.yaw[0]
            distance, near = lanes.query(at)
            if actor.attribute == "pedestrian.moving" and distance < 3.0 and abs(np.sin(heading - yaw[near])) > 0.9:
                delta = [at - zebra.middle for zebra in zebras]
                along = [abs(d @ [np.cos(z.yaw), np.sin(z.yaw)]) for d, z in zip(delta, zebras, strict=True)]
                is_on = any(a < 1.5 and np.hypot(*d) < z.width for a, d, z in zip(along, delta, zebras, strict=True))
                on, off = on + is_on, off + (not is_on)
    assert on + off > 10
    assert on > off, (on, off)


def test_populate_depends_on_its_seed_alone() -> None:
    layout = record_layout("intersection", seed=5, duration=DURATION, traffic=MIXED.traffic)
    first = populate(layout, seed=5, traffic=MIXED.traffic, roadside=MIXED.roadside)
    populate(
        record_layout("highway", seed=1, duration=DURATION, traffic=MIXED.traffic),
        seed=1,
        traffic=MIXED.traffic,
        roadside=MIXED.roadside,
    )
    second, other = (
        populate(layout, seed=5, traffic=MIXED.traffic, roadside=MIXED.roadside),
        populate(layout, seed=6, traffic=MIXED.traffic, roadside=MIXED.roadside),
    )
    describe = [
        [(a.asset.name, a.attribute, a.track.position.tolist()) for a in actors] for actors in (first, second, other)
    ]
    assert describe[0] == describe[1]
    assert describe[0] != describe[2]


def test_an_empty_road_is_legitimate() -> None:
    layout = record_layout("two_way", seed=2, duration=DURATION, traffic=MIXED.traffic)
    alone = Layout(layout.name, layout.lanes, layout.ego, [], layout.extent)
    empty = replace(MIXED.roadside, density=0.0)
    assert populate(alone, seed=0, traffic=MIXED.traffic, roadside=empty) == []


def test_a_trailer_on_a_straight_follows_in_line_and_in_a_bend_cuts_in() -> None:
    t = np.linspace(0.0, 2.0, 21)
    straight = Track(t, np.stack([8 * t, 0 * t, 0 * t], axis=1), 0 * t, np.tile([8.0, 0.0, 0.0], (21, 1)))
    behind = towed(straight, hitch=-3.4, length=10.0)
    np.testing.assert_allclose(behind.position[:, :2], np.stack([8 * t - 8.4, 0 * t], axis=1), atol=1e-9)
    np.testing.assert_allclose(behind.velocity, straight.velocity, atol=1e-9)
    radius, yaw = 30.0, 8 * t / 30.0
    circle = radius * np.stack([np.sin(yaw), -np.cos(yaw), 0 * t], axis=1)
    truck = Track(t, circle, yaw, 8 * np.stack([np.cos(yaw), np.sin(yaw), 0 * t], axis=1))
    trailer = towed(truck, hitch=-3.4, length=10.0)
    off = np.linalg.norm(trailer.position[:, :2], axis=1)
    assert off.max() < np.hypot(radius, 3.4)
    np.testing.assert_allclose(off, off[0], atol=0.3)  # it begins in the steady state and stays there
    pin = trailer.position[:, :2] + 5.0 * np.stack([np.cos(trailer.yaw), np.sin(trailer.yaw)], axis=1)
    hitch = circle[:, :2] - 3.4 * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    np.testing.assert_allclose(pin, hitch, atol=1e-9)


angle = st.floats(-7.0, 7.0)
side = st.floats(0.3, 12.0)


@settings(max_examples=60)
@given(angle, angle, side, side, side, side, st.floats(-10, 10), st.floats(-10, 10))
def test_overlap_is_what_sampled_points_say(yaw_a, yaw_b, la, wa, lb, wb, x, y) -> None:
    grid = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 41), np.linspace(-0.5, 0.5, 41)), axis=-1).reshape(-1, 2)
    c, s = np.cos(yaw_b), np.sin(yaw_b)
    points = grid * (lb, wb) @ np.array([[c, s], [-s, c]]) + (x, y)
    c, s = np.cos(yaw_a), np.sin(yaw_a)
    local = np.abs(points @ np.array([[c, -s], [s, c]]))
    seen = bool(((local[:, 0] <= la / 2) & (local[:, 1] <= wa / 2)).any())
    found = bool(overlaps((0.0, 0.0), yaw_a, (la, wa), (x, y), yaw_b, (lb, wb)))
    swollen = bool(overlaps((0.0, 0.0), yaw_a, (la + 0.4, wa + 0.4), (x, y), yaw_b, (lb, wb)))
    assert found or not seen  # a common point means that they meet
    assert swollen or not found


def test_occupancy_sees_bodies_only_while_they_are_there() -> None:
    ground, t = Occupancy(5), np.arange(5.0)
    ground.add(np.stack([10 * t, 0 * t], axis=1), 0.0, (4.0, 2.0))
    assert not ground.free((20.0, 1.2), 0.3, (1.0, 1.0))
    assert ground.free(np.stack([10 * t[::-1] + 5, 0 * t], axis=1), 0.0, (4.0, 2.0))
    assert ground.free((20.0, 1.6), 0.0, (1.0, 1.0))
    assert not ground.free((20.0, 1.6), 0.0, (1.0, 1.0), margin=0.2)
