"""From data to scores: what is there is kept and what is left is done."""

import json

import pytest

from fusion_net.common.cli.command_line import as_override
from tests.fixtures.typed_commands import DATA_GEN, EVAL, TRAIN, advised, run


@pytest.mark.slow
def test_a_run_is_scored_with_every_subset_and_against_its_decoys(trained):
    code, out, error = run([*EVAL, "run=runs/base", "bootstrap=5", "split=all"], trained)
    assert code == 0, error
    doc = json.loads((trained / "runs/base/eval/all/drop_table.json").read_text())
    assert len(doc["rows"]) == 7
    assert all(len(kind["rows"]) == 7 for kind in doc["decoys"])
    assert "AUC" in out


@pytest.mark.slow
def test_a_run_is_scored_under_a_fault_beside_its_clean_table(trained):
    code, _, error = run(
        [*EVAL, "run=runs/base", "bootstrap=5", "split=all", "fault=lidar_beams", "fault.severity=3"], trained
    )
    assert code == 0, error
    doc = json.loads((trained / "runs/base/eval/all/lidar_beams_3/drop_table.json").read_text())
    assert doc["fault"] == {"name": "lidar_beams", "severity": 3}
    code, _, error = run([*EVAL, "run=runs/base", "fault=lidar_beams", "fault.severity=4"], trained)
    assert (code, error.count("\n")) == (1, 1)
    assert "fault.severity=4: 'lidar_beams' has severities 1 to 3" in error


@pytest.mark.slow
def test_a_run_that_exists_is_kept(trained, data):
    code, _, error = run([*TRAIN, f"data.root={data}", "name=base"], trained)
    assert code == 1
    assert "runs/base exists; pass name=ANOTHER, resume=true to go on, or overwrite=true" in error
    assert (trained / "runs/base/checkpoints/last.ckpt").exists()


@pytest.mark.slow
def test_data_made_anew_with_other_settings_is_not_mistaken_for_the_old(trained, data):
    manifest = data / "manifest.json"
    was = manifest.read_text()
    try:
        manifest.write_text(json.dumps(json.loads(was) | {"hash": "f" * 64}))
        for command in ([*EVAL, "run=runs/base"], [*TRAIN, f"data.root={data}", "name=base", "resume=true"]):
            code, _, error = run(command, trained)
            assert code == 1
            assert error.startswith("error: the data is no longer that which runs/base was trained on")
            assert error.count("\n") == 1
    finally:
        manifest.write_text(was)


@pytest.mark.slow
def test_shards_made_side_by_side_train_and_are_scored_as_one_data_set(data, trained, tmp_path):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    command = [*DATA_GEN, "-m", "shard=1/3,2/3,3/3", "hydra/launcher=joblib", "data.num_scenes=12", "data.root=shards"]
    assert run(command, tmp_path)[0] == 0
    assert sorted(path.name for path in (tmp_path / "shards").iterdir()) == [f"shard-{n}-of-3" for n in (1, 2, 3)]
    assert [path.name for path in (tmp_path / "data").iterdir()] == [".multirun"]
    assert run([*TRAIN, "data.root=shards", "name=base"], tmp_path)[0] == 0
    assert (tmp_path / "runs/base/metrics.csv").read_text() == (trained / "runs/base/metrics.csv").read_text()
    code, _, error = run([*EVAL, "run=runs/base", "bootstrap=5", f"data.root=[{data}]"], tmp_path)
    assert (code, error.count("warning")) == (0, 0)
    code, _, error = run([*EVAL, "run=runs/base", f"data.root=[shards,{data}]"], tmp_path)
    assert code == 1
    assert "hold the same samples" in error


@pytest.mark.slow
def test_a_sweep_does_what_is_left_and_a_job_that_fails_stops_no_other(data, tmp_path):
    steps = ("trainer.camera_steps=2", "trainer.camera_only_steps=2", "trainer.fusion_steps=4")
    command = [*TRAIN, "-m", "+sweep=seeds", "seed=1,2", *steps, f"data.root={data}"]
    code, _, error = run(command, tmp_path)
    assert code == 0, error
    sweep = tmp_path / "runs/sweeps/seeds"
    one, two = sorted(path for path in sweep.iterdir() if path.is_dir())
    assert [one.name[:6], two.name[:6]] == ["seed-1", "seed-2"]
    assert sorted(path.name for path in sweep.iterdir() if path.is_file()) == ["multirun.yaml"]
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
    was = {path: path.stat().st_mtime_ns for path in sweep.rglob("*") if path.is_file() and path.parent != sweep}
    code, out, _ = run(command, tmp_path)
    assert (code, out.count("is finished")) == (0, 2)
    assert {path: path.stat().st_mtime_ns for path in was} == was
    config = one / "config.yaml"
    config.write_text(config.read_text().replace("modality_dropout: 0.3", "modality_dropout: 0.4"))
    (two / "env.json").write_text("{}")  # interrupted after its last checkpoint
    code, out, error = run(command, tmp_path)
    assert code == 1
    assert f"{one.name} is a run with other settings (modality_dropout: 0.4 there, 0.3 asked for)" in error
    assert "Traceback" not in error
    assert json.loads((two / "env.json").read_text())["finished"]
    (two / "eval/result.json").unlink()  # not scored: the same command does that
    assert run(command, tmp_path)[0] == 1
    assert (two / "eval/result.json").exists()
    code, out, error = run(["-m", "fusion_net.reports.ablation", "runs/sweeps/seeds", "collect=true"], tmp_path)
    assert code == 0, error
    assert "Missing" not in out
    assert len(list((tmp_path / "docs/results/runs/seeds").glob("seed-*.json"))) == 2
    assert (tmp_path / "docs/results/seeds/ablation.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["it's a, [run]", "seed=1,lr=${x}", "2026_01"])
def test_the_command_that_is_printed_scores_a_run_of_any_name(data, tmp_path, name):
    steps = ("trainer.camera_steps=2", "trainer.camera_only_steps=2", "trainer.fusion_steps=4")
    code, printed, error = run([*TRAIN, f"data.root={data}", f"name={as_override(name)}", *steps], tmp_path)
    assert code == 0, error
    (advice,) = advised(printed)
    code, _, error = run([*advice, "bootstrap=2"], tmp_path)
    assert code == 0, error
    assert (tmp_path / "runs" / name / "eval" / "drop_table.json").exists()
