"""The gradient by part, and the batch whose loss was not finite."""

from dataclasses import replace

import pytest
import torch

from fusion_net.data.batch import Batch, Targets
from fusion_net.training.diagnostics import gradient_norms, save_nonfinite
from tests.fixtures.small_model import small_batch, small_early_model, small_model


def test_the_norms_of_the_parts_are_those_of_their_gradients():
    model, batch = small_model(), small_batch()
    model.loss(model(batch), batch)["loss"].backward()
    norms = gradient_norms(model)
    assert norms.keys() == {"camera", "lidar", "radar", "rest", "all"}
    radar = torch.cat([p.grad.flatten() for p in model.encoders["radar"].parameters() if p.grad is not None])
    assert float(norms["radar"]) == pytest.approx(float(radar.norm()), rel=1e-5)
    parts = [float(norm) ** 2 for name, norm in norms.items() if name != "all"]
    assert float(norms["all"]) ** 2 == pytest.approx(sum(parts), rel=1e-5)


@pytest.mark.parametrize("model", [small_model, small_early_model])
def test_a_part_without_a_gradient_is_left_out(model):
    """In the camera's own stage nothing else has one, whichever encoder the image network is in."""
    model, batch = model(), small_batch()
    model.camera_loss(batch)["loss"].backward()
    norms = gradient_norms(model)
    assert norms.keys() == {"camera", "all"}
    assert norms["camera"] == norms["all"] > 0


def test_what_is_saved_gives_the_loss_again(tmp_path):
    model, batch = small_model(), small_batch()
    present = batch.present.clone()
    present[0, 1] = False
    broken = replace(batch.targets, heatmap=batch.targets.heatmap * torch.nan)
    batch = replace(batch, present=present, targets=broken)
    losses = model.loss(model(batch), batch)
    path = tmp_path / "bad.pt"
    save_nonfinite(path, batch, losses, model, step=7, stage="fusion")
    saved = torch.load(path, weights_only=True)
    assert (saved["step"], saved["stage"], saved["tokens"]) == (7, "fusion", batch.tokens)
    other = small_model(seed=5)
    other.load_state_dict(saved["model"])
    again = Batch(**saved["batch"], targets=Targets(**saved["targets"]))
    for name, value in other.loss(other(again), again).items():
        torch.testing.assert_close(value, saved["losses"][name], equal_nan=True, rtol=0, atol=0)
    assert not torch.isfinite(saved["losses"]["loss"])
