"""Losses: finite where there is nothing, no gradient where there is no label, smallest at the truth."""

import math
from dataclasses import replace

import pytest
import torch

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.data.batch import Targets
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.blocks.outputs import ImagePredictions, Outputs
from fusion_net.models.center_head import regressions
from fusion_net.models.losses import WEIGHTS, DetectionLoss, center_nll, depth_loss, focal_loss, masked_l1
from tests.fixtures.random_batch import random_batch

GRID = BEVGrid(0.0, 16.0, -4.0, 8.0, 1.0)
BINS = DepthBins(2.0, 58.0, 14, "linear")


def detection_loss(**changes) -> DetectionLoss:
    settings = {"depth_supervision": "dense", "object_weight": 4.0, "peak_radius": 3, "box_radius": 1}
    settings["classes"] = ["car", "barrier"]
    weights = dict.fromkeys(WEIGHTS, 0.5)
    return DetectionLoss(**{"bins": BINS, "grid": GRID, "weights": weights} | settings | changes)


def test_focal_loss_by_hand():
    logits, heat = torch.tensor([[0.0, 0.0]]), torch.tensor([[1.0, 0.5]])
    expected = 0.25 * torch.tensor(2.0).log() * (1 + 0.5**4)
    torch.testing.assert_close(focal_loss(logits, heat), expected)


def test_focal_loss_is_finite_without_positives_and_at_extreme_logits():
    logits = torch.tensor([-200.0, 200.0, 0.0], requires_grad=True)
    focal_loss(logits, torch.tensor([1.0, 0.0, 0.3])).backward()
    assert logits.grad.isfinite().all()
    assert focal_loss(torch.full((4,), -100.0), torch.zeros(4)) == 0


def test_a_class_weight_scales_the_losses_of_its_own_map_alone():
    logits, heat = torch.randn(2, 3, 4, 4), torch.rand(2, 3, 4, 4)
    heat[0, :, 1, 1] = 1.0
    each = [focal_loss(logits[:, k], heat[:, k]) / 3 for k in range(3)]  # a third of the positives is each one's
    expected = sum(weight * loss for weight, loss in zip((1.0, 2.0, 0.5), each, strict=True))
    torch.testing.assert_close(focal_loss(logits, heat, [1.0, 2.0, 0.5]), expected)


@pytest.mark.parametrize("name", ["class_weights", "pixel_class_weights"])
@pytest.mark.parametrize("weights", [{"car": 1.0}, {"car": 1.0, "barrier": 0.0}, {"car": 1.0, "barrier": math.nan}])
def test_every_class_needs_a_weight_above_zero(name, weights):
    with pytest.raises(ValueError, match=rf"losses: {name}.barrier="):
        detection_loss(**{name: weights})


@pytest.mark.parametrize(("name", "value"), [("box_radius", -1), ("peak_radius", -1), ("object_weight", -1.0)])
def test_a_radius_or_weight_below_zero_is_refused(name, value):
    with pytest.raises(ValueError, match=f"{name}={value} must be a finite number, 0 or more"):
        detection_loss(**{name: value})


def test_an_unknown_velocity_has_no_gradient():
    values = torch.ones(3, 2, requires_grad=True)
    target = torch.tensor([[0.0, 0.0], [torch.nan, torch.nan], [1.0, 1.0]])
    loss = masked_l1(values, target)
    loss.backward()
    assert loss.item() == 1.0  # two objects know their velocity, their errors are 2 and 0
    assert not values.grad[1].any()
    assert masked_l1(torch.zeros(0, 2), torch.zeros(0, 2)) == 0


def _single(error_x: float, log_variance: float) -> tuple[dict[str, torch.Tensor], Targets]:
    rows, columns = GRID.shape
    zeros = {n: torch.zeros(1, c, rows, columns) for n, c in (("offset", 2), ("height", 1), ("size", 3), ("rot", 2))}
    mask, heat = torch.zeros(1, rows, columns, dtype=torch.bool), torch.zeros(1, 2, rows, columns)
    mask[0, 4, 9], heat[0, 1, 4, 9] = True, 1.0
    targets = Targets(heatmap=heat, mask=mask, velocity=torch.zeros(1, 2, rows, columns), **zeros)
    maps = {"heatmap": torch.full((1, 2, rows, columns), -5.0), "offset": torch.zeros(1, 2, rows, columns)}
    maps["heatmap"][0, 1, 4, 9] = 2.0
    maps["offset"][0, 0] = error_x
    maps["log_variance"] = torch.full((1, 2, rows, columns), log_variance)
    return maps, targets


