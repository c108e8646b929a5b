"""The nuScenes map of a scene: the picture is one that the devkit understands, and what drives is on its road."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from data_gen.episode import build_episode
from data_gen.recording.writer import write_scene
from data_gen.rig.mounts import Lidar, Radar
from data_gen.rig.rig import Rig
from data_gen.scene.conditions import Condition, ConditionMix, Preset
from tests.fixtures.lidar_models import HDL32E
from tests.fixtures.scenarios import MIXED

RIG = Rig(
    name="tiny",
    cameras={},
    lidars={"LIDAR_TOP": Lidar(model=HDL32E, translation=[0.9, 0.0, 1.8], rate=10.0, columns=360)},
    radars={"RADAR_FRONT": Radar(translation=[3.4, 0.0, 0.5], rate=20.0)},
)
CLEAR = ConditionMix(
    presets={"clear": [Preset(illuminance=[5e4, 5e4], sun_elevation=[40.0, 40.0])]}, weights={"clear": 1}
)


@pytest.fixture(scope="module", params=["highway", "intersection", "roundabout", "merge"])
def written(request, tmp_path_factory):
    root = tmp_path_factory.mktemp(request.param)
    for channel in RIG.sensors:
        (root / "samples" / channel).mkdir(parents=True)
    (root / "maps").mkdir()
    scene = build_episode(
        name="scene-00004", layout=request.param, seed=11, duration=3.0, condition=CLEAR, scenario=MIXED
    )
    rows = write_scene(
        scene, RIG, root=root, dataset="tiny", index=4, keyframes=3, seed=11, layout=request.param
    )  # fmt: skip
    return root, rows


def mask_of(root, rows):
    path = root / rows["map"][0]["filename"]
    bit_depth, color_type = path.read_bytes()[24:26]
    assert (bit_depth, color_type) == (8, 0)  # of one bit, the devkit reads 0 and 1, and looks for 255
    mask = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert set(np.unique(mask)) == {0, 255}
    return mask


def is_on_mask(mask, xy):
    """What the devkit's ``MapMask`` does: 0.1 m a pixel, the picture's lower left corner at the global origin."""
    column, row = np.round(np.stack([xy[:, 0] * 10, mask.shape[0] - xy[:, 1] * 10])).astype(int)
    inside = (column >= 0) & (column < mask.shape[1]) & (row >= 0) & (row < mask.shape[0])
    return inside & (mask[row * inside, column * inside] == 255)


def test_what_drives_is_on_the_devkits_road(written):
    root, rows = written
    mask = mask_of(root, rows)
    ego = np.array([row["translation"] for row in rows["ego_pose"]])
    assert is_on_mask(mask, ego[:, :2]).all()
    categories = {row["token"]: row["category_token"] for row in rows["instance"]}
    assert categories
    moving = [r["translation"] for r in rows["sample_annotation"] if np.hypot(*r["velocity"]) > 4.0]
    assert len(moving) > 3
    assert is_on_mask(mask, np.array(moving)[:, :2]).mean() > 0.9
    assert (mask > 0).mean() < 0.4  # by chance few would be


def test_there_is_map_enough_around_the_ego_to_draw_it_from_above(written):
    root, rows = written
    height, width = mask_of(root, rows).shape
    ego = np.array([row["translation"] for row in rows["ego_pose"]])[:, :2]
    room = 50.0 * np.sqrt(2)  # the devkit cuts a square of 50 m out, turned by the heading
    assert (ego > room).all()
    assert (ego < np.array([width, height]) / 10 - room).all()


def test_each_scene_is_a_place_of_its_own(written):
    _, rows = written
    log, scene = rows["log"][0], rows["scene"][0]
    assert log["location"] == f"{scene['layout']}-scene-00004"
    assert rows["map"][0]["log_tokens"] == [log["token"]] == [scene["log_token"]]
    assert replace(Condition(), **scene["condition"]).name == "clear"
    json.dumps(rows)
