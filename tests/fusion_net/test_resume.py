"""A run that was interrupted and resumed ends with exactly the weights of one that was not."""

import csv

import pytest
import torch
from training_setup import settings, write_data

from fusion_net.training.callbacks import PlanCallback
from fusion_net.training.fit import fit

STEPS = (
    "trainer.camera_steps=3",
    "trainer.alone_steps=0",
    "trainer.fusion_steps=9",
    "trainer.batch_size=2",
)  # three epochs of four batches and more


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_data(tmp_path_factory.mktemp("data") / "tree")


def checkpoint(folder):
    return torch.load(folder / "checkpoints" / "last.ckpt", weights_only=True)


def fit_until(step, cfg):
    """Trains and presses Ctrl-C before this step."""
    start = PlanCallback.on_train_batch_start

    def cut(self, trainer, pl_module, batch, batch_idx):
        if trainer.global_step == step:
            raise KeyboardInterrupt
        return start(self, trainer, pl_module, batch, batch_idx)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PlanCallback, "on_train_batch_start", cut)
        with pytest.raises(KeyboardInterrupt):
            fit(cfg)


@pytest.mark.parametrize(
    ("step", "extra"),
    [
        pytest.param(6, (), id="in fusion"),
        pytest.param(4, (), id="between epochs", marks=pytest.mark.slow),
        pytest.param(2, ("trainer.validate_every=2",), id="in the camera's stage", marks=pytest.mark.slow),
        pytest.param(7, (), id="before the last batch of an epoch", marks=pytest.mark.slow),
        pytest.param(7, ("trainer.workers=1",), id="with a loader process", marks=pytest.mark.slow),
    ],
)
def test_an_interrupted_run_ends_with_the_same_weights(data, tmp_path, monkeypatch, step, extra):
    monkeypatch.chdir(tmp_path)
    whole = checkpoint(fit(settings(data, "name=whole", *STEPS, *extra)))
    fit_until(step, settings(data, "name=cut", *STEPS, *extra))
    assert checkpoint(tmp_path / "runs" / "cut")["global_step"] == step
    resumed = checkpoint(fit(settings(data, "name=cut", "resume=true", *STEPS, *extra)))
    assert resumed["global_step"] == whole["global_step"] == 12
    for weights in ("state_dict", "current_model_state"):  # averaged and plain
        assert whole[weights].keys() == resumed[weights].keys()
        for name, value in whole[weights].items():
            assert torch.equal(value, resumed[weights][name]), name


def test_metrics_go_on_in_the_same_file(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fit_until(8, settings(data, "name=cut", *STEPS, "trainer.validate_every=4"))
    path = tmp_path / "runs" / "cut" / "metrics.csv"
    before = path.read_text()
    fit(settings(data, "name=cut", "resume=true", *STEPS, "trainer.validate_every=4"))
    assert path.read_text().startswith(before)
    rows = list(csv.DictReader(path.open()))
    assert [int(row["step"]) for row in rows if row["name"] == "val/mAP"] == [4, 8, 12]
