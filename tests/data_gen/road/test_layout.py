import warnings

import numpy as np
import pytest
from highway_env.envs.intersection_env import IntersectionEnv
from highway_env.vehicle.behavior import IDMVehicle

from data_gen.road.ego import REAR_AXLE
from data_gen.road.footprints import overlaps
from data_gen.road.layout import LAYOUTS, Layout, _track, record_layout
from tests.fixtures.scenarios import MIXED

DURATION = 1.6


@pytest.fixture(scope="module")
def layouts() -> dict[str, Layout]:
    return {name: record_layout(name, seed=11, duration=DURATION, traffic=MIXED.traffic) for name in LAYOUTS}


def _numbers(layout: Layout) -> list[np.ndarray]:
    tracks = [layout.ego, *layout.vehicles]
    return [a for t in tracks for a in (t.times, t.position, t.yaw, t.velocity)] + [
        lane.centre for lane in layout.lanes
    ]


def _same(a: Layout, b: Layout) -> bool:
    a_numbers, b_numbers = _numbers(a), _numbers(b)
    return len(a_numbers) == len(b_numbers) and all(map(np.array_equal, a_numbers, b_numbers))


def test_the_eight_layouts_exist() -> None:
    assert LAYOUTS == ("highway", "merge", "exit", "roundabout", "intersection", "two_way", "racetrack", "u_turn")


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_same_seed_gives_the_same_tracks_whatever_was_made_before(name: str, layouts: dict[str, Layout]) -> None:
    wanted = {key: getattr(IDMVehicle, key) for key in ("DISTANCE_WANTED", "COMFORT_ACC_MAX", "COMFORT_ACC_MIN")}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            IntersectionEnv()  # writes on IDMVehicle itself
        assert wanted["COMFORT_ACC_MAX"] != IDMVehicle.COMFORT_ACC_MAX
        np.random.seed(3)  # noqa: NPY002  # the global generator must not matter either
        assert _same(record_layout(name, seed=11, duration=DURATION, traffic=MIXED.traffic), layouts[name])
    finally:
        for key, value in wanted.items():
            setattr(IDMVehicle, key, value)


def test_recording_leaves_no_trace_on_highway_env(layouts: dict[str, Layout]) -> None:
    assert (IDMVehicle.DISTANCE_WANTED, IDMVehicle.COMFORT_ACC_MAX, IDMVehicle.COMFORT_ACC_MIN) == (10.0, 3.0, -5.0)


@pytest.mark.parametrize("name", LAYOUTS)
def test_another_seed_gives_another_scene(name: str, layouts: dict[str, Layout]) -> None:
    assert not _same(record_layout(name, seed=12, duration=DURATION, traffic=MIXED.traffic), layouts[name])


@pytest.mark.parametrize("name", LAYOUTS)
def test_velocity_is_the_derivative_of_position(name: str, layouts: dict[str, Layout]) -> None:
    t = np.linspace(0.05, DURATION - 0.05, 60)
    for track in (layouts[name].ego, *layouts[name].vehicles):
        before, after = track.at(t - 1e-3)[0], track.at(t + 1e-3)[0]
        assert np.abs((after - before) / 2e-3 - track.at(t)[2]).max() < 0.05
        steps = np.diff(track.position, axis=0) / np.diff(track.times)[:, None]  # no jumps: records against velocities
        assert np.abs(steps - (track.velocity[1:] + track.velocity[:-1]) / 2).max() < 0.35


@pytest.mark.parametrize("name", LAYOUTS)
def test_vehicles_never_touch(name: str, layouts: dict[str, Layout]) -> None:
    layout, t = layouts[name], np.linspace(0.0, DURATION, 41)
    position, yaw, _ = layout.ego.at(t)
    centers, yaws = [position[:, :2] + REAR_AXLE * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)], [yaw]
    for track in layout.vehicles:
        position, yaw, _ = track.at(t)
        centers.append(position[:, :2])
        yaws.append(yaw)
    center, yaw = np.array(centers), np.array(yaws)
    a, b = np.triu_indices(len(center), 1)
    assert not overlaps(center[a], yaw[a], (4.9, 1.9), center[b], yaw[b], (4.9, 1.9)).any()


