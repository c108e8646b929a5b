"""Marks and wear: arrows in their lanes, crossings along a street, edges within a cell, tracks where tyres roll."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from data_gen.road.layout import record_layout
from data_gen.scene.scene import WORLD
from data_gen.sensors.camera.rendering.ground_color import ground_colors
from data_gen.world.brush import Brush
from data_gen.world.ground import EVEN, GROUND_NAMES, TONE_STRIDE, GroundMap
from data_gen.world.marks import crossings, paint_arrows
from data_gen.world.paint import paint_ground
from fusion_net.common.random import stream
from tests.fixtures.scenarios import MIXED


@pytest.mark.parametrize("slope", [0.0, 0.1, 0.34, 1.0])
def test_cover_gives_the_area_of_a_line_and_of_a_polygon(slope):
    line = np.array([(5.0, 4.0), (25.0, 4.0 + 20.0 * slope)])
    length = np.hypot(20.0, 20.0 * slope)
    stroke, fill = Brush((60.0, 30.0), 0.1), Brush((60.0, 30.0), 0.1)
    stroke.stroke("white_paint", [line], 0.2)
    assert stroke.ground().cover.sum() / 255 * 0.01 == pytest.approx(0.2 * length, rel=0.12)
    across = 0.25 * np.array([-slope, 1.0]) / np.hypot(1.0, slope)
    fill.fill("white_paint", np.array([[line[0] + across, line[0] - across, line[1] - across, line[1] + across]]))
    assert fill.ground().cover.sum() / 255 * 0.01 == pytest.approx(0.5 * length, rel=0.05)


def test_arrows_lie_within_their_lanes_before_the_stop_line():
    layout = record_layout("intersection", seed=3, duration=2.0, traffic=MIXED.traffic)
    brush = Brush(layout.extent, 0.1)
    paint_arrows(brush, layout, layout.lanes, stream(0, "arrows"))
    row, column = np.nonzero(brush.canvas)
    assert len(row) > 200
    at = (np.stack([column, row], axis=1) + 0.5) * 0.1
    lane = cKDTree(np.concatenate([lane.centre for lane in layout.lanes])).query(at)[0]
    assert lane.max() < 1.6
    for zebra in crossings(layout):
        ahead = np.array([np.cos(zebra.yaw), np.sin(zebra.yaw)])
        reach = (at - zebra.middle) @ ahead
        across = np.abs((at - zebra.middle) @ [-ahead[1], ahead[0]])
        arm = reach[(across < zebra.width / 2) & (np.abs(reach) < 25.0)]
        assert arm.max(initial=-9.0) < -3.1  # the stop line ends 2.9 m before the middle


def test_a_street_has_crossings_from_kerb_to_kerb_every_eighty_metres():
    layout = record_layout("two_way", seed=3, duration=2.0, traffic=MIXED.traffic)
    found = crossings(layout)
    ground = paint_ground(layout, rng=stream(3, "ground"))
    assert len(found) >= 2
    np.testing.assert_allclose(
        np.linalg.norm(np.diff([zebra.middle for zebra in found], axis=0), axis=1), 80.0, atol=2.0
    )
    for zebra in found:
        left = np.array([-np.sin(zebra.yaw), np.cos(zebra.yaw)])
        line = zebra.middle + np.arange(-zebra.width / 2 + 0.4, zebra.width / 2 - 0.4, 0.1)[:, None] * left
        share = (ground.at(line) == GROUND_NAMES.index("white_paint")).mean()
        assert share == pytest.approx(0.5, abs=0.15)


def test_tyres_darken_two_tracks_in_each_lane():
    layout = record_layout("two_way", seed=6, duration=2.0, traffic=MIXED.traffic)
    ground = paint_ground(layout, rng=stream(6, "ground"))
    lane = layout.lanes[0]
    normal = np.stack([-np.sin(lane.yaw), np.cos(lane.yaw)], axis=1)

    def tone(offset):
        at = lane.centre + offset * normal
        cell = (at[((at > 1) & (at < np.array(layout.extent) - 1)).all(axis=1)] / 0.1 / TONE_STRIDE).astype(int)
        return ground.tone[cell[:, 1], cell[:, 0]].mean()

    assert max(tone(-0.8), tone(0.8)) < 0.93 * min(tone(-1.6), tone(1.6))


def ground_at(ground: GroundMap, x: float, y: float, pixel: float) -> np.ndarray:
    """What a camera one metre above the ground sees straight below it through one pixel, of ``pixel`` metres on the ground."""
    table = np.zeros((len(GROUND_NAMES), 3), np.float32)
    table[GROUND_NAMES.index("white_paint")] = 1.0
    out = np.zeros((1, 5), np.float32)
    down, up = np.array([[0.0, 0.0, -1.0]], np.float32), np.array([[0.0, 0.0, 1.0]], np.float32)
    hit = (
        np.full(1, WORLD, np.int32),
        np.zeros(1, np.int32),
        np.ones(1, np.float32),
        np.array([[x, y, 0.0]], np.float32),
        up,
    )
    view = np.array([[x, y, 1.0], [0.0, 0.0, -1.0], [pixel, 0.0, 0.0], [0.0, pixel, 0.0]])
    rasters = (ground.material, ground.cover, ground.tone, np.zeros(2), ground.resolution, table)
    ground_colors(view, down, pixel, 1.0, hit, 2, rasters, out)
    return out[0, :3]


def test_close_up_the_edge_of_a_line_runs_straight_through_the_cells():
    """A line that climbs one cell in ten has its edge where geometry says, to a third of a cell, and no stairs."""
    brush = Brush((20.0, 12.0), 0.1)
    brush.stroke("white_paint", [np.array([(2.0, 4.0), (18.0, 5.6)])], 0.4)
    ground = brush.ground()
    scan = np.arange(0.1, 0.3, 0.01)
    edges = []
    for x in np.arange(6.0, 14.0, 0.31):
        bright = np.array([ground_at(ground, x, 4.0 + (x - 2.0) / 10 + dy, 0.01)[0] for dy in scan])
        edges.append(scan[np.argmax(bright < 0.5)])
    assert np.mean(edges) == pytest.approx(0.2, abs=0.03)
    assert np.std(edges) < 0.015


def test_old_asphalt_is_pale_but_paint_no_whiter_than_white():
    material = np.full((80, 90), GROUND_NAMES.index("white_paint"), np.uint8)
    worn = GroundMap(material, (0.0, 0.0), 0.1, tone=np.full((40, 45), int(1.5 * EVEN), np.uint8))
    assert ground_at(worn, 4.5, 4.0, 0.02)[0] == pytest.approx(1.0)
    dark = GroundMap(material, (0.0, 0.0), 0.1, tone=np.full((40, 45), EVEN // 2, np.uint8))
    assert ground_at(dark, 4.5, 4.0, 0.02)[0] == pytest.approx(0.5)