def test_the_best_variance_is_the_squared_error():
    nll = [center_nll(*_single(0.5, v), grid=GRID, radius=2)[None] for v in (-2.2, -1.386, -0.6)]
    y_term = [
        torch.tensor(v).neg().div(2) for v in (-2.2, -1.386, -0.6)
    ]  # the exact y prefers small variances; take it out
    x_only = [float(a + b) for a, b in zip(nll, y_term, strict=True)]
    assert x_only[1] == min(x_only)


def test_variance_is_that_of_the_decoded_peak():
    """The strongest cell is two columns beside the object's: the error is two metres, not the offset at the true cell."""
    maps, targets = _single(0.0, 0.0)
    near = center_nll(maps, targets, grid=GRID, radius=2)
    maps["heatmap"][0, 1, 4, 11] = 5.0
    assert center_nll(maps, targets, grid=GRID, radius=2) - near == pytest.approx(0.5 * 2.0**2)
    maps["heatmap"][0, 0, 4, 10] = 9.0  # another class does not matter
    assert center_nll(maps, targets, grid=GRID, radius=2) - near == pytest.approx(0.5 * 2.0**2)


def test_the_box_is_learned_around_the_centre_as_seen_from_each_cell():
    """Offsets that point to the centre from every neighbour cost nothing; one cell further, nothing is learned."""
    maps, targets = _single(0.0, 0.0)
    maps |= {
        name: torch.zeros(1, c, *GRID.shape)
        for name, c in (("height", 1), ("size", 3), ("axis", 2), ("direction", 1), ("velocity", 2))
    }
    rows, columns = torch.meshgrid(*(torch.arange(n) for n in GRID.shape), indexing="ij")
    maps["offset"][0] = torch.stack([9 - columns, 4 - rows]) * GRID.cell
    loss = detection_loss()
    assert loss.box_terms(maps, targets)["loss/offset"] == 0
    maps["offset"][0, :, 4, 11] += 7.0
    assert loss.box_terms(maps, targets)["loss/offset"] == 0
    maps["offset"][0, 0, 4, 10] += 0.9
    assert loss.box_terms(maps, targets)["loss/offset"] == pytest.approx(0.5 * 0.9 / 9)
    narrow = detection_loss(box_radius=0)
    assert narrow.box_terms(maps, targets)["loss/offset"] == 0


def _headed(yaws, labels):
    """Maps of nothing and targets of objects, one a row, of these headings (radians) and labels."""
    rows, columns = GRID.shape
    mask, heat = torch.zeros(1, rows, columns, dtype=torch.bool), torch.zeros(1, 2, rows, columns)
    zeros = {n: torch.zeros(1, c, rows, columns) for n, c in (("offset", 2), ("height", 1), ("size", 3))}
    zeros |= {n: torch.zeros(1, 2, rows, columns) for n in ("rot", "velocity")}
    for i, (yaw, label) in enumerate(zip(yaws, labels, strict=True)):
        mask[0, 1, 3 * i], heat[0, label, 1, 3 * i] = True, 1.0
        zeros["rot"][0, :, 1, 3 * i] = torch.tensor([math.sin(yaw), math.cos(yaw)])
    maps = {n: torch.zeros(1, c, rows, columns) for n, c in ({"heatmap": 2} | regressions("axis")).items()}
    return maps, Targets(heatmap=heat, mask=mask, **zeros)


def test_a_body_and_the_same_turned_round_have_one_axis():
    """The two headings that a barrier may have as well agree, where their sines and cosines average to nothing."""
    maps, targets = _headed([0.6, 0.6 + math.pi], [1, 1])
    maps["axis"][:] = torch.tensor([math.sin(1.2), math.cos(1.2)])[:, None, None]
    assert detection_loss().box_terms(maps, targets)["loss/axis"] == pytest.approx(0, abs=1e-5)


def test_a_barrier_may_be_headed_either_way_and_a_car_may_not():
    """Sine and cosine of the heading turned round cost a barrier nothing, so that its two headings average to neither."""
    for label, is_free in ((1, True), (0, False)):
        maps, targets = _headed([0.6, 0.6 + math.pi], [label, label])
        maps["rot"] = torch.tensor([math.sin(0.6), math.cos(0.6)])[:, None, None].expand(1, 2, *GRID.shape).clone()
        for _ in range(2):
            assert (detection_loss().box_terms(maps, targets)["loss/rot"] < 1e-5) == is_free
            maps["rot"] *= -1


