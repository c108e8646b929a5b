"""A late run from training to shipped weights, and detectors that come from other runs."""

import json
import shutil
from pathlib import Path

import pytest
import torch
from hydra import compose, initialize_config_dir

from fusion_net.common.cli.command import CONFIGS, build
from fusion_net.evaluate import evaluate_run
from fusion_net.fit import fit
from fusion_net.runs import sources
from fusion_net.runs.late import held_out, with_detectors
from fusion_net.runs.run_dir import is_finished
from fusion_net.runs.trained import shipped, trained_run
from tests.fixtures.training_setup import settings, write_data

FEW = ("trainer.camera_steps=2", "trainer.camera_only_steps=1", "trainer.fusion_steps=3")
LATE = ("model=late", "modality_dropout=0.0", "late.calibration_scenes=1", "late.min_probability=0.0", *FEW)


def late(*overrides):
    return settings(Path("data/nano"), *LATE, *overrides)


def evaluate(*overrides):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        evaluate_run(compose("eval", overrides=["bootstrap=10", *overrides]))


def weights(run, name="best"):
    return trained_run(Path(run), name).weights


def rows(folder):
    table = json.loads((Path(folder) / "drop_table.json").read_text())
    return [{key: value for key, value in row.items() if key != "ms_per_sample"} for row in table["rows"]]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with data/nano, runs/base of late fusion, runs/camera of another camera's detector, runs/mid."""
    folder = tmp_path_factory.mktemp("late")
    write_data(folder / "data/nano")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        fit(late("name=base"))
        fit(settings(Path("data/nano"), *FEW, "name=camera", "encoders=[camera]", "seed=2", "model.decoder.half=24"))
        evaluate("run=runs/base", "ship=checkpoints/mini.pt")
    return folder


@pytest.fixture
def here(place, monkeypatch):
    monkeypatch.chdir(place)
    monkeypatch.setattr(sources, "SHIPPED", place / "checkpoints")
    return place


def test_a_run_ends_calibrated_in_both_checkpoints_on_a_scene_that_it_was_not_trained_on(here):
    for name in ("best", "last"):
        held = weights("runs/base", name)
        assert held["calibration.lidar.matches"].sum() > 0
        assert (held["calibration.lidar.factor"] != 1).all()
        assert (held["calibration.lidar.velocity_variance"] != 1).all()


def test_scenes_that_are_kept_are_whole_and_spread(here):
    dataset = build(late().dataset.train, "dataset")
    learn, kept = held_out(dataset, 1)
    assert sorted(learn + kept) == list(range(9))
    assert kept == [3, 4, 5]
    for wrong in (0, 3):
        with pytest.raises(ValueError, match=f"late.calibration_scenes={wrong}: of 3 training scenes between 1 and 2"):
            held_out(dataset, wrong)


def test_the_evaluation_says_how_honest_the_covariances_are(here):
    report = json.loads(Path("runs/base/eval/late_calibration.json").read_text())
    assert {row["of"] for row in report["rows"]} >= {"camera", "lidar", "radar", "information"}
    assert report["samples"] == 3
    assert set(report["calibration"]["radar"]["classes"]) >= {"car", "pedestrian"}
    assert "| NIS |" in Path("runs/base/eval/late_calibration.md").read_text()


def test_shipped_weights_hold_the_calibration(here):
    held = shipped("mini").weights
    torch.testing.assert_close(held["calibration.radar.factor"], weights("runs/base")["calibration.radar.factor"])
    evaluate("checkpoint=mini")
    assert rows("runs/checkpoints/mini/eval") == rows("runs/base/eval")


def test_other_rules_are_an_override_of_the_evaluation_with_a_folder_of_its_own(here):
    evaluate("run=runs/base", "late.merge=best", "late.score=max", "late.association=oracle")
    table = json.loads(Path("runs/base/eval/association-oracle_merge-best_score-max/drop_table.json").read_text())
    assert table["late"] == {"association": "oracle", "merge": "best", "score": "max"}


def test_a_detector_is_swapped_when_it_is_scored(here):
    """The LiDAR and the radar stay as they are; the camera's row is the other run's."""
    evaluate("run=runs/base", "late.detectors.camera=runs/camera", "ship=checkpoints/swapped.pt")
    held, other = shipped("swapped").weights, weights("runs/camera")
    for key, value in other.items():
        assert torch.equal(held[f"detectors.camera.{key}"], value)
    for key, value in weights("runs/base").items():
        if key.startswith(("detectors.lidar", "detectors.radar")):
            assert torch.equal(held[key], value)
    found = [folder for folder in Path("runs/base/eval").iterdir() if folder.name.startswith("detectors.camera")]
    assert len(found) == 1
    assert (found[0] / "drop_table.json").exists()


