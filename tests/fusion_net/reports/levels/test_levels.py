"""``python -m fusion_net.reports.levels`` on three untrained networks: what it measures, keeps, shows and says is missing."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from fusion_net.common.cli.command import build
from fusion_net.evaluation.cells.plan import GROUPS
from fusion_net.reports.levels import measured
from fusion_net.reports.levels.measured import Asked
from fusion_net.reports.levels.runs import find_levels, gaps
from fusion_net.reports.levels.write import write_levels
from fusion_net.reports.run_result import write_result
from fusion_net.runs.run_dir import open_run
from tests.fixtures.run_results import make_result
from tests.fixtures.training_setup import settings, write_data

SWEEP = Path("runs/sweeps/levels")
SCORES = {"early": 0.62, "mid": 0.6, "late": 0.55}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    root = write_data(tmp_path_factory.mktemp("data") / "tree", scenes=3)
    splits = {"tiny_train": ["scene-0000"], "tiny_val": ["scene-0001", "scene-0002"]}
    (root / "v1.0-tiny/splits.json").write_text(json.dumps(splits))
    return root


@pytest.fixture(scope="module")
def made(data, tmp_path_factory):
    """A folder with a finished job a level, of the names that the sweep gives."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for place, level in enumerate(SCORES):
            write_job(data, level, 1, place)
    return folder


