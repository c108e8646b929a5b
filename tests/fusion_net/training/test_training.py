"""Training in small: the loss falls, the switches act, limits end it, mistakes are refused before anything is written."""

import json
import multiprocessing
import os
import shutil
import signal
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from fusion_net.common.atomic import LOCK
from fusion_net.fit import fit
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.runs.checks import only_training
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import trained_run
from fusion_net.training.module import DetectorModule
from tests.fixtures.training_setup import settings, write_data


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_data(tmp_path_factory.mktemp("data") / "tree")


@pytest.fixture
def steps(monkeypatch, tmp_path):
    """(stage, loss, {name: fraction of samples that kept it}) of every training step; runs go to a folder of their own."""
    monkeypatch.chdir(tmp_path)
    seen = []
    step, log = DetectorModule.training_step, DetectorModule.log

    def spy(self, batch, batch_idx):
        seen.append([self.stage, None, {}])
        loss = step(self, batch, batch_idx)
        seen[-1][1] = float(loss)
        return loss

    def spy_log(self, name, value, **rest):
        if name.startswith("train/kept_"):
            seen[-1][2][name.removeprefix("train/kept_")] = float(value)
        return log(self, name, value, **rest)

    monkeypatch.setattr(DetectorModule, "training_step", spy)
    monkeypatch.setattr(DetectorModule, "log", spy_log)
    return seen


def mean(values):
    return sum(values) / len(values)


def test_the_loss_falls_in_both_stages(data, steps):
    fit(
        settings(
            data,
            "trainer.camera_steps=12",
            "trainer.camera_only_steps=0",
            "trainer.fusion_steps=20",
            "modality_dropout=0.0",
        )
    )
    for stage, count in (("camera", 12), ("fusion", 20)):
        losses = [loss for name, loss, _ in steps if name == stage]
        assert len(losses) == count
        assert mean(losses[-4:]) < 0.85 * mean(losses[:4])


def test_modality_dropout_acts_from_its_share_on_and_is_logged(data, steps):
    fit(
        settings(
            data,
            "trainer.camera_steps=0",
            "trainer.camera_only_steps=0",
            "trainer.fusion_steps=20",
            "modality_dropout=1.0",
            "trainer.batch_size=4",
        )
    )
    assert {stage for stage, _, _ in steps} == {"fusion"}
    assert all(kept == {"camera": 1.0, "lidar": 1.0, "radar": 1.0} for _, _, kept in steps[:10])
    for name in ("camera", "lidar", "radar"):  # three of the six proper subsets have it
        assert 0.3 < mean([kept[name] for _, _, kept in steps[10:]]) < 0.7


def test_lidar_alone_trains_and_is_scored(data, steps, tmp_path):
    folder = fit(settings(data, "encoders=[lidar]", "trainer.fusion_steps=6", "name=lidar"))
    assert len(steps) == 6  # no camera, no stage of its own
    trained = trained_run(folder, "last")
    model, dataset = trained.model(), open_samples(trained)
    batch = dataset.collate([dataset[0]])
    with torch.no_grad():
        boxes = model.decode(model(batch, torch.tensor([[True, False, True]])))  # no LiDAR: nothing to see, no failure
    assert len(boxes) == 1


def test_minutes_end_a_run_with_every_stage_and_a_score(data, steps, tmp_path, capsys):
    folder = fit(
        settings(
            data,
            "trainer.camera_steps=100000",
            "trainer.camera_only_steps=100000",
            "trainer.fusion_steps=100000",
            "trainer.max_minutes=0.03",
        )
    )
    assert {stage for stage, _, _ in steps} == {"camera", "camera_only", "fusion"}
    assert (folder / "checkpoints" / "best.ckpt").exists()
    assert "val/mAP" in (folder / "metrics.csv").read_text()
    taken = json.loads((folder / "env.json").read_text())["steps"]
    assert f"stopped by trainer.max_minutes=0.03 after {taken} of 300000 steps" in capsys.readouterr().out
    assert taken == len(steps)


def test_a_fixed_number_of_threads_is_not_watched(data, steps, monkeypatch):
    """Whatever else the machine does: that is what repeats a run to the bit."""
    monkeypatch.setattr("fusion_net.training.trainer.ThreadWatch", None)
    short = ["trainer.camera_steps=0", "trainer.camera_only_steps=0", "trainer.fusion_steps=1"]
    fit(settings(data, "trainer.threads=1", *short))
    assert len(steps) == 1
    with pytest.raises(TypeError):
        fit(settings(data, "trainer.threads=auto", "name=watched", *short))


