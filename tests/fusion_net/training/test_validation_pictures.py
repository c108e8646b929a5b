"""Pictures of validation samples: everything at its place, and nothing of the run touched."""

import numpy as np
import pytest
import torch

from fusion_net.common.boxes import Boxes
from fusion_net.common.drawing import BEVPanel
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.training.validation_pictures import GAP, ValidationPictures
from tests.fixtures.small_model import CLASSES, GRID, small_early_model, small_model
from tests.fixtures.training_setup import write_data


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return str(write_data(tmp_path_factory.mktemp("data") / "tree", scenes=2))


@pytest.fixture(scope="module")
def dataset(root):
    return NuScenesDataset(root, "all", grid=GRID, classes=CLASSES)


def test_the_samples_are_fixed_and_spread_over_the_split(dataset):
    assert len(dataset) == 6
    assert ValidationPictures(dataset, count=3).places == [1, 3, 5]
    assert ValidationPictures(dataset, count=40).places == [0, 1, 2, 3, 4, 5]


def test_drawing_changes_neither_the_model_nor_the_random_state(dataset):
    model = small_model().eval()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    random = torch.get_rng_state()
    first, again = (ValidationPictures(dataset, count=2).draw(model) for _ in range(2))
    assert all(torch.equal(before[name], value) for name, value in model.state_dict().items())
    assert torch.equal(torch.get_rng_state(), random)
    assert not model.training
    assert not any(encoder._forward_hooks for encoder in model.encoders.values())
    assert len(first) == 2
    for one, other in zip(first, again, strict=True):
        assert one.dtype == np.uint8
        assert (one == other).all()
    assert (first[0] != first[1]).any()


def test_without_a_camera_the_ground_alone_is_drawn(root, dataset):
    blind = NuScenesDataset(root, "all", grid=GRID, classes=CLASSES, modalities=["lidar", "radar"])
    (with_camera,) = ValidationPictures(dataset, count=1).draw(small_model().eval())
    (without,) = ValidationPictures(blind, count=1).draw(small_model(names=("lidar", "radar")).eval())
    assert without.shape[1] < with_camera.shape[1]


def test_early_fusion_shows_the_maps_that_it_has(dataset):
    (mid,) = ValidationPictures(dataset, count=1).draw(small_model().eval())
    (early,) = ValidationPictures(dataset, count=1).draw(small_early_model().eval())
    assert early.shape[1] == mid.shape[1]  # the camera's depth is there too, its map is not
    assert early.any()


@pytest.mark.parametrize("xy", [(5.0, 3.0), (20.0, -7.0)])
def test_a_hot_cell_is_bright_where_its_ground_lies(dataset, xy):
    """Under the very pixel at which a box there would be drawn."""
    row, column, _ = GRID.rows_columns(torch.tensor(xy))
    heat = np.zeros(GRID.shape, np.float32)
    heat[row, column] = 3.0
    width = 4 * 100
    image = ValidationPictures(dataset)._bev_row({"hot": heat}, Boxes.empty(), Boxes.empty(), width)
    panel = BEVPanel(GRID, scale=(width - GAP) / (GRID.y_max - GRID.y_min))
    center = GRID.centers()[row, column].numpy()
    u, v = np.floor(panel.pixels(center[None])[0]).astype(int)
    caption = len(image) - panel.canvas().shape[0]
    assert image[caption + v, u].min() > 200
    assert (image[caption:].min(axis=-1) > 200).sum() == pytest.approx((panel.scale * GRID.cell) ** 2, rel=0.25)
