"""A run of early fusion from its first step to its shipped weights: the same commands as for any other model."""

import json
import os
import signal
from pathlib import Path

import pytest
import torch
from hydra import compose, initialize_config_dir

from fusion_net.common.cli.command import CONFIGS
from fusion_net.evaluate import evaluate_run
from fusion_net.fit import fit
from fusion_net.runs.trained import shipped
from fusion_net.training.callbacks import MetricsCSV
from fusion_net.training.module import DetectorModule
from tests.fixtures.training_setup import settings, write_data

EARLY = (
    "model=early", "trainer.camera_steps=3", "trainer.camera_only_steps=5", "trainer.fusion_steps=5",
    "modality_dropout=0.5", "trainer.save_every=2",
)  # fmt: skip


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_data(tmp_path_factory.mktemp("data") / "tree")


@pytest.fixture(scope="module")
def place(data, tmp_path_factory):
    """A folder with runs/whole, and the stages of its steps."""
    folder, stages = tmp_path_factory.mktemp("place"), []
    step = DetectorModule.training_step

    def spy(self, batch, batch_idx):
        stages.append(self.stage)
        return step(self, batch, batch_idx)

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(DetectorModule, "training_step", spy)
        patch.setattr("fusion_net.training.trainer.LOG_EVERY", 1)
        patch.setattr(MetricsCSV.__init__, "__kwdefaults__", {"every": 1})
        fit(settings(data, *EARLY, "name=whole"))
    return folder, stages


@pytest.fixture
def here(place, monkeypatch):
    monkeypatch.chdir(place[0])
    return place[0]


def evaluate(*overrides):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        evaluate_run(compose("eval", overrides=["bootstrap=5", *overrides]))


def state(run):
    return torch.load(f"runs/{run}/checkpoints/last.ckpt", weights_only=True)["state_dict"]


def test_the_painter_learns_first_then_everything_else(place, here):
    """The camera has no map of its own that a stage could be for."""
    assert place[1] == ["camera"] * 3 + ["fusion"] * 5
    rows = (here / "runs/whole/metrics.csv").read_text()
    for part in ("camera", "lidar", "radar", "rest"):
        assert f"train/gradient_norm_{part}" in rows
    assert "val/mAP" in rows


def test_an_interrupted_run_ends_with_the_same_bits(data, here, monkeypatch):
    step = DetectorModule.training_step

    def interrupted(self, batch, batch_idx):
        if self.global_step == 5 and not Path("interrupted").exists():
            Path("interrupted").touch()
            os.kill(os.getpid(), signal.SIGINT)
        return step(self, batch, batch_idx)

    monkeypatch.setattr(DetectorModule, "training_step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fit(settings(data, *EARLY, "name=cut"))
    fit(settings(data, *EARLY, "name=cut", "resume=true"))
    whole = state("whole")
    assert all(torch.equal(value, whole[name]) for name, value in state("cut").items())


def test_it_is_scored_shipped_and_trained_further(data, here):
    evaluate("run=runs/whole", "ship=early.pt")
    rows = json.loads((here / "runs/whole/eval/drop_table.json").read_text())["rows"]
    scores = {tuple(row["sensors"]): [row[name] for name in ("mAP", "NDS", "mATE")] for row in rows}
    assert len(scores) == 7
    assert scores["camera", "radar"] == scores["radar",]  # no LiDAR, nothing to paint
    assert shipped("./early.pt").model().image_network is not None
    fit(settings(data, *EARLY, "name=tuned", "init=./early.pt", "trainer.max_lr=1e-9"))
    with pytest.raises(ValueError, match=r"init=\./early\.pt: early\.pt is of another model"):
        fit(settings(data, "name=mid", "init=./early.pt"))


def test_the_oracle_needs_no_painter_and_class_images(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    root = write_data(tmp_path / "tree")
    oracle = [*EARLY, "painting=oracle", "depth_supervision=none"]
    folder = fit(settings(root, *oracle))
    assert not any("image_network" in name for name in state("nano"))
    assert json.loads((folder / "env.json").read_text())["planned_steps"] == 5
    for path in root.glob("samples/*/*.png"):
        path.unlink()
    with pytest.raises(ValueError, match="painting=oracle needs the class images of generated data"):
        fit(settings(root, *oracle, "name=real", "dataset.cache=none"))
    assert not Path("runs/real").exists()
