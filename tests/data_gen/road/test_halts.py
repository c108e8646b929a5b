"""The ego that waits: how often, how it stops and sets off, and what the others do meanwhile."""

import numpy as np
import pytest
from scipy.stats import binom

from data_gen.actors.stage import EGO_SIZE
from data_gen.actors.traffic import populate
from data_gen.road.footprints import overlaps
from data_gen.road.halts import BRAKE, NEVER, Halt, choose_halt
from data_gen.road.layout import LAYOUTS, REAR_AXLE, Layout, record_layout
from fusion_net.common.random import stream
from tests.fixtures.scenarios import MIXED

DURATION = 3.0
TIMES = np.linspace(0.0, DURATION, 31)
STANDS = 0.1
WAITING = MIXED.traffic.waiting_probability


def speeds(track) -> np.ndarray:
    return np.linalg.norm(track.at(TIMES)[2], axis=1)


@pytest.fixture(scope="module")
def halting() -> list[tuple[int, Layout]]:
    """Seeds whose ego halts by plan, and their layouts."""
    found = [(seed, LAYOUTS[seed % 8]) for seed in range(240)]
    found = [(s, name) for s, name in found if choose_halt(stream(s, "halt", name), DURATION, WAITING) is not NEVER]
    return [(s, record_layout(name, seed=s, duration=DURATION, traffic=MIXED.traffic)) for s, name in found]


def test_the_stated_fraction_of_scenes_has_a_halt_of_each_kind():
    halts = [choose_halt(stream(seed, "halt"), DURATION, WAITING) for seed in range(3000)]
    chosen = [halt for halt in halts if halt is not NEVER]
    low, high = binom.interval(0.999, len(halts), WAITING)
    assert low <= len(chosen) <= high
    kinds = [(np.isinf(halt.start), np.isinf(halt.end)) for halt in chosen]
    for kind in ((True, True), (True, False), (False, True)):
        assert kinds.count(kind) > 0.2 * len(chosen)


def test_who_halts_stands_for_a_part_of_the_scene_or_all_of_it(halting):
    """Within the tenth of a second of the decisions; a driver that has somebody ahead may stand longer."""
    kinds = set()
    for seed, layout in halting:
        still = speeds(layout.ego) < STANDS
        assert still.any(), (seed, layout.name)
        halt = choose_halt(stream(seed, "halt", layout.name), DURATION, WAITING)
        assert still[(halt.start + 0.5 < TIMES) & (halt.end - 0.1 > TIMES)].all(), (seed, layout.name)
        kinds.add((bool(still[0]), bool(still[-1])))
    assert kinds == {(True, True), (True, False), (False, True)}


def test_a_standing_ego_does_not_creep(halting):
    for _, layout in halting:
        velocity = layout.ego.at(TIMES)[2]
        still = np.flatnonzero(np.linalg.norm(velocity, axis=1) == 0.0)
        position, yaw, _ = layout.ego.at(TIMES)
        both = still[:-1][np.diff(still) == 1]
        np.testing.assert_allclose(position[both + 1], position[both], atol=1e-9)
        np.testing.assert_allclose(yaw[both + 1], yaw[both], atol=1e-9)


def test_others_drive_on_around_a_standing_ego_and_nobody_touches(halting):
    moving = [any(speeds(track).max() > 1.0 for track in layout.vehicles) for _, layout in halting]
    assert np.mean(moving) > 0.7
    for seed, layout in halting[::3]:
        actors = populate(layout, seed=seed, traffic=MIXED.traffic, roadside=MIXED.roadside)
        position, yaw, _ = layout.ego.at(TIMES)
        ego = position[:, :2] + REAR_AXLE * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        for actor in actors:
            there, turn, _ = actor.track.at(TIMES)
            assert not overlaps(ego, yaw, (4.8, 1.9), there[:, :2], turn, actor.asset.size[:2]).any(), seed


def test_who_follows_a_standing_ego_halts_behind_it(halting):
    """Nobody in the ego's lane behind it is about to run into it: there is room to brake at 6 m/s^2."""
    for _, layout in halting:
        position, yaw, velocity = layout.ego.at(DURATION)
        ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        for track in layout.vehicles:
            there, turn, speed = track.at(DURATION)
            along, across = (there - position)[:2] @ ahead - REAR_AXLE, (there - position)[:2] @ left
            closing = max(float((speed - velocity)[:2] @ ahead), 0.0)
            if abs(across) < 1.5 and np.cos(turn - yaw) > 0.9 and along < 0:
                assert -along - EGO_SIZE[0] > closing**2 / 12, layout.name


def test_a_driver_brakes_just_in_time_and_holds_until_the_end():
    """From 5 m/s at 2.5 m/s^2 it takes two seconds: to stand at 2 s it begins at 0 s."""
    halt = Halt(2.0, 3.0)
    assert BRAKE == 2.5
    assert [halt.brakes(t, 5.0) for t in (-0.1, 0.0, 2.9, 3.0)] == [False, True, True, False]
    assert [halt.brakes(t, 0.0) for t in (1.9, 2.0)] == [False, True]
    assert halt.approach_speed(0.5) == 6.25
    assert Halt(-np.inf, 3.0).approach_speed(0.5) == 0.0
    assert not NEVER.brakes(1e6, 50.0)