@pytest.mark.slow
def test_a_detector_is_taken_in_training_and_learns_nothing(here):
    fit(late("name=taken", "late.detectors.camera=runs/camera", "late.detectors.radar=runs/base"))
    held, camera, base = weights("runs/taken"), weights("runs/camera"), weights("runs/base")
    assert all(torch.equal(held[f"detectors.camera.{key}"], value) for key, value in camera.items())
    radar = {key: value for key, value in base.items() if key.startswith("detectors.radar.")}
    assert all(torch.equal(held[key], value) for key, value in radar.items())
    assert not torch.equal(held["detectors.lidar.head.box.1.weight"], base["detectors.lidar.head.box.1.weight"])
    state = trained_run(Path("runs/taken"), "last")
    assert state.record["steps"] == 3  # the camera's own stages fall away
    evaluate("run=runs/taken")
    cfg = late("name=taken", "late.detectors.camera=runs/camera", "late.detectors.radar=runs/base")
    assert is_finished(Path("runs/taken"), with_detectors(cfg))


@pytest.mark.slow
def test_three_given_detectors_need_one_step_that_changes_nothing(here):
    given = [f"late.detectors.{name}=mini" for name in ("camera", "lidar", "radar")]
    fit(late("name=given", *given))
    held = weights("runs/given")
    assert trained_run(Path("runs/given"), "last").record["steps"] == 1
    for key, value in shipped("mini").weights.items():
        if key.startswith("detectors."):
            torch.testing.assert_close(held[key], value)
    evaluate("run=runs/given")


@pytest.mark.slow
def test_a_run_that_is_over_is_resumed_to_the_same_calibration_and_trained_further(here):
    shutil.copytree("runs/base", "runs/again")
    fit(late("name=again", "resume=true"))
    first, again = (weights(run, "last") for run in ("runs/base", "runs/again"))
    for key, value in first.items():
        torch.testing.assert_close(again[key], value)
    fit(late("name=tuned", "init=mini"))


@pytest.mark.slow
def test_the_calibration_is_fitted_anew_on_demand(here):
    shutil.copytree("runs/base", "runs/redone", dirs_exist_ok=True)
    path = Path("runs/redone/checkpoints/best.ckpt")
    state = torch.load(path, weights_only=True)
    state["state_dict"]["model.calibration.lidar.factor"].fill_(7.0)
    torch.save(state, path)
    evaluate("run=runs/redone", "late.calibrate=true")
    fitted, first = (weights(run)["calibration.lidar.factor"] for run in ("runs/redone", "runs/base"))
    torch.testing.assert_close(fitted, first)


@pytest.mark.parametrize(
    ("overrides", "answer"),
    [
        (
            ["classes=[car,bus]"],
            r"late\.detectors\.camera=runs/camera: classes of that detector: \['car'",
        ),
        (
            ["grid.x_max=38.4"],
            r"camera: grid of that detector: \{'x_max': \S+\}, of this model: \{'x_max': 38\.4\}; train",
        ),
        (["encoders=[lidar,radar]"], r"this model has no camera; its sensors are lidar, radar"),
        (["dataset.train.image_size=[48,160]"], r"was trained with dataset\.train\.image_size=None, here it is \[48"),
        (["late.detectors.lidar=runs/camera"], r"lidar=runs/camera: it fuses camera in one network; a detector of the"),
        (["late.detectors.lidar=runs/nobody"], r"lidar=runs/nobody: no run at runs/nobody; there are .*base, camera"),
        (["late.detectors.lidar=nothing"], r"lidar=nothing: no shipped weights nothing; there are mini"),
        (["late.merge=sum"], r"unknown late\.merge 'sum'; did you mean 'best'\? There are covariance_intersection, "),
        (["late.gate=1.0"], r"late\.gate=1\.0 is a probability: give a number above 0 and below 1"),
        (["model=mid"], r"late\.detectors\.camera=runs/camera: this model is no late fusion and reads none of late"),
    ],
)
def test_a_detector_that_does_not_suit_is_one_line_and_writes_nothing(here, overrides, answer):
    with pytest.raises(ValueError, match=answer) as caught:
        fit(late("name=wrong", "late.detectors.camera=runs/camera", *overrides))
    assert "\n" not in str(caught.value)
    assert not Path("runs/wrong").exists()


def test_a_run_of_another_model_has_no_detectors_to_exchange(here):
    with pytest.raises(ValueError, match=r"late\.merge: runs/camera.*is no late fusion; train one: python train\.py"):
        evaluate("run=runs/camera", "late.merge=best")
