"""The ground raster: what lies where on a straight, a curved and a crossing road."""

import numpy as np
import pytest

from data_gen.assets.shapes.mesh import TEXTURES
from data_gen.road.layout import Lane, Layout, record_layout
from data_gen.road.track import Track
from data_gen.world.ground import GROUND, GROUND_NAMES, GroundMap, ground_table
from data_gen.world.marks import crossings
from data_gen.world.paint import DASH, GAP, SHOULDER, VERGE, extend, paint_ground
from fusion_net.common.random import stream
from tests.fixtures.scenarios import MIXED


def lane(points, left="striped", right="continuous", width=3.6) -> Lane:
    points = np.asarray(points, float)
    return Lane(points, np.full(len(points), width), left, right, 25.0, False)


def straight(y, x0=20.0, x1=130.0, **lines) -> Lane:
    return lane(np.stack([np.linspace(x0, x1, 80), np.full(80, y)], axis=1), **lines)


def layout(name, lanes, extent=(150.0, 90.0)) -> Layout:
    return Layout(name, lanes, Track.static((60.0, 40.0, 0.0), 0.0), [], extent)


def names(ground: GroundMap, xy) -> list[str]:
    return [GROUND_NAMES[i] for i in ground.at(np.asarray(xy, float))]


@pytest.fixture(scope="module")
def highway() -> GroundMap:
    lanes = [
        straight(43.6, left="continuous", right="none"),
        straight(40.0, left="striped", right="none"),
        straight(36.4, left="striped", right="continuous"),
    ]
    return paint_ground(layout("highway", lanes), rng=stream(0, "test"))


def test_raster_covers_extent_not_square(highway):
    assert highway.material.shape == (900, 1500)
    assert highway.resolution == 0.1


def test_cross_section_of_highway(highway):
    """From the right: grass, hard shoulder, edge line at the lane's border, asphalt, the other edge line."""
    edge = 36.4 - 1.8
    assert set(names(highway, [(x, edge - VERGE + 0.3) for x in range(10, 140)])) == {"shoulder"}
    assert "white_paint" in names(highway, [(75.0, edge + d) for d in (-0.06, 0.0, 0.06)])
    assert set(names(highway, [(x, 75.0) for x in range(10, 140)])) <= {"grass", "dry_grass"}
    at_lane = names(highway, [(x, 36.4) for x in np.arange(21, 129, 0.5)])
    assert set(at_lane) <= {"asphalt", "patch", "tar"}
    assert at_lane.count("asphalt") > 0.7 * len(at_lane)


def test_edge_line_lies_on_the_lane_border_within_a_pixel(highway):
    column = highway.material[:, 750]
    paint = np.flatnonzero(np.isin(column, [GROUND_NAMES.index("white_paint")])) * 0.1 + 0.05
    for border in (36.4 - 1.8, 43.6 + 1.8):
        line = paint[np.abs(paint - border) < 0.4]
        assert 0.15 <= np.ptp(line) + 0.1 <= 0.35
        assert line.mean() == pytest.approx(border, abs=0.1)


def test_stripes_are_dashes_of_three_metres(highway):
    row = highway.material[int(41.8 / 0.1), 200:1300]
    painted = np.isin(row, [GROUND_NAMES.index("white_paint"), GROUND_NAMES.index("worn_paint")])
    runs = np.flatnonzero(np.diff(np.pad(painted.astype(int), 1))).reshape(-1, 2)
    lengths = (runs[:, 1] - runs[:, 0]) * 0.1
    np.testing.assert_allclose(np.median(lengths), DASH, atol=0.35)
    np.testing.assert_allclose(np.diff(runs[:, 0]) * 0.1, DASH + GAP, atol=0.25)


def test_road_goes_on_to_the_edge_of_the_raster(highway):
    assert set(names(highway, [(0.5, 40.0), (149.5, 40.0)])) <= {"asphalt", "patch", "tar"}


def test_lane_that_ends_beside_another_is_not_prolonged():
    through, ramp = straight(40.0), straight(36.4, x1=80.0)
    longer = extend([through, ramp], reach=50.0)
    assert longer[0].centre[-1] == pytest.approx([180.0, 40.0])
    assert longer[1].centre[-1] == pytest.approx([80.0, 36.4])
    assert len(longer[1].width) == len(longer[1].centre)


def test_centre_line_of_two_way_road_is_yellow_and_pavement_lies_beyond_the_kerb():
    ground = paint_ground(
        layout("two_way", [straight(40.0), straight(43.6, x0=130.0, x1=20.0, left="none")]), rng=stream(1, "test")
    )
    assert (ground.material == GROUND_NAMES.index("yellow_paint")).any()
    rows = np.flatnonzero((ground.material == GROUND_NAMES.index("yellow_paint")).any(axis=1)) * 0.1 + 0.05
    np.testing.assert_allclose(rows, 41.8, atol=0.25)
    edge = 40.0 - 1.8
    assert set(names(ground, [(x, edge - SHOULDER - VERGE / 2) for x in range(5, 145)])) == {"pavement"}
    assert set(names(ground, [(x, edge - SHOULDER - 0.15) for x in range(5, 145)])) == {"kerb"}
    assert not ground.drivable[int((edge - SHOULDER - 0.15) / 0.1), 700]


