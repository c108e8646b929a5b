"""The map lies where nuScenes has it: 0.1 m a pixel, its lower left corner at the global origin."""

import json

import cv2
import numpy as np

from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.viz.rerun_log.ground import COARSER, ELSE, ROAD, ground
from fusion_net.viz.rerun_log.readings import Scene
from tests.fixtures.tiny_tree import write_tree


def test_a_road_is_where_it_is_in_the_world(tmp_path):
    root = write_tree(tmp_path / "tree", scenes=1, keyframes=1)
    nusc = NuScenes(root)
    scene = Scene(nusc, nusc.get("scene", "scene-0000") | {"log_token": "log"}, nusc.split("all"))
    assert ground(scene) is None  # no table of maps
    (root / "maps").mkdir()
    mask = np.zeros((900, 1000), np.uint8)
    mask[900 - 400 : 900 - 200, 300:600] = 255  # x 30 to 60 m, y 20 to 40 m
    record = {"token": "map", "log_tokens": ["log"], "filename": "maps/a.png"}
    (nusc.folder / "map.json").write_text(json.dumps([record]))
    assert ground(scene) is None  # its file is not there
    cv2.imwrite(str(root / "maps/a.png"), mask)
    plane = ground(scene)
    (left, bottom), (right, top) = plane.corners[0, :2], plane.corners[2, :2]
    assert (left, bottom) == (0, 0)  # the path is near the origin: no farther than the mask reaches
    assert right < 100.1
    assert top < 90.1
    height, width = plane.image.shape[:2]
    assert width == round(right * 10 / COARSER)

    def color_at(x, y):
        return tuple(plane.image[int(height * (top - y) / (top - bottom)), int(width * (x - left) / (right - left))])

    assert color_at(31, 21) == color_at(59, 39) == ROAD
    assert color_at(29, 21) == color_at(31, 19) == color_at(59, 41) == color_at(61, 39) == ELSE
    other = Scene(nusc, scene.record | {"log_token": "another"}, scene.tokens)
    assert ground(other) is None
