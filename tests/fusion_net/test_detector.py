"""Arrays in, boxes out: an evaluation's own boxes, with any subset of the sensors, and clear words for what is wrong."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.geometry import from_rpy
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.datamodule import make_loader
from fusion_net.detector import Calibration, Detections, Detector
from fusion_net.evaluation.drop_table import predict
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import trained_run
from tests.fixtures.tiny_tree import CAM_K, OPTICAL
from tests.fixtures.training_setup import SMALL, write_data
from tests.fixtures.untrained_run import write_run

ARRAYS = {"camera": "images", "lidar": "points", "radar": "radar"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of an untrained network, which validates on three samples of two cameras."""
    place = tmp_path_factory.mktemp("place")
    data = write_data(place / "tree")
    return write_run(place / "runs/mini", f"data.root={data}", *SMALL)


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
    assert len(detector(radar=np.zeros((0, 7)))) == len(nothing)  # a radar that is there may see nothing


def test_nothing_is_found_without_any_measurement_and_no_sensor_at_all_is_a_mistake(detector, dataset):
    found = detector(points=np.zeros((0, 3)))  # a LiDAR without a return is dead
    assert len(found) == 0
    assert found[found.score > 0.3].center.shape == (0, 3)
    for calibration in (None, arrays(dataset[0])["calibration"]):
        with pytest.raises(ValueError, match=r"no sensor is given; give images .*, points or radar"):
            detector(calibration=calibration)


