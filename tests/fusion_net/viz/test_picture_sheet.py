"""The picture sheet draws what it is given, in the colours of its legend."""

import cv2
import numpy as np

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.viz.picture_sheet import FOUND, picture_sheet
from tests.fixtures.tiny_tree import write_tree

GRID = BEVGrid(0.0, 40.0, -12.0, 20.0, 0.8)


def test_predictions_above_the_score_are_drawn(tmp_path):
    dataset = NuScenesDataset(str(write_tree(tmp_path / "tree")), "all", grid=GRID)
    one = (
        np.array([[15.0, 2.0, 1.0]]),
        np.array([[2.0, 4.0, 2.0]]),
        np.zeros(1),
        np.zeros((1, 2)),
        np.zeros(1, np.int64),
    )
    orange = []
    for name, score in (("seen.png", 0.9), ("unsure.png", 0.1)):
        box = Boxes(*one, np.array([score]), np.zeros((1, 2)))
        picture_sheet(tmp_path / name, dataset, {dataset[i].token: box for i in range(len(dataset))}, samples=4)
        sheet = cv2.imread(str(tmp_path / name))[..., ::-1].astype(int)
        orange.append((np.abs(sheet - FOUND).sum(axis=-1) < 60).sum())
    assert orange[0] > orange[1] + 500
