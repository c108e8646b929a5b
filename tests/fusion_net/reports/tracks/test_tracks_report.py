"""The command on a small run: what it writes, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir

from fusion_net.common.boxes import Boxes
from fusion_net.common.cli.command import CONFIGS, build
from fusion_net.metrics.sample_boxes import SampleBoxes
from fusion_net.metrics.track_boxes import TrackBoxes
from fusion_net.metrics.track_paths import Frames
from fusion_net.reports.tracks.picture import busiest_scene
from fusion_net.reports.tracks.write import report
from fusion_net.runs.run_dir import open_run
from tests.fixtures.training_setup import settings, write_data


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Four scenes of three keyframes, the last for validation."""
    return write_data(tmp_path_factory.mktemp("data") / "tree")


def make_run(data, *overrides):
    """runs/mini of an untrained network."""
    cfg = settings(data, "dataset.val.split=val", *overrides)
    folder = open_run(Path("runs/mini"), cfg, resume=False, overwrite=False)
    weights = {f"model.{name}": value for name, value in build(cfg.model, "model").state_dict().items()}
    torch.save({"state_dict": weights}, folder / "checkpoints" / "best.ckpt")
    return folder


def track(*overrides):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        return report(
            compose(
                "tracks", overrides=["run=runs/mini", "data.root=null", "min_keyframes=3", "bootstrap=4", *overrides]
            )
        )


def test_it_writes_tables_a_picture_and_a_result_file_for_each_row(data, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    make_run(data, "encoders=[lidar,radar]")
    folder = track("measurements.min_score=0.0", "tracker.birth_score=0.0")
    assert str(folder) == "runs/mini/eval/tracks"
    doc = json.loads((folder / "tracks.json").read_text())
    assert [row["tracks"] for row in doc["rows"]] == ["L+R", "L", "R", "fused tracks"]
    assert doc["num_samples"] == 3
    files = sorted(path.name for path in folder.iterdir())
    assert files == [
        "tracks.json", "tracks.md", "tracks.png", "tracks_nusc_L+R.json", "tracks_nusc_L.json", "tracks_nusc_R.json",
        "tracks_nusc_fused_tracks.json",
    ]  # fmt: skip
    results = json.loads((folder / "tracks_nusc_L.json").read_text())
    assert results["meta"]["use_lidar"]
    assert not results["meta"]["use_radar"]
    assert list(results["results"]) == [f"scene-0003-{k}" for k in range(3)]
    assert "AMOTA" in capsys.readouterr().out


def test_of_a_run_with_one_sensor_there_is_nothing_to_fuse(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make_run(data, "encoders=[lidar]")
    doc = json.loads((track() / "tracks.json").read_text())
    assert [row["tracks"] for row in doc["rows"]] == ["L"]


def test_short_scenes_unknown_scenes_and_missing_runs_are_refused(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileNotFoundError, match="no run at runs/mini"):
        track()
    make_run(data, "encoders=[lidar]")
    said = r"the longest scene has 3 keyframes, too few to track \(min_keyframes=10\).*python -m data_gen data=sequence"
    with pytest.raises(ValueError, match=said):
        track("min_keyframes=10")
    with pytest.raises(ValueError, match="there is no scene=scene-0009 in the split"):
        track("scene=scene-0009")
    with pytest.raises(ValueError, match=r"gate=1\.5 is a probability"):
        track("tracker.gate=1.5")


def test_without_labels_there_are_result_files_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    root = write_data(tmp_path / "unlabelled")
    (root / "v1.0-tiny/sample_annotation.json").write_text("[]")
    make_run(root, "encoders=[lidar]")
    folder = track()
    assert [path.name for path in folder.iterdir()] == ["tracks_nusc_L.json"]
    assert "no labelled track on the grid to score against" in capsys.readouterr().out


def test_the_scene_that_is_drawn_is_the_one_in_which_most_moves():
    """Five cars stand in the first scene, one drives in the second."""
    center = np.array([[10.0 * k, 0.0, 1.0] for k in range(5)] * 2 + [[0.0, 0.0, 1.0], [9.0, 0.0, 1.0]])
    n = len(center)
    boxes = Boxes.labels(center, np.ones((n, 3)), np.zeros(n), np.zeros((n, 2)), np.zeros(n, np.int64))
    sample = np.array([0] * 5 + [1] * 5 + [2, 3])
    table = SampleBoxes(boxes, sample, np.full(n, ""), np.full(n, 5))
    labels = TrackBoxes(table, np.array([*"abcdeabcdeaa"]))
    assert busiest_scene(labels, Frames(np.array([0, 0, 1, 1]), np.array([0, 500_000] * 2))) == 1