@pytest.mark.parametrize(
    ("override", "answer"),
    [
        ("trainer.threads=0", "trainer.threads=0 is not auto or a number of threads"),
        ("trainer.batch_size=0", "trainer.batch_size=0 must be at least 1"),
        ("trainer.batch_size=64", "9 training samples, fewer than trainer.batch_size=64"),
        ("modality_dropout=2", "is a probability"),
        ("depth_supervision=lidr", "did you mean lidar"),
        ("fuser=conct", "did you mean 'concat'"),
        ("painting=oracle", "this model paints no points; add model=early"),
        ("encoders=[camra]", "'camra' is no sensor; choose from camera, lidar, radar"),
        ("encoders=[]", "no sensor is named"),
        ("grid.y_max=-112.0", "grid: y from"),
        ("trainer.precision=fp8", "there are auto, bf16, float32"),
        ("trainer.fusion_steps=0", "trainer.fusion_steps=0 must be at least 1"),
    ],
)
def test_a_mistake_is_refused_before_anything_is_written(data, tmp_path, monkeypatch, override, answer):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=answer):
        fit(settings(data, override))
    assert not (tmp_path / "runs").exists()


def test_of_two_trainings_that_begin_together_one_is_refused(data, tmp_path, monkeypatch):
    """The other one takes the folder after this one has looked at it."""
    monkeypatch.chdir(tmp_path)
    with ExitStack() as other:
        monkeypatch.setattr("fusion_net.fit._try", lambda *_: other.enter_context(only_training(Path("runs/a"))))
        with pytest.raises(ValueError, match="another training is writing to runs/a"):
            fit(settings(data, "name=a"))
        assert [path.name for path in (tmp_path / "runs/a").iterdir()] == [LOCK]


def test_a_grid_without_any_label_is_refused(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"no label with a LiDAR or radar point lies on the grid \(x -60.0 to -40.0 m"):
        fit(settings(data, "grid=nano", "grid.x_min=-60.0", "grid.x_max=-40.0"))
    assert not (tmp_path / "runs").exists()


def cut_lidar(root):
    for path in root.glob("samples/LIDAR_TOP/*.bin"):
        path.write_bytes(path.read_bytes()[:-3])


def cut_a_validation_image(root):
    path = sorted(root.glob("samples/CAM_FRONT/scene-0003*.jpg"))[0]
    path.write_bytes(path.read_bytes()[:100])


def images_of_another_size(root):
    for path in root.glob("samples/CAM_BACK/*.jpg"):
        cv2.imwrite(str(path), np.zeros((40, 64, 3), np.uint8))


def no_depth(root):
    for path in root.glob("samples/*/*.depth.png"):
        path.unlink()


@pytest.mark.parametrize("damage", [cut_lidar, cut_a_validation_image, images_of_another_size, no_depth])
def test_data_that_cannot_be_used_leaves_no_run_behind(tmp_path, monkeypatch, damage):
    """After the mend the same command works."""
    monkeypatch.chdir(tmp_path)
    root = write_data(tmp_path / "tree")
    shutil.copytree(root, tmp_path / "whole")
    damage(root)
    short = ("trainer.camera_steps=1", "trainer.camera_only_steps=1", "trainer.fusion_steps=1")
    with pytest.raises((ValueError, OSError)):
        fit(settings(root, *short))
    assert not (tmp_path / "runs").exists()
    shutil.copytree(tmp_path / "whole", root, dirs_exist_ok=True)
    assert (fit(settings(root, *short)) / "checkpoints/last.ckpt").exists()


def test_both_splits_are_read_from_tables_that_are_opened_once(data, tmp_path, monkeypatch):
    opened = []
    start = NuScenes.__init__

    def spy(self, root, *rest, **options):
        opened.append(str(root))
        start(self, root, *rest, **options)

    monkeypatch.setattr(NuScenes, "__init__", spy)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="lies on the grid"):  # what comes after both are there
        fit(settings(data, "grid=nano", "grid.x_min=-60.0", "grid.x_max=-40.0"))
    assert opened == [str(data)]


def test_a_loader_process_that_dies_ends_the_run_in_one_line(data, steps, monkeypatch):
    """As the system's answer to memory that ran out."""
    step = DetectorModule.training_step

    def kill(self, batch, batch_idx):
        if batch_idx == 2:
            (child,) = multiprocessing.active_children()
            os.kill(child.pid, signal.SIGKILL)
        return step(self, batch, batch_idx)

    monkeypatch.setattr(DetectorModule, "training_step", kill)
    with pytest.raises(ChildProcessError, match=r"loader process died .*; add resume=true.* fewer dataset.workers"):
        fit(settings(data, "dataset.workers=1", "trainer.fusion_steps=20"))
    assert len(steps) < 12


@pytest.mark.parametrize(
    ("override", "advice"),
    [
        ("skip_finished=false", "add resume=true to the same command"),
        ("skip_finished=true", "^the same command goes on$"),
    ],
)
def test_an_interrupted_job_of_a_sweep_needs_no_other_command_to_go_on(data, steps, monkeypatch, override, advice):
    def interrupt(self, batch, batch_idx):
        raise KeyboardInterrupt

    monkeypatch.setattr(DetectorModule, "training_step", interrupt)
    with pytest.raises(KeyboardInterrupt, match=advice):
        fit(settings(data, override))