@pytest.fixture
def sweep(made, tmp_path, monkeypatch):
    """The same, to be changed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("fusion_net.runs.trained.run_record", lambda folder, cfg: {})  # takes a second
    monkeypatch.setattr("fusion_net.evaluation.cells.costs.REPEATS", 1)
    shutil.copytree(made / "runs", "runs")
    return SWEEP


def write_job(data, level, seed, place, *, name="", result=True):
    """The folder of a run: random weights, settings, and a result made up."""
    cfg = settings(data, f"seed={seed}", "dataset.cache=none", f"name=sweeps/levels/{level}")
    folder = open_run(SWEEP / (name or f"experiment-{level}_seed-{seed}"), cfg, resume=False, overwrite=False)
    torch.manual_seed(place)
    weights = {f"model.{key}": value for key, value in build(cfg.model, "model").state_dict().items()}
    torch.save({"state_dict": weights}, folder / "checkpoints/best.ckpt")
    if result:
        noise = np.random.default_rng(place).normal(0, 0.004, 200)
        made = make_result(SCORES[level], seed=seed, overrides=(f"experiment={level}",), job=place, noise=noise)
        write_result(folder / "eval/result.json", made)
    return folder


def report(groups=(), *, keep=False, resamples=5, **settings):
    asked = Asked(scenes=settings.pop("scenes", 1), resamples=resamples)
    folders = {"results": Path("docs/results/runs"), "pages": Path("docs/results")}
    return write_levels(SWEEP, **folders, groups=groups, asked=asked, quick=True, keep=keep, **settings)


def test_the_page_has_the_lessons_six_rows_and_its_verdicts(sweep, capsys):
    target = report(["deaths", "swap"])
    assert target == sweep
    page = (target / "levels.md").read_text()
    for row in ("Information retained", "Modularity / swap a sensor", "Graceful dropout", "Compute / bandwidth"):
        assert f"| {row} | *" in page
    assert "mAP 0.620 [" in page
    assert "retrain C " in page
    doc = json.loads((target / "levels.json").read_text())
    verdicts = {order["claim"].partition(":")[0]: order["verdict"] for order in doc["orders"]}
    assert verdicts["information"] == "holds"
    assert verdicts["misalignment"] == "not measured"
    assert set(doc["levels"]["mid"]["deaths"]) == {
        f"{s} {how}" for s in ("camera", "lidar", "radar") for how in ("absent", "blank", "stale")
    }
    assert cv2.imread(str(target / "levels.png")).std() > 5
    for block in page.split("\n\n"):
        if block.startswith("|"):
            assert len({line.count("|") for line in block.splitlines()}) == 1
    assert "Information retained" in capsys.readouterr().out


def test_seeds_that_no_run_has_are_refused_before_anything_is_measured_or_written(sweep):
    with pytest.raises(ValueError, match=r"seeds=\[1, 9\]: no run of .* has seed 9; write 'seeds=\[1\]', or less"):
        report(["swap"], seeds=[1, 9])
    assert not (sweep / "levels.md").exists()


@pytest.mark.slow
def test_what_is_measured_is_kept_and_only_the_rest_is_measured_again(sweep, monkeypatch):
    asked = []
    true_measure = measured.measure

    def interrupted(cell, detectors, samples, **options):
        if cell.group == "swap":
            raise KeyboardInterrupt
        return true_measure(cell, detectors, samples, **options)

    def noted(cell, detectors, samples, **options):
        asked.append((cell.group, sorted(detectors)))
        return true_measure(cell, detectors, samples, **options)

    monkeypatch.setattr(measured, "measure", interrupted)
    with pytest.raises(KeyboardInterrupt):
        report(["swap"])
    files = sorted(sweep.glob("*/cells/val-1/*.json"))
    assert [path.stem for path in files] == ["sound"] * 3
    (sweep / "experiment-mid_seed-1/cells/val-1/sound.json").unlink()
    monkeypatch.setattr(measured, "measure", noted)
    report(["swap"])
    everyone = sorted(f"experiment-{level}_seed-1" for level in SCORES)
    assert asked == [("sound", ["experiment-mid_seed-1"]), ("swap", everyone)]
    asked.clear()
    report(["swap"])
    assert not asked


@pytest.mark.slow
def test_committed_results_and_cells_make_the_same_page_without_any_run(sweep, capsys):
    target = report(["swap"], keep=True)
    assert target == Path("docs/results/levels")
    cells = target / "cells/experiment-late_seed-1/val-1"
    assert {path.stem for path in cells.iterdir()} == {"sound", "swap", "costs"}
    page = (target / "levels.md").read_text()
    for path in sweep.glob("*/checkpoints/best.ckpt"):
        path.unlink()
    report(["swap"], keep=True, only_read=True)
    assert (target / "levels.md").read_text() == page
    report(["swap"])
    assert (
        "no weights in runs/sweeps/levels/experiment-early_seed-1, its committed cells are shown"
        in capsys.readouterr().out
    )


def test_missing_and_half_seeds_are_named_and_in_no_figure(sweep, data):
    write_job(data, "early", 2, 3, name="early_s2", result=False)
    write_job(data, "late", 2, 4)
    (sweep / "experiment-mid_seed-1/eval/result.json").unlink()
    lines = gaps(find_levels(sweep, Path("none")))
    assert lines[0].startswith("early, seed 2: early_s2: failed")
    page = (report() / "levels.md").read_text()
    assert "* mid, seed 1: experiment-mid_seed-1: failed, or ended before its first checkpoint" in page
    doc = json.loads((sweep / "levels.json").read_text())
    assert doc["seeds"] == [1]
    assert doc["orders"][0]["verdict"] == "not measured"
    assert doc["orders"][0]["missing"] == ["mid"]


def test_a_run_that_tells_no_level_and_two_runs_of_one_seed_are_refused(sweep, data):
    write_job(data, "mid", 1, 3, name="mid_again")
    with pytest.raises(ValueError, match=r"experiment-mid_seed-1 and mid_again are both mid with seed 1"):
        find_levels(sweep, Path("none"))
    (sweep / "mid_again").rename(sweep / "midway")
    with pytest.raises(ValueError, match=r"midway: its name tells none of early, mid, late"):
        find_levels(sweep, Path("none"))


@pytest.mark.slow
def test_a_fault_of_a_sensor_that_the_rig_lacks_is_left_out_with_a_line(sweep, data, tmp_path):
    root = write_data(tmp_path / "other", scenes=3)
    tables = root / "v1.0-tiny"
    (tables / "splits.json").write_text((data / "v1.0-tiny/splits.json").read_text())
    for name, key in (
        ("sensor", "channel"),
        ("calibrated_sensor", "sensor_token"),
        ("sample_data", "calibrated_sensor_token"),
    ):
        rows = json.loads((tables / f"{name}.json").read_text())
        (tables / f"{name}.json").write_text(json.dumps([row for row in rows if "RADAR" not in row[key]]))
    for folder in sweep.iterdir():
        config = folder / "config.yaml"
        config.write_text(config.read_text().replace(str(data), str(root)))
    page = (report(["deaths"]) / "levels.md").read_text()
    assert "* deaths: radar blank is left out: the data has no radar" in page
    assert "| radar blank |" not in page


@pytest.mark.slow
def test_every_group_of_cells_is_measured_and_every_section_filled(sweep):
    page = (report(GROUPS, scenes=None) / "levels.md").read_text()
    assert "Not measured" not in page
    assert "not measured" not in page
    doc = json.loads((SWEEP / "levels.json").read_text())
    assert doc["samples"] == "val-all"
    assert {order["verdict"] for order in doc["orders"]} <= {"holds", "holds partly", "does not hold", "undecided"}