def test_drivable_is_the_union_of_the_lanes():
    """A bend: within a quarter of a metre of its border, a place is drivable exactly if it lies on the lane."""
    angle = np.linspace(0.0, np.pi / 2, 60)
    bend = lane(np.stack([40 + 30 * np.cos(angle), 30 + 30 * np.sin(angle)], axis=1), "none", "none", 4.0)
    ground = paint_ground(layout("racetrack", [bend], (110.0, 90.0)), rng=stream(2, "test"))
    rng = np.random.default_rng(0)
    theta, radius = rng.uniform(0.05, np.pi / 2 - 0.05, 4000), rng.uniform(25.0, 35.0, 4000)
    xy = np.stack([40 + radius * np.cos(theta), 30 + radius * np.sin(theta)], axis=1)
    cell = np.floor(xy / 0.1).astype(int)
    off = np.abs(radius - 30.0) - 2.0
    sure = np.abs(off) > 0.25
    np.testing.assert_array_equal(ground.drivable[cell[:, 1], cell[:, 0]][sure], (off < 0)[sure])


def cross_roads() -> list[Lane]:
    """Four arms of 60 m around a junction of 16 m, on the right, and the ways through it."""
    lanes = []
    for turn in range(4):
        c, s = np.cos(turn * np.pi / 2), np.sin(turn * np.pi / 2)
        rotate = np.array([[c, s], [-s, c]])
        inward = np.stack([np.linspace(-68.0, -8.0, 40), np.full(40, -1.8)], axis=1)
        through = np.stack([np.linspace(-8.0, 8.0, 12), np.full(12, -1.8)], axis=1)
        outward = np.stack([np.linspace(-8.0, -68.0, 40), np.full(40, 1.8)], axis=1)
        for part, left, right in (
            (inward, "striped", "continuous"),
            (through, "striped", "none"),
            (outward, "none", "continuous"),
        ):
            lanes.append(lane(part @ rotate + [75.0, 70.0], left, right))
    return lanes


def test_crossings_lie_across_the_four_arms_before_the_junction():
    found = crossings(
        layout("intersection", [*cross_roads(), lane([(67, 68.2), (70, 67), (73.2, 62.0)], "none", "none")])
    )
    assert len(found) == 4
    for crossing in found:
        assert crossing.width == pytest.approx(7.2, abs=0.1)
        towards = np.array([75.0, 70.0]) - crossing.middle
        assert np.linalg.norm(towards) == pytest.approx(11.0, abs=0.5)
        ahead = np.array([np.cos(crossing.yaw), np.sin(crossing.yaw)])
        assert ahead @ towards / np.linalg.norm(towards) == pytest.approx(1.0, abs=0.01)


def test_no_paint_across_the_junction():
    recorded = record_layout("intersection", seed=3, duration=2.0, traffic=MIXED.traffic)
    ground = paint_ground(recorded, rng=stream(3, "test"))
    arms = crossings(recorded)
    assert len(arms) >= 2
    at = [
        arm.middle + reach * np.array([np.cos(arm.yaw), np.sin(arm.yaw)])
        for arm in arms
        for reach in np.arange(5, 12, 0.1)
    ]
    assert set(names(ground, at)) <= {"asphalt", "patch", "tar"}


def test_same_stream_same_raster():
    lanes = [straight(40.0)]
    a, b, c = (paint_ground(layout("exit", lanes), rng=stream(seed, "g")).material for seed in (5, 5, 6))
    np.testing.assert_array_equal(a, b)
    assert (a != c).any()


def test_lookup_outside_is_grass_and_off_centre_origin_counts():
    ground = GroundMap(np.array([[1, 2, 3], [4, 5, 6]], np.uint8), (-2.0, 7.0), 0.5)
    np.testing.assert_array_equal(
        ground.at(np.array([[-1.9, 7.1], [-0.6, 7.9], [-2.1, 7.1], [-0.4, 7.1], [-1.9, 8.1]])), [1, 6, 0, 0, 0]
    )


def test_table_is_physical():
    albedo, texture, reflectivity = ground_table()
    assert albedo.shape == (len(GROUND), 3)
    assert ((albedo > 0) & (albedo < 1)).all()
    assert ((reflectivity > 0) & (reflectivity < 1)).all()
    assert (texture < len(TEXTURES)).all()
    assert reflectivity[GROUND_NAMES.index("white_paint")] > 3 * reflectivity[GROUND_NAMES.index("asphalt")]
