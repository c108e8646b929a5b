"""What points are painted with, as a picture: right where nothing is wrong, and less so the more the LiDAR is turned."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.data.samples import SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.viz.calibration import turned
from fusion_net.viz.painting import BACKGROUND, UNSEEN, labels_of_boxes, painted_labels, write_painting
from tests.fixtures.tiny_tree import CAM_K, write_tree

PEDESTRIAN = CLASSES.index("pedestrian")


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return write_tree(tmp_path_factory.mktemp("tree") / "tree", scenes=2, keyframes=1)


@pytest.fixture(scope="module")
def sample(root):
    """A camera whose column of cells around its axis shows a pedestrian."""
    read = SampleReader(label_stride=8, cameras=["CAM_FRONT"]).read(NuScenes(root), "scene-0000-0")
    shown = np.full_like(read.class_map, -1)
    shown[..., int(CAM_K[0, 2] // 8)] = PEDESTRIAN
    return replace(read, class_map=shown)


def test_points_have_the_class_of_their_cell(sample):
    axis = sample.ego_T_cam[0][:3, 2]
    ahead = sample.ego_T_cam[0][:3, 3] + 12 * axis
    points = np.array([ahead, np.add(ahead, (0.0, 4.0, 0.0)), sample.ego_T_cam[0][:3, 3] - 12 * axis])
    assert painted_labels(sample, points, 8).tolist() == [PEDESTRIAN, BACKGROUND, UNSEEN]
    errors = [painted_labels(sample, turned(points, np.zeros(3), degrees), 8)[0] for degrees in (0.5, 20.0)]
    assert errors == [PEDESTRIAN, BACKGROUND]
    with pytest.raises(ValueError, match="no class images"):
        painted_labels(replace(sample, class_map=None), points, 8)


def test_a_point_has_the_class_of_the_box_that_it_lies_in():
    boxes = Boxes.labels(
        np.array([[10.0, 5, 1]]), np.array([[2.0, 6, 2]]), np.zeros(1), np.full((1, 2), np.nan), np.array([PEDESTRIAN])
    )
    assert labels_of_boxes(np.array([[12.5, 5.5, 1.0], [10.0, 8.0, 1.0]]), boxes).tolist() == [PEDESTRIAN, -1]
    assert labels_of_boxes(np.zeros((2, 3)), Boxes.empty()).tolist() == [-1, -1]


def test_the_sheet_is_written_and_mistakes_are_named(root, tmp_path, capsys):
    out = write_painting(str(root), sample=1, out=str(tmp_path / "sub" / "painting.png"))
    assert cv2.imread(str(out)).std() > 10
    assert "sample 1 of all, scene scene-0001" in capsys.readouterr().out
    for options, message in (({"sample": 2}, "samples 0 to 1"), ({"error_deg": 90.0}, "not within 45 degrees")):
        with pytest.raises(ValueError, match=message):
            write_painting(str(root), **options)
