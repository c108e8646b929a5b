"""Three detectors behind one interface: what a dead sensor, a batch, a swap and an oracle change, and what they do not."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.late.late_fusion import LateFusion
from tests.fixtures.small_model import GRID, single, small_batch, small_late, small_model


def decoded(model, batch, present=None):
    with torch.no_grad():
        return model.decode(model(batch, present))


def assert_same(found: Boxes, expected: Boxes):
    """The thirty best boxes of one are among the other's, but for one: of a hundred faint peaks the last may be another, and of
    two neighbouring cells that are alike to a rounding the other may be the peak."""
    best = expected[:30]
    away = np.linalg.norm(best.center[:, None] - found.center[None], axis=2)
    away[best.label[:, None] != found.label[None]] = np.inf
    twin = found[away.argmin(axis=1)]
    same = np.ones(len(best), bool)
    for name in ("center", "wlh", "velocity", "score", "log_variance"):
        close = np.isclose(getattr(twin, name), getattr(best, name), rtol=1e-3, atol=1e-3)
        same &= close.reshape(len(best), -1).all(axis=1)
    assert same.sum() >= len(best) - 1


def test_the_detectors_share_no_weights():
    model = small_late()
    owners = {}
    for name, detector in model.detectors.items():
        for parameter in detector.parameters():
            assert owners.setdefault(parameter.data_ptr(), name) == name
    assert sum(p.numel() for p in model.parameters()) == sum(
        p.numel() for d in model.detectors.values() for p in d.parameters()
    )


def test_with_one_sensor_the_boxes_are_its_detectors():
    model, batch = small_late().eval(), small_batch()
    for i, name in enumerate(MODALITIES):
        only = torch.arange(3) == i
        alone = decoded(model.detectors[name], batch)
        for found, expected in zip(decoded(model, batch, batch.present & only), alone, strict=True):
            assert len(found) == len(expected)
            order, other = (np.lexsort(boxes.center.T) for boxes in (found, expected))
            np.testing.assert_allclose(found.center[order], expected.center[other])
            np.testing.assert_allclose(found.score[order], expected.score[other], atol=1e-5)  # not calibrated yet


def test_a_dead_sensor_is_silent_in_its_sample_alone_whatever_it_holds():
    model, batch = small_late().eval(), small_batch()
    present = batch.present.clone()
    present[1, MODALITIES.index("lidar")] = False
    noise = batch.lidar_points.clone()
    noise[batch.lidar_batch == 1] = torch.nan
    with torch.no_grad():
        lists = model.estimates(model(replace(batch, lidar_points=noise), present))
    assert [len(each["lidar"]) > 0 for each in lists] == [True, False, True]
    assert all(len(each["radar"]) and len(each["camera"]) for each in lists)


def test_a_detector_without_any_sample_is_not_run():
    model, batch = small_late().eval(), small_batch()
    model.detectors["camera"].register_forward_hook(lambda *_: pytest.fail("the camera was used"))
    outputs = model(batch, batch.present & torch.tensor([False, True, True]))
    assert outputs.image is None


@pytest.mark.parametrize("training", [True, False])
def test_no_sensor_at_all(training):
    model, batch = small_late().train(training), small_batch()
    outputs = model(batch, torch.zeros_like(batch.present))
    loss = model.loss(outputs, batch)["loss"]
    loss.backward()
    assert loss == 0
    assert [len(boxes) for boxes in model.decode(outputs)] == [0, 0, 0]


def test_a_batch_is_its_samples():
    model, batch = small_late().eval(), small_batch()
    together = decoded(model, batch)
    for i in range(batch.size):
        (alone,) = decoded(model, single(batch, i))
        assert_same(together[i], alone)


def test_each_detector_learns_from_its_own_loss_and_the_samples_that_have_its_sensor():
    model, batch = small_late(), small_batch()
    present = batch.present.clone()
    present[:, MODALITIES.index("radar")] = False
    present[1:, MODALITIES.index("lidar")] = False
    terms = model.loss(model(batch, present), batch)
    terms["loss"].backward()
    learning = {n: any(p.grad is not None and p.grad.any() for p in d.parameters()) for n, d in model.detectors.items()}
    assert learning == {"camera": True, "lidar": True, "radar": False}
    torch.testing.assert_close(terms["loss"], sum(value for key, value in terms.items() if key != "loss"))
    assert {"loss/camera_depth", "loss/lidar_heatmap"} <= set(terms)
    assert not any(key.startswith("loss/radar") for key in terms)


def test_given_detectors_are_used_as_they_are_and_learn_nothing():
    given = small_model(names=["camera"], seed=5)
    before = {key: value.clone() for key, value in given.state_dict().items()}
    model, batch = small_late(detectors={"camera": given}), small_batch()
    outputs = model(batch)
    model.loss(outputs, batch)["loss"].backward()
    assert set(outputs.by_sensor) == {"lidar", "radar"}
    assert all(p.grad is None for p in given.parameters())
    assert not given.training
    assert all(torch.equal(value, before[key]) for key, value in given.state_dict().items())
    with torch.no_grad():
        assert set(model.eval()(batch).by_sensor) == set(MODALITIES)


@pytest.mark.parametrize(
    ("detector", "answer"),
    [
        (
            lambda: small_model(names=["lidar"]),
            r"late\.detectors\.camera: a detector of lidar, where the camera's alone",
        ),
        (lambda: small_model(), r"late\.detectors\.camera: a detector of camera, lidar, radar, where"),
    ],
)
def test_a_detector_of_other_sensors_is_refused(detector, answer):
    with pytest.raises(ValueError, match=answer):
        small_late(detectors={"camera": detector()})


def test_a_detector_of_another_grid_is_refused():
    other = BEVGrid(GRID.x_min, GRID.x_max, GRID.y_min, GRID.y_max + 8, GRID.cell)
    camera = small_model(names=["camera"])
    camera.grid = other
    with pytest.raises(ValueError, match=r"late\.detectors\.camera: its grid is BEVGrid\(.*that of this model BEVGrid"):
        small_late(detectors={"camera": camera})


def test_the_oracle_merges_what_took_one_label_and_needs_labels():
    model, batch = small_late(association="oracle", min_probability=0.0).eval(), small_batch(1)
    with pytest.raises(
        ValueError, match=r"late\.association=oracle pairs boxes through labels, and this batch has none"
    ):
        decoded(model, batch)
    with torch.no_grad():
        lists = model.estimates(model(batch))[0]
    target = lists["lidar"].boxes[:1]
    labels = Boxes.labels(target.center, target.wlh, target.yaw, target.velocity, target.label)
    with torch.no_grad():
        found = model.estimates(model(replace(batch, boxes=(labels,))), with_truth=True)[0]
    sees = [name for name, each in found.items() if (each.truth == 0).any()]
    assert "lidar" in sees
    fused = model.fuse(found)
    assert len(fused) == sum(map(len, found.values())) - (len(sees) - 1)


@pytest.mark.parametrize("wrong", [{"gate": 1.0}, {"min_probability": 2.0}])
def test_numbers_that_no_gate_has(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        small_late(**wrong)


def test_the_calibration_is_among_the_weights():
    model = small_late()
    model.calibration["radar"].factor.fill_(3.0)
    again = small_late(seed=1)
    again.load_state_dict(model.state_dict())
    assert isinstance(again, LateFusion)
    assert (again.calibration["radar"].factor == 3).all()