def test_y_points_left() -> None:
    """A vehicle of highway-env that turns towards its +y turns right, and drifts to the right by its slip."""
    heading, slip, speed = np.array([0.0, 0.1]), 0.05, 10.0
    track = _track(np.stack([[0.0, 1.0], [0.0, 0.1], heading, [speed, speed], [slip, slip]], axis=1))
    np.testing.assert_allclose(track.yaw, -heading)
    assert track.position[1, 1] < 0
    np.testing.assert_allclose(track.velocity[0, :2], [speed * np.cos(slip), -speed * np.sin(slip)])


def test_the_ego_frame_turns_about_the_rear_axle() -> None:
    """In steady cornering, speed and slip of the bicycle fix the velocity of every point of the body."""
    slip, speed, step = 0.2, 5.0, 0.1
    rate = speed * np.sin(slip) / 2.5
    heading = rate * step * np.arange(30)
    circle = speed / rate * np.stack([np.sin(heading + slip), -np.cos(heading + slip)], axis=1)
    states = np.column_stack([circle, heading, np.full(30, speed), np.full(30, slip)])
    track = _track(states, -REAR_AXLE)
    np.testing.assert_allclose(np.gradient(track.position, step, axis=0)[2:-2], track.velocity[2:-2], atol=0.01)


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_world_holds_the_path_and_its_surroundings(name: str, layouts: dict[str, Layout]) -> None:
    layout = layouts[name]
    path = layout.ego.position[:, :2]
    np.testing.assert_allclose(path.min(axis=0), 100.0)
    np.testing.assert_allclose(np.array(layout.extent) - path.max(axis=0), 100.0)
    for lane in layout.lanes:
        assert np.linalg.norm(np.diff(lane.centre, axis=0), axis=1).max() <= 2.0
        assert len(lane.width) == len(lane.centre) > 1
        assert {lane.left_line, lane.right_line} <= {"none", "striped", "continuous"}


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_ego_drives_on_a_lane_and_in_its_direction(name: str) -> None:
    speeds = []
    for seed, duration in enumerate((DURATION, DURATION, 11.0)):  # 11 s: the twenty keyframes of data=sequence
        layout = record_layout(name, seed=seed, duration=duration, traffic=MIXED.traffic)
        point = layout.ego.position[:, :2] + REAR_AXLE * np.stack(
            [np.cos(layout.ego.yaw), np.sin(layout.ego.yaw)], axis=1
        )
        centre, yaw = (np.concatenate([getattr(lane, key) for lane in layout.lanes]) for key in ("centre", "yaw"))
        near = np.linalg.norm(point[:, None] - centre, axis=-1) < 3.0
        along = np.cos(yaw[None] - layout.ego.yaw[:, None]) > 0.85
        assert (near & along).any(axis=1).all()
        speeds.append(np.linalg.norm(layout.ego.velocity, axis=1).mean())
    assert max(speeds) > 4.0


def test_lines_are_on_the_side_of_travel_that_they_name(layouts: dict[str, Layout]) -> None:
    """On the two-way road, traffic keeps right: the striped line between the directions is on each lane's left."""
    for lane in layouts["two_way"].lanes:
        others = [other for other in layouts["two_way"].lanes if other is not lane]
        left = np.array([-np.sin(lane.yaw[0]), np.cos(lane.yaw[0])])
        assert (others[0].centre.mean(axis=0) - lane.centre.mean(axis=0)) @ left > 3.0
        assert lane.right_line == "continuous"


def test_bad_input_is_one_clear_line() -> None:
    with pytest.raises(ValueError, match="did you mean 'roundabout'") as error:
        record_layout("roundabuot", seed=0, duration=1.0, traffic=MIXED.traffic)
    assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match="duration=0"):
        record_layout("highway", seed=0, duration=0.0, traffic=MIXED.traffic)


def test_traffic_too_dense_to_begin_names_the_key_to_lower(monkeypatch):
    monkeypatch.setattr("data_gen.road.layout._simulate", lambda *_, **__: None)
    with pytest.raises(ValueError, match=r"seed 3: .* in a row end in a collision; lower scenario.traffic.density=1.0"):
        record_layout("two_way", seed=3, duration=1.0, traffic=MIXED.traffic)
