"""Arrays in, boxes out: an evaluation's own boxes, with any subset of the sensors, and clear words for what is wrong."""

from pathlib import Path

import numpy as np
import pytest
import torch

from fusion_net.common.cli.command import build
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.datamodule import make_loader
from fusion_net.detector import Calibration, Detections, Detector
from fusion_net.evaluate import open_samples
from fusion_net.evaluation.drop_table import predict
from fusion_net.runs.run_dir import open_run
from fusion_net.runs.trained import trained_run
from tests.fixtures.training_setup import settings, write_data

ARRAYS = {"camera": "images", "lidar": "points", "radar": "radar"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of an untrained network, which validates on three samples of two cameras."""
    place = tmp_path_factory.mktemp("place")
    data = write_data(place / "tree")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        torch.manual_seed(0)
        cfg = settings(data)
        folder = open_run(Path("runs/mini"), cfg, resume=False, overwrite=False)
        model = build(cfg.model, "model")
        weights = {f"model.{name}": value for name, value in model.state_dict().items()}
        torch.save({"state_dict": weights}, folder / "checkpoints/best.ckpt")
    return place / folder


@pytest.fixture(scope="module")
def detector(folder):
    return Detector.load(str(folder))


@pytest.fixture(scope="module")
def dataset(folder):
    return open_samples(trained_run(folder, "best"))


def arrays(sample):
    return {
        "images": sample.images,
        "points": sample.lidar_points,
        "radar": sample.radar_points,
        "calibration": Calibration(sample.cam_K, sample.ego_T_cam),
    }


def same(found, boxes, classes):
    np.testing.assert_allclose(found.center, boxes.center, atol=1e-4)
    np.testing.assert_allclose(found.score, boxes.score, atol=1e-6)
    np.testing.assert_allclose(found.velocity, boxes.velocity, atol=1e-4)
    np.testing.assert_allclose(
        np.stack([np.cos(found.yaw), np.sin(found.yaw)]), [np.cos(boxes.yaw), np.sin(boxes.yaw)], atol=1e-4
    )
    assert found.name.tolist() == [classes[label] for label in boxes.label]


def test_it_finds_what_an_evaluation_finds_with_every_subset_of_the_sensors(detector, dataset):
    subsets = [("camera", "lidar", "radar"), ("camera",), ("lidar", "radar"), ("radar",)]
    by_subset, _ = predict(detector.model, make_loader(dataset, batch_size=1), subsets=subsets)
    sample = dataset[1]
    for subset, found in zip(subsets, by_subset, strict=True):
        own = {ARRAYS[name]: arrays(sample)[ARRAYS[name]] for name in subset}
        ours = detector(**own, calibration=arrays(sample)["calibration"])
        assert len(ours)
        same(ours, found[sample.token], dataset.classes)


def test_tensors_and_one_camera_without_its_axis_are_as_good(detector, dataset):
    sample = dataset[0]
    one = detector(
        images=sample.images[:1],
        points=sample.lidar_points,
        calibration=Calibration(sample.cam_K[:1], sample.ego_T_cam[:1]),
    )
    other = detector(
        images=torch.from_numpy(sample.images[0].copy()),
        points=torch.from_numpy(sample.lidar_points.copy()),
        calibration=Calibration(torch.from_numpy(sample.cam_K[0].copy()), sample.ego_T_cam[0]),
    )
    np.testing.assert_array_equal(one.center, other.center)
    np.testing.assert_array_equal(one.name, other.name)


def test_what_a_sensor_does_not_measure_may_be_left_out(detector, dataset):
    points, radar = dataset[0].lidar_points.copy(), dataset[0].radar_points.copy()
    points[:, 3:], radar[:, 6] = 0, 0
    full = detector(points=points, radar=radar)
    short = detector(points=points[:, :3], radar=radar[:, :6])
    np.testing.assert_array_equal(full.score, short.score)


def test_no_return_is_no_mistake(detector):
    nothing = detector(points=np.zeros((0, 5)), radar=np.zeros((0, 7)))
    assert isinstance(nothing, Detections)
    assert np.isfinite(nothing.center).all()
    assert len(detector(points=np.full((4, 5), np.nan))) == len(detector(points=np.zeros((0, 3))))


def test_boxes_can_be_picked(detector, dataset):
    found = detector(radar=dataset[0].radar_points)
    best = found[found.score >= np.median(found.score)]
    assert 0 < len(best) < len(found)
    assert (best.sigma > 0).all()
    assert (np.diff(found.score) <= 0).all()
    assert set(found.name) <= set(detector.classes)
    assert detector.sensors == list(MODALITIES)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"images": None, "points": None, "radar": None}, "give at least one of images, points and radar"),
        ({"calibration": None}, "images need calibration=Calibration"),
        ({"images": np.zeros((2, 48, 80, 3))}, "uint8 RGB"),
        ({"images": np.zeros((2, 3, 48, 80), np.uint8)}, r"images of shapes \[\[3, 48, 80\]\]"),
        ({"images": np.zeros((1, 48, 80, 3), np.uint8)}, "a matrix for each of 1 images"),
        ({"points": np.zeros((5, 2))}, "points of shape .5, 2.* x, y, z, intensity, dt, the first 3"),
        ({"radar": np.zeros(7)}, "radar of shape .7. .* the first 6"),
        ({"calibration": Calibration(np.eye(3), np.eye(3))}, r"cam_K of shape \[1, 3, 3\]; give \[2, 3, 3\]"),
    ],
)
def test_mistakes_are_named(detector, dataset, change, message):
    with pytest.raises(ValueError, match=message):
        detector(**arrays(dataset[0]) | change)


def test_a_network_says_which_sensors_it_takes(folder, dataset):
    trained = trained_run(folder, "best")
    detector = Detector(trained)
    detector.sensors = ["lidar"]
    with pytest.raises(ValueError, match="no encoder for camera; it takes lidar"):
        detector(**arrays(dataset[0]))


def test_weights_that_are_not_there_are_named():
    with pytest.raises(FileNotFoundError, match="no shipped weights nonsense"):
        Detector.load("nonsense")
