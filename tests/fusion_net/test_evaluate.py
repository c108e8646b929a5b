"""``eval.py`` on a small run: which split it scores, where its results go, and what it does without labels."""

import json
from pathlib import Path

import pytest
import torch
from hydra import compose, initialize_config_dir

from fusion_net.common.cli.command import CONFIGS, build
from fusion_net.evaluate import evaluate_finished, evaluate_run
from fusion_net.reports.audits.run import AUDITS
from fusion_net.runs.run_dir import load_config, open_run
from tests.fixtures.training_setup import settings, write_data

SPLITS = {"train": ["scene-0000"], "mini_val": ["scene-0001"], "holdout": ["scene-0002"], "test": ["scene-0003"]}


def write_labelled_data(root):
    """Four scenes in the splits above; that of ``test`` has no labels."""
    tables = write_data(root) / "v1.0-tiny"
    (tables / "splits.json").write_text(json.dumps(SPLITS))
    annotations = json.loads((tables / "sample_annotation.json").read_text())
    kept = [row for row in annotations if not row["sample_token"].startswith("scene-0003")]
    (tables / "sample_annotation.json").write_text(json.dumps(kept))
    return root


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_labelled_data(tmp_path_factory.mktemp("data") / "tree")


@pytest.fixture
def run(data, tmp_path, monkeypatch):
    """runs/mini of an untrained network that validates on mini_val."""
    monkeypatch.chdir(tmp_path)
    cfg = settings(data, "dataset.val.split=mini_val", "encoders=[lidar]")
    folder = open_run(Path("runs/mini"), cfg, resume=False, overwrite=False)
    weights = {f"model.{name}": value for name, value in build(cfg.model, "model").state_dict().items()}
    for name in ("best", "last"):
        torch.save({"state_dict": weights}, folder / "checkpoints" / f"{name}.ckpt")
    return folder


def evaluate(*overrides):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        evaluate_run(compose("eval", overrides=["run=runs/mini", "bootstrap=2", *overrides]))


def tables(run):
    """Split and number of samples of every drop table under the run, by folder."""
    docs = {path.parent: json.loads(path.read_text()) for path in (run / "eval").rglob("drop_table.json")}
    return {str(path.relative_to(run)): (doc["split"], doc["num_samples"]) for path, doc in docs.items()}


def test_the_split_is_the_one_that_the_run_validated_on_unless_another_is_named(run, data):
    evaluate()
    assert tables(run) == {"eval": ("mini_val", 3)}
    evaluate("split=val", f"data.root={data}")  # the same split and data by other names
    assert tables(run) == {"eval": ("val", 3)}
    own = (run / "eval/drop_table.json").read_bytes()
    evaluate("split=holdout")
    evaluate("checkpoint=last", "fault=lidar_beams", "fault.severity=2")
    assert set(tables(run)) == {"eval", "eval/holdout", "eval/last/lidar_beams_2"}
    assert (run / "eval/drop_table.json").read_bytes() == own


def test_a_split_without_labels_gets_a_result_file_and_no_table(run, capsys):
    evaluate()
    own = {path: path.read_bytes() for path in (run / "eval").iterdir()}
    capsys.readouterr()
    evaluate("split=test")
    said = capsys.readouterr().out.splitlines()[-1]
    assert "split=test of" in said
    assert said.endswith("nothing to score against, it has no labels; wrote runs/mini/eval/test/results_nusc.json")
    assert [path.name for path in (run / "eval/test").iterdir()] == ["results_nusc.json"]
    results = json.loads((run / "eval/test/results_nusc.json").read_text())["results"]
    assert list(results) == [f"scene-0003-{k}" for k in range(3)]
    assert {path: path.read_bytes() for path in own} == own


def test_labels_that_nothing_saw_are_nothing_to_score_against(run, tmp_path, capsys):
    root = write_labelled_data(tmp_path / "unseen")
    path = root / "v1.0-tiny/sample_annotation.json"
    path.write_text(json.dumps([row | {"num_lidar_pts": 0} for row in json.loads(path.read_text())]))
    evaluate(f"data.root={root}")
    assert "none of its 9 labels is on the grid and in range and has a LiDAR or radar point" in capsys.readouterr().out
    assert tables(run) == {}


