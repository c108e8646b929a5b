"""What a run leaves behind for those who watch it: rows, curves and pictures; and the batch that ended it."""

import csv

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from fusion_net.evaluation.drop_table import SUBSETS
from fusion_net.fit import fit
from fusion_net.models.fusion_net import FusionNet
from fusion_net.training.callbacks import MetricsCSV
from tests.fixtures.training_setup import settings, write_data

STEPS = ("trainer.camera_steps=2", "trainer.camera_only_steps=0", "trainer.fusion_steps=4", "modality_dropout=0.0")
NORMS = {f"train/gradient_norm_{part}" for part in ("camera", "lidar", "radar", "rest", "all")}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_data(tmp_path_factory.mktemp("data") / "tree")


@pytest.fixture(scope="module")
def run(data, tmp_path_factory):
    """The folder of a run that logs every second of six steps and validates after the last."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("runs")
        patch.chdir(folder)
        patch.setattr("fusion_net.training.trainer.LOG_EVERY", 2)
        patch.setattr(MetricsCSV.__init__, "__kwdefaults__", {"every": 2})
        return folder / fit(settings(data, "trainer.drop_table_at_validation=true", *STEPS))


@pytest.fixture(scope="module")
def rows(run):
    """{step: {name: value}} of metrics.csv."""
    found: dict[int, dict[str, float]] = {}
    with (run / "metrics.csv").open() as file:
        for row in csv.DictReader(file):
            found.setdefault(int(row["step"]), {})[row["name"]] = float(row["value"])
    return found


@pytest.fixture(scope="module")
def board(run):
    accumulator = EventAccumulator(str(run / "tb"), size_guidance={"images": 0})
    accumulator.Reload()
    return accumulator


def test_rate_and_gradient_norms_stand_beside_the_losses(rows):
    assert NORMS & rows[2].keys() == {"train/gradient_norm_camera", "train/gradient_norm_all"}  # the camera's stage
    assert rows[4].keys() >= NORMS
    assert rows[6].keys() >= NORMS
    for step in (2, 4, 6):
        assert rows[step]["train/learning_rate"] > 0
        assert rows[step]["train/gradient_norm_all"] >= rows[step]["train/gradient_norm_camera"] > 0


def test_tensorboard_has_the_same_curves(board, rows):
    scalars = {name: board.Scalars(name) for name in board.Tags()["scalars"] if name in {*NORMS, "train/learning_rate"}}
    assert scalars.keys() == {*NORMS, "train/learning_rate"}
    for name, events in scalars.items():
        assert [event.value for event in events] == pytest.approx([r[name] for r in rows.values() if name in r], 1e-4)


def test_a_validation_scores_every_subset_if_asked(rows):
    names = {"val/mAP_" + "_".join(subset) for subset in SUBSETS[1:]}
    assert names | {"val/mAP", "val/NDS", "val/AP_car"} <= rows[6].keys()


def test_a_validation_leaves_pictures_of_fixed_samples(board):
    """The split has three."""
    assert sorted(board.Tags()["images"]) == ["val/sample_1", "val/sample_2", "val/sample_3"]
    assert all(event.step == 6 for tag in board.Tags()["images"] for event in board.Images(tag))


def test_a_loss_that_is_not_finite_ends_the_run_with_its_batch_saved(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    loss, calls = FusionNet.loss, []

    def broken(self, outputs, batch):
        losses = loss(self, outputs, batch)
        calls.append(batch.tokens)
        return losses | {"loss": losses["loss"] * torch.nan} if len(calls) == 3 else losses  # the first only tries

    monkeypatch.setattr(FusionNet, "loss", broken)
    with pytest.raises(ValueError, match=r"^the loss is not finite at step 3: .*; lower trainer.max_lr") as raised:
        fit(settings(data, "name=bad", *STEPS))
    saved = torch.load(tmp_path / "runs/bad/nonfinite_batch.pt", weights_only=True)
    assert (saved["step"], saved["stage"], saved["tokens"]) == (3, "fusion", calls[2])
    assert torch.isnan(saved["losses"]["loss"])
    for said in ("runs/bad/nonfinite_batch.pt", *saved["tokens"]):
        assert said in str(raised.value)
    assert "\n" not in str(raised.value)