@settings(max_examples=25)
@given(
    sensors=st.sets(st.sampled_from(["images", "points", "radar"]), min_size=1),
    cameras=st.integers(1, 3),
    as_tensor=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_subset_of_the_sensors_gives_boxes(detector, sensors, cameras, as_tensor, seed):
    rng = np.random.default_rng(seed)
    whole = {
        "images": rng.integers(0, 256, (cameras, 48, 80, 3), dtype=np.uint8),
        "points": rng.uniform([1, -10, -1, 0, 0], [30, 10, 3, 1, 0.5], (rng.integers(200), 5)),
        "radar": rng.uniform([1, -10, 0, -5, -9, -9, 0], [30, 10, 2, 30, 9, 9, 0.2], (rng.integers(30), 7)),
    }
    given_arrays = {name: torch.from_numpy(whole[name]) if as_tensor else whole[name] for name in sensors}
    pose = from_rpy(0.01, 0.03, 0.4, (1.7, 0.1, 1.5)) @ OPTICAL
    found = detector(**given_arrays, calibration=Calibration([CAM_K] * cameras, [pose] * cameras))
    assert set(found.name) <= set(detector.classes)
    assert all(
        np.isfinite(getattr(found, name)).all() for name in ("score", "center", "wlh", "yaw", "velocity", "sigma")
    )


def test_boxes_can_be_picked(detector, dataset):
    found = detector(radar=dataset[0].radar_points)
    best = found[found.score >= np.median(found.score)]
    assert 0 < len(best) < len(found)
    assert (best.sigma > 0).all()
    assert (np.diff(found.score) <= 0).all()
    assert set(found.name) <= set(detector.classes)
    assert detector.sensors == list(MODALITIES)


def posed(**parts):
    """A pose of two cameras, with parts of the first other than they must be."""
    pose = np.stack([from_rpy(0.01, 0.03, 0.4, (1.7, 0.1, 1.5)) @ OPTICAL] * 2)
    for place, value in parts.values():
        pose[(0, *place)] = value
    return pose


TURNED = posed()[0, :3, :3]
IMAGES = np.zeros((2, 48, 80, 3), np.uint8)
MISTAKES = [
    ({"calibration": None}, "images need calibration=Calibration"),
    (
        {"images": IMAGES.astype(float)},
        r"images of shapes \(48, 80, 3\) and types float64, .* np.uint8\(255 \* images\)",
    ),
    ({"images": IMAGES + 200.0}, r"values up to 200; give uint8 from 0 to 255: np.uint8\(images\)"),
    ({"images": np.zeros((2, 3, 48, 80), np.uint8)}, r"channels first; .*np.moveaxis\(images, -3, -1\)"),
    ({"images": [IMAGES[0], IMAGES[0, :40]]}, "all cameras need one size"),
    ({"images": IMAGES[..., 0]}, r"shapes \(2, 48, 80\) and types uint8; give \(N, H, W, 3\) uint8 RGB"),
    ({"images": []}, "images holds none"),
    ({"images": IMAGES[:1]}, "a matrix for each of 1 images"),
    ({"points": np.zeros((5, 2))}, "points of shape .5, 2.* x, y, z, intensity, dt, the first 3"),
    ({"points": np.array([["a"] * 4])}, "points of shape .1, 4. and type <U1; give rows of x, y, z"),
    ({"points": [[9, 1, 0, 40.0]]}, r"intensities \(column 3\) from 40 to 40, .* \[0, 1\]; divide those of nuScenes"),
    ({"points": [[9, 1, 0, -0.5]]}, "intensities .* from -0.5 to -0.5"),
    ({"points": [[9, 1, 0, 0.5, 31]]}, r"points has ages \(column 4\) up to 31 s; give the reference time minus"),
    (
        {"points": [[9, 1, 0], [9, np.nan, 0]]},
        r"1 of 2 rows of points are not finite, the first is row 1; leave them",
    ),
    ({"radar": np.zeros(7)}, "radar of shape .7. .* the first 6"),
    ({"radar": np.zeros((3, 18))}, r"radar of shape \[3, 18\] .* rows of x, y, z, rcs, vx, vy, dt, the first 6"),
    ({"radar": [[9, 1, 0, 3, np.inf, 0]]}, r"1 of 1 rows of radar are not finite, the first is row 0"),
    ({"radar": [[9, 1, 0, 3, 0, 0, 1.7e9]]}, r"radar has ages \(column 6\) up to 1.7e\+09 s"),
    ({"calibration": Calibration(np.eye(3), np.eye(3))}, r"cam_K of shape \[1, 3, 3\]; give \[2, 3, 3\]"),
    (
        {"calibration": Calibration([CAM_K, np.zeros((3, 3))], posed())},
        r"cam_K of camera 1 is no pinhole matrix; give \[\[fx, 0, cx",
    ),
    ({"calibration": Calibration([CAM_K.T, CAM_K], posed())}, "cam_K of camera 0 is no pinhole matrix"),
    ({"calibration": Calibration([CAM_K, CAM_K * np.nan], posed())}, "cam_K of camera 1 is not finite"),
    ({"calibration": Calibration("nano", posed())}, "cam_K is of type <U4; give numbers of shape"),
    (
        {"calibration": Calibration([CAM_K] * 2, posed(a=((3, 0), 1.7)))},
        r"camera 0 has the last row \[1.7, 0.0, 0.0, 1.0\]",
    ),
    (
        {"calibration": Calibration([CAM_K] * 2, posed().swapaxes(1, 2))},
        r"must be \[0, 0, 0, 1\]; it may be transposed",
    ),
    (
        {"calibration": Calibration([CAM_K] * 2, posed(a=(np.s_[:3, :3], 2 * TURNED)))},
        r"no rotation .* \[2.0, 2.0, 2.0\]",
    ),
    ({"calibration": Calibration([CAM_K] * 2, posed(a=(np.s_[:3, :3], -TURNED)))}, "camera 0 mirrors"),
]


@pytest.mark.parametrize(("change", "message"), MISTAKES, ids=[message[:40] for _, message in MISTAKES])
def test_mistakes_are_named_in_one_line(detector, dataset, change, message):
    with pytest.raises(ValueError, match=message) as error:
        detector(**arrays(dataset[0]) | change)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("calibration", [{"cam_K": CAM_K}, (CAM_K, np.eye(4))])
def test_a_calibration_is_a_calibration(detector, dataset, calibration):
    with pytest.raises(
        TypeError, match=r"calibration is a (dict|tuple); give Calibration\(cam_K=\.\.\., ego_T_cam=\.\.\.\)"
    ):
        detector(**arrays(dataset[0]) | {"calibration": calibration})


def test_a_network_says_which_sensors_it_takes(folder, dataset):
    trained = trained_run(folder, "best")
    detector = Detector(trained)
    detector.sensors = ["lidar"]
    with pytest.raises(ValueError, match="no encoder for camera; it takes lidar"):
        detector(**arrays(dataset[0]))