def test_data_of_the_same_name_elsewhere_has_a_folder_of_its_own(run, tmp_path):
    for place in ("a", "b"):
        write_labelled_data(tmp_path / place / "tree")
        evaluate(f"data.root={place}/tree")
    evaluate("data.root=[a/tree]", "split=holdout")
    assert set(tables(run)) == {"eval/mini_val@a-tree", "eval/mini_val@b-tree", "eval/holdout@a-tree"}


def test_a_network_of_one_sensor_says_which_rows_are_the_same(run):
    evaluate()
    doc = json.loads((run / "eval/drop_table.json").read_text())
    assert "the network is built without camera and radar: rows with and without them are the same" in doc["notes"]
    assert [doc["rows"][k]["mAP"] for k in (1, 3)] == [doc["rows"][0]["mAP"]] * 2


def test_the_runs_own_data_by_name_is_refused_when_it_was_made_anew(run, data):
    env = run / "env.json"
    env.write_text(json.dumps(json.loads(env.read_text()) | {"data": ["f" * 64]}))
    with pytest.raises(ValueError, match="the data is no longer that which runs/mini was trained on"):
        evaluate(f"data.root={data}")
    assert not (run / "eval").exists()


def test_the_audits_are_written_and_a_detector_of_one_sensor_is_not_judged(run, capsys):
    evaluate("audits=all")
    folder = run / "eval/audits"
    docs = {path.stem: json.loads(path.read_text()) for path in folder.glob("*.json")}
    assert set(docs) == set(AUDITS)
    assert {doc["ok"] for doc in docs.values()} == {None}
    assert capsys.readouterr().out.count("not judged: ") == len(AUDITS)
    assert (run / "eval/audits.md").read_text().count("\n## ") == len(AUDITS)


def test_an_unknown_audit_and_a_gate_of_nothing_are_refused_before_anything_is_read(run):
    with pytest.raises(ValueError, match="unknown audits 'dept'; did you mean 'depth'"):
        evaluate("audits=[dept]")
    with pytest.raises(ValueError, match="audit_gate=0 must be a finite number of metres above 0"):
        evaluate("audit_gate=0")
    assert not (run / "eval").exists()


def test_depths_that_lift_the_camera_are_named_and_need_a_camera(run):
    with pytest.raises(ValueError, match="unknown depth_source 'oracel'; did you mean 'oracle'"):
        evaluate("depth_source=oracel")
    with pytest.raises(ValueError, match="depth_source=oracle: this detector has no camera whose features are lifted"):
        evaluate("depth_source=oracle")


def test_a_second_look_in_the_mirror_needs_a_grid_with_equal_sides(run):
    with pytest.raises(ValueError, match="mirror_test=true: the grid is not as wide to the left as to the right"):
        evaluate("mirror_test=true")
    assert not (run / "eval").exists()


def test_a_run_that_scores_itself_takes_the_accelerator_that_it_was_trained_on(run, monkeypatch):
    asked = []
    monkeypatch.setattr("fusion_net.evaluate.evaluate_run", asked.append)
    evaluate_finished(run)
    (cfg,) = asked
    assert (cfg.run, cfg.accelerator) == (str(run), load_config(run).trainer.accelerator)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_refused_before_anything_is_written(run):
    with pytest.raises(ValueError, match=r"^accelerator=gpu: there is no GPU here"):
        evaluate("accelerator=gpu")
    assert not (run / "eval").exists()


@pytest.mark.parametrize("left", ["hello\n", "name: mini\n"])
def test_settings_of_a_run_that_are_cut_off_are_named(run, left):
    (run / "config.yaml").write_text(left)
    with pytest.raises(ValueError, match=r"^runs/mini/config\.yaml (is cut off|holds no settings)"):
        evaluate()


def test_a_damaged_checkpoint_names_the_other(run):
    (run / "checkpoints/best.ckpt").write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"best\.ckpt is not a readable checkpoint .*; checkpoint=last lies beside it"):
        evaluate()


def test_nothing_is_scored_where_nothing_can_be_written(run, monkeypatch):
    (run / "eval").write_text("x")
    monkeypatch.setattr("fusion_net.evaluate.drop_table", lambda *_args, **_more: pytest.fail("scored"))
    with pytest.raises(FileExistsError):
        evaluate()