def test_a_symmetric_body_teaches_no_direction():
    (car, barrier) = (_headed([2.0], [label]) for label in (0, 1))
    for maps, targets, learned in ((*car, True), (*barrier, False)):
        maps["direction"].requires_grad_()
        terms = detection_loss().box_terms(maps, targets)
        terms["loss/direction"].backward()
        assert maps["direction"].grad.any() == learned
        assert terms["loss/axis"] > 0


def test_the_direction_says_which_end_is_the_front():
    maps, targets = _headed([0.1, 0.1 + math.pi], [0, 0])
    maps["direction"][..., :2], maps["direction"][..., 2:5] = 9.0, -9.0
    right = detection_loss().box_terms(maps, targets)["loss/direction"]
    maps["direction"] *= -1
    assert right < 1e-3
    assert detection_loss().box_terms(maps, targets)["loss/direction"] == pytest.approx(0.5 * 9.0, rel=1e-3)


@pytest.mark.parametrize("changed", WEIGHTS)
def test_each_weight_scales_its_own_term(changed):
    """Twice the weight is twice that term and leaves the others; NaN velocities and empty cells included."""
    batch = random_batch(2, grid=GRID, image=(32, 64), lidar=0, radar=0, classes=2)
    maps, image = _random_maps(), _predictions(batch)
    outputs = Outputs(maps, image, {"lidar": (maps["heatmap"] + 1, torch.tensor([True, False]))})
    terms = detection_loss()(outputs, batch)
    doubled = detection_loss(weights=dict.fromkeys(WEIGHTS, 0.5) | {changed: 1})(outputs, batch)
    assert set(terms) == {"loss", *(f"loss/{name}" for name in WEIGHTS)}
    for name in WEIGHTS:
        assert doubled[f"loss/{name}"] == terms[f"loss/{name}"] * (2 if name == changed else 1)
    assert doubled["loss"] - terms["loss"] == pytest.approx(float(terms[f"loss/{changed}"]), rel=1e-4)


def _random_maps():
    rng = torch.Generator().manual_seed(1)
    channels = {"heatmap": 2} | regressions("sincos") | regressions("axis")
    return {name: torch.randn(2, count, *GRID.shape, generator=rng) for name, count in channels.items()}


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (dict.fromkeys(WEIGHTS, 1.0) | {"heatmp": 1.0}, "there is no loss 'heatmp'; choose from heatmap, offset"),
        ({name: 1.0 for name in WEIGHTS if name != "rot"}, "no weight for rot"),
        (dict.fromkeys(WEIGHTS, 1.0) | {"depth": -0.3}, "depth=-0.3 must be a finite number of at least 0"),
        (dict.fromkeys(WEIGHTS, 1.0) | {"size": float("nan")}, "size=nan must be"),
    ],
)
def test_wrong_weights_are_named(weights, message):
    with pytest.raises(ValueError, match=f"weights: {message}"):
        detection_loss(weights=weights)


def test_depth_cells_without_return_have_no_gradient():
    logits = torch.randn(1, 1, BINS.count, 2, 3, requires_grad=True)
    depth = torch.tensor([[[[0.0, 10.0, 70.0], [1.0, 30.0, 0.0]]]])
    depth_loss(logits, depth, torch.ones_like(depth), BINS).backward()
    has_gradient = logits.grad.abs().sum(2)[0, 0] > 0
    assert has_gradient.tolist() == [[False, True, False], [False, True, False]]
    assert depth_loss(logits, torch.zeros_like(depth), torch.ones_like(depth), BINS) == 0


@pytest.mark.parametrize("supervision", ["none", "lidar", "dense"])
def test_depth_supervision_is_a_switch(supervision):
    batch = random_batch(1, grid=GRID, image=(32, 64), lidar=0, radar=0)
    loss = detection_loss(depth_supervision=supervision)
    terms = loss.image_terms(_predictions(batch), batch)
    assert ("loss/depth" in terms) == (supervision != "none")
    assert "loss/classes" in terms
    real = replace(batch, dense_depth=None, class_map=None)
    if supervision == "dense":
        with pytest.raises(ValueError, match="use lidar"):
            loss.image_terms(_predictions(real), real)
    else:
        assert loss.total(loss.image_terms(_predictions(real), real))["loss"].isfinite()


def _predictions(batch):
    b, n, h, w = batch.lidar_depth.shape
    return ImagePredictions(
        torch.randn(b, n, 4, h, w),
        torch.randn(b, n, BINS.count, h, w),
        torch.randn(b, n, 10, h, w),
        torch.randn(b, n, h, w),
    )
