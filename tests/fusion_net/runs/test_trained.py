"""Shipped weights: written by an evaluation, scored without a run, trained further; and what a run's record says of it."""

import json
import shutil
from pathlib import Path

import pytest
import torch
from hydra import compose, initialize_config_dir

from fusion_net.common.cli.command import CONFIGS
from fusion_net.evaluate import evaluate_run
from fusion_net.fit import fit
from fusion_net.reports.run_result import read_result
from fusion_net.runs import sources
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import changed_settings, shipped, trained_run
from tests.fixtures.training_setup import settings, write_data

FEW = ("trainer.camera_steps=2", "trainer.camera_only_steps=2", "trainer.fusion_steps=4")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_data(tmp_path_factory.mktemp("data") / "tree")


@pytest.fixture(scope="module")
def place(data, tmp_path_factory):
    """A folder with data/nano, runs/base, which scored itself, and checkpoints/mini.pt."""
    folder = tmp_path_factory.mktemp("place")
    (folder / "data").mkdir()
    shutil.copytree(data, folder / "data/nano")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        fit(settings(Path("data/nano"), *FEW, "name=base", "evaluate=true", "modality_dropout=0.5"))
        evaluate("run=runs/base", "ship=checkpoints/mini.pt")
    return folder


@pytest.fixture
def here(place, monkeypatch):
    monkeypatch.chdir(place)
    monkeypatch.setattr(sources, "SHIPPED", place / "checkpoints")
    return place


def evaluate(*overrides):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        evaluate_run(compose("eval", overrides=["bootstrap=20", *overrides]))


def rows(path):
    """The rows of a drop table, without the time that they took."""
    return [
        {key: value for key, value in row.items() if key != "ms_per_sample"}
        for row in json.loads(Path(path).read_text())["rows"]
    ]


def test_a_run_that_is_told_to_scores_itself(here):
    result = read_result(here / "runs/base/eval/result.json")
    assert result["steps"] == 8
    assert result["minutes"] > 0
    assert result["seed"] == 1
    assert result["settings"]["modality_dropout"] == 0.5
    assert result["settings"]["trainer.fusion_steps"] == 4
    assert len(result["mAP_resampled"]) == len(result["rows"]) == 7


def test_shipped_weights_are_scored_without_a_run_as_the_run_was(here):
    evaluate("checkpoint=mini")
    assert rows("runs/checkpoints/mini/eval/drop_table.json") == rows("runs/base/eval/drop_table.json")
    assert shipped("mini").record["steps"] == 8
    evaluate("checkpoint=checkpoints/mini.pt", "split=train")
    assert (here / "runs/checkpoints/mini/eval/train/drop_table.json").exists()


def test_a_shipped_file_says_how_it_was_made_and_names_no_folder_of_the_machine(here):
    held = torch.load("checkpoints/mini.pt", weights_only=True)
    assert held["config"]["data"]["root"] == held["config"]["dataset"]["val"]["root"] == "data/nano"
    assert len(held["table"]["rows"]) == 7
    assert held["record"]["run"] == "runs/base"
    assert Path("checkpoints/mini.pt").stat().st_size < 10e6


def test_missing_data_is_one_line_with_the_command_that_makes_it(here, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"no data in data/nano; make some: python -m data_gen data=nano") as caught:
        evaluate("checkpoint=mini")
    assert "\n" not in str(caught.value)


def test_a_fault_of_a_sensor_that_the_detector_does_not_read_is_refused(here):
    trained = trained_run(Path("runs/base"), "best")
    trained.cfg.encoders = ["camera"]
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        fault = compose("eval", overrides=["fault=lidar_rotation"]).fault
    with pytest.raises(
        ValueError, match="fault: it hits lidar, and this detector reads camera alone; write fault=none"
    ):
        open_samples(trained, fault=fault)


def test_other_data_in_the_same_place_is_scored_with_a_warning(here, capsys):
    manifest = here / "data/nano/manifest.json"
    manifest.write_text(json.dumps({"hash": "e" * 64, "complete": True}))
    try:
        evaluate("checkpoint=mini")
    finally:
        manifest.unlink()
    assert "warning: mini.pt was trained on data of other settings" in capsys.readouterr().err


def test_training_begins_with_the_weights_it_is_given(here):
    slow = (*FEW, "trainer.max_lr=1e-9", "trainer.weight_decay=0.0")
    fit(settings(Path("data/nano"), *slow, "name=tuned", "init=mini"))
    fit(settings(Path("data/nano"), *slow, "name=again", "init=runs/base/checkpoints/best.ckpt"))
    first = shipped("mini").weights
    for name in ("tuned", "again"):
        state = torch.load(f"runs/{name}/checkpoints/last.ckpt", weights_only=True)["state_dict"]
        for key, value in first.items():
            if key.endswith("weight"):
                torch.testing.assert_close(state[f"model.{key}"], value, atol=1e-4, rtol=0)


@pytest.mark.parametrize(
    ("override", "answer"),
    [
        ("init=nowhere", "init=nowhere: no shipped weights nowhere; there are mini"),
        ("model.decoder.half=24", r"init=mini: .*mini\.pt is of another model: \d+ tensors differ, the first is"),
    ],
)
def test_weights_that_do_not_fit_are_one_line_and_write_nothing(here, override, answer):
    with pytest.raises(ValueError, match=answer) as caught:
        fit(settings(Path("data/nano"), *FEW, "name=wrong", "init=mini", override))
    assert "\n" not in str(caught.value)
    assert not (here / "runs/wrong").exists()


def test_a_checkpoint_of_a_run_needs_the_run(here):
    for name in ("best", "last"):
        evaluate("run=runs/base", f"checkpoint={name}")
    with pytest.raises(FileNotFoundError, match=r"no checkpoint .*mini\.ckpt; there are best\.ckpt, last\.ckpt"):
        evaluate("run=runs/base", "checkpoint=mini")
    with pytest.raises(ValueError, match="ships a run; write run=runs/NAME"):
        evaluate("checkpoint=mini", "ship=checkpoints/b.pt")


def test_changed_settings_are_those_that_somebody_chose():
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        default = compose("train", overrides=["seed=7", "name=x"])
        other = compose("train", overrides=["fuser=average", "dataset.train.lidar_sweeps=2", "encoders=[camera,lidar]"])
    assert changed_settings(default) == {}
    assert changed_settings(other) == {
        "encoders": ["camera", "lidar"], "fuser": "average", "dataset.train.lidar_sweeps": 2
    }  # fmt: skip


def test_changed_settings_of_another_model_are_its_own():
    """Not that it lacks the settings of the default's view transform."""
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        changed = changed_settings(compose("train", overrides=["model=early", "painting=oracle"]))
    assert changed == {
        "model._target_": "fusion_net.models.early.early_fusion",
        "model.encoders.camera._target_": "fusion_net.models.encoders.painted_lidar.Painter",
        "model.encoders.camera.painting": "oracle",
        "painting": "oracle",
    }
