"""The contact sheets: tiles where they belong, one scene in every condition, and mistakes in one line."""

import cv2
import numpy as np
import pytest

from data_gen.pictures.contact_sheet import draw_layouts
from data_gen.pictures.sensor_sheet import draw_sensors
from data_gen.pictures.sheet import GAP, HEAD, SIDE, short_scene, single_condition, write_sheet
from data_gen.rig.mounts import Camera, Lidar, Radar
from data_gen.rig.rig import Rig
from data_gen.scene.conditions import ConditionMix, Preset
from tests.fixtures.lidar_models import HDL32E
from tests.fixtures.scenarios import MIXED

CAMERA = Camera(translation=[1.7, 0.0, 1.5], rate=30.0, width=48, height=24, hfov_deg=70.0)
RIG = Rig(
    name="tiny",
    cameras={"CAM_FRONT": CAMERA},
    lidars={"LIDAR_TOP": Lidar(model=HDL32E, translation=[0.9, 0.0, 1.8], rate=10.0, columns=180)},
    radars={"RADAR_FRONT": Radar(translation=[3.4, 0.0, 0.5], rate=20.0)},
)
DAY = Preset(illuminance=[5e4, 5e4], sun_elevation=[40.0, 40.0])
FOG = [Preset(illuminance=[5e3, 5e3], sun_elevation=[30.0, 30.0], visibility=[v, v]) for v in (200.0, 100.0, 50.0)]
MIX = ConditionMix(presets={"clear": [DAY], "fog": FOG}, weights={"clear": 1, "fog": 1})


def test_tiles_are_written_pixel_by_pixel_beside_their_names(tmp_path):
    rng = np.random.default_rng(0)
    tiles = [[rng.integers(0, 255, (20, width, 3)).astype(np.uint8) for width in (30, 50)] for _ in range(3)]
    write_sheet(tmp_path / "sheet.png", tiles, row_names=["a\nb", "c", "d"], column_names=["x", "y"])
    sheet = cv2.imread(str(tmp_path / "sheet.png"))[..., ::-1]
    assert sheet.shape == (HEAD + 3 * (20 + GAP), SIDE + 30 + 50 + 2 * GAP, 3)
    top, left = HEAD + 2 * (20 + GAP), SIDE + 30 + GAP
    np.testing.assert_array_equal(sheet[top : top + 20, left : left + 50], tiles[2][1])
    assert (sheet[:HEAD, SIDE : SIDE + 30] < 128).any()  # a name


def test_the_road_and_its_traffic_are_the_same_in_every_condition():
    clear, fog = (
        short_scene(RIG, "two_way", MIXED, single_condition(MIX, name, 3), seed=3) for name in ("clear", "fog")
    )
    assert fog.condition.visibility == 50.0
    assert clear.condition.severity == 1  # it has no other
    np.testing.assert_array_equal(clear.ego.position, fog.ego.position)
    assert [actor.asset.category for actor in clear.actors] == [actor.asset.category for actor in fog.actors]


@pytest.mark.slow
def test_every_layout_and_every_sensor_has_its_place(tmp_path):
    settings = {"severity": 2, "seed": 3}
    draw_layouts(tmp_path / "layouts.png", RIG, MIXED, MIX, **settings)
    assert cv2.imread(str(tmp_path / "layouts.png")).shape == (HEAD + 8 * (24 + GAP), SIDE + 2 * (48 + GAP), 3)
    draw_sensors(tmp_path / "sensors.jpg", RIG, MIXED, MIX, layout="two_way", **settings)
    sheet = cv2.imread(str(tmp_path / "sensors.jpg"))
    clear, fog = sheet[HEAD : HEAD + 240, 164:964].std(), sheet[HEAD + 240 + GAP : HEAD + 480 + GAP, 164:964].std()
    assert fog < 0.8 * clear  # of the camera's tile


@pytest.mark.parametrize(
    ("sheet", "rig", "message"),
    [
        (draw_layouts, Rig(name="blind", cameras={}, lidars=RIG.lidars, radars={}), "rig 'blind' has no camera"),
        (draw_sensors, Rig(name="blind", cameras={}, lidars=RIG.lidars, radars={}), "rig 'blind' lacks a camera"),
    ],
)
def test_a_rig_without_what_the_sheet_shows_is_refused(tmp_path, sheet, rig, message):
    layout = {"layout": "two_way"} if sheet is draw_sensors else {}
    with pytest.raises(ValueError, match=message):
        sheet(tmp_path / "sheet.png", rig, MIXED, MIX, severity=1, seed=0, **layout)


def test_a_severity_below_the_mildest_is_refused():
    with pytest.raises(ValueError, match="severity=0: the mildest is 1"):
        single_condition(MIX, "fog", 0)
