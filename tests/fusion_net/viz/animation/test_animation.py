"""The animation shows what was there: a dead sensor has no points and red cells, and only what is near counts as found."""

import numpy as np
import pytest
from PIL import Image as Pillow

from fusion_net.common.boxes import Boxes
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.viz.animation.frame import DEAD, draw_frame, found_labels
from fusion_net.viz.animation.write import places_of, watch, write_gif
from fusion_net.viz.picture_sheet import RADAR, WIDTH
from tests.fixtures.small_model import CLASSES, GRID, small_model
from tests.fixtures.tiny_tree import write_tree

SENSORS = ["camera", "lidar", "radar"]


def boxes(*places, label=0, score=0.9):
    n = len(places)
    return Boxes(
        np.array([[*place, 1.0] for place in places]).reshape(n, 3), np.ones((n, 3)), np.zeros(n), np.zeros((n, 2)),
        np.full(n, label), np.full(n, score), np.zeros((n, 2)),
    )  # fmt: skip


def test_a_label_is_found_by_one_detection_of_its_class_within_two_metres():
    labels = boxes((10, 0), (11, 0), (20, 0))
    assert found_labels(labels, boxes((10, 1.9), (20, 2.1))).tolist() == [True, False, False]
    assert found_labels(labels, boxes((10.4, 0), (11.5, 0))).tolist() == [True, True, False]
    assert not found_labels(labels, boxes((10, 0), label=1)).any()
    assert found_labels(labels, Boxes.empty()).tolist() == [False] * 3
    assert found_labels(Boxes.empty(), labels).shape == (0,)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = write_tree(tmp_path_factory.mktemp("tree") / "tree", scenes=2, keyframes=6)
    return NuScenesDataset(str(root), "all", grid=GRID, classes=CLASSES)


def test_the_sensor_is_dead_in_the_second_third_and_its_points_are_not_drawn(dataset):
    name, places = places_of(dataset, "scene-0001")
    assert (name, len(places)) == ("scene-0001", 6)
    moments = watch(small_model().eval(), dataset, places, sensors=SENSORS, dies="radar", min_score=1.0)
    assert ["radar" in moment.sensors for moment in moments] == [True, True, False, False, True, True]
    assert [moment.time for moment in moments] == sorted(moment.time for moment in moments)
    frames = [
        draw_frame(moments, now, grid=GRID, dying="radar", sensors=SENSORS, min_score=1.0)
        for now in range(len(moments))
    ]
    assert len({frame.shape for frame in frames}) == 1
    blue = [(frame[30:, WIDTH + 4 :] == RADAR).all(axis=-1).sum() for frame in frames]
    red = [(frame[:, :WIDTH] == DEAD).all(axis=-1).sum() for frame in frames]
    assert blue[1] > 0
    assert blue[2] == blue[3] == 0
    assert red[1] < red[2] < red[3]


def test_without_a_name_it_is_a_scene_of_the_split_and_mistakes_are_named(dataset, tmp_path):
    assert places_of(dataset, None)[0] in ("scene-0000", "scene-0001")
    with pytest.raises(ValueError, match="did you mean 'scene-0001'"):
        places_of(dataset, "scene-001")
    short = NuScenesDataset(str(write_tree(tmp_path / "tree", scenes=1, keyframes=2)), "all", grid=GRID)
    with pytest.raises(ValueError, match=r"has 2 keyframes; 3 are needed, and python -m data_gen data=sequence"):
        places_of(short, None)


def test_the_file_holds_every_frame_and_stays_at_the_last(tmp_path):
    frames = [np.full((20, 30, 3), value, np.uint8) for value in (0, 90, 180)]
    write_gif(tmp_path / "a.gif", frames, fps=4.0, colors=16)
    with Pillow.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == 3
        durations = []
        for number, frame in enumerate(frames):
            gif.seek(number)
            durations.append(gif.info["duration"])
            assert np.abs(np.asarray(gif.convert("RGB"), int) - frame).max() < 8
    assert durations == [250, 250, 1000]
