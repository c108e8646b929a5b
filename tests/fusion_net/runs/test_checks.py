"""What commands are refused for in the process that types them: no run, no weights, no data, wrong rules; and that none of it
imports torch."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir

from fusion_net.common.cli.command import CONFIGS
from fusion_net.nuscenes.absent import check_data
from fusion_net.runs.checks import check_evaluation, check_training, only_training
from fusion_net.runs.sources import newest_runs, shipped_names


def composed(name, *overrides):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        return compose(name, overrides=list(overrides))


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with the runs a, study/b and c, begun in this order, and data that is no more than there."""
    monkeypatch.chdir(tmp_path)
    for age, name in ((30, "a"), (20, "study/b"), (10, "c")):
        folder = tmp_path / "runs" / name
        (folder / "checkpoints").mkdir(parents=True)
        (folder / "checkpoints/last.ckpt").touch()
        (folder / "config.yaml").write_text("seed: 1\n")
        past = (folder / "config.yaml").stat().st_mtime - age
        os.utime(folder / "config.yaml", (past, past))
    (tmp_path / "tree").mkdir()
    (tmp_path / "tree/manifest.json").write_text("{}")
    return tmp_path


def test_an_evaluation_of_nothing_names_the_newest_runs_and_the_shipped_weights(here):
    assert [path.as_posix() for path in newest_runs()] == ["runs/c", "runs/study/b", "runs/a"]
    with pytest.raises(ValueError, match="run is needed") as error:
        check_evaluation(composed("eval"))
    assert "write run=runs/c (others, newest first: run=runs/study/b, run=runs/a)" in str(error.value)
    assert "or take shipped weights: checkpoint=nano or checkpoint=early" in str(error.value)
    assert shipped_names()[0] == "nano"


def test_without_a_run_the_shipped_weights_are_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"write run=runs/NAME, or take shipped weights: checkpoint=nano"):
        check_evaluation(composed("eval"))


EVALUATIONS = [
    (["run=runs/none"], r"no run at runs/none; there are a, c; train it: python train\.py name=none"),
    (["run=runs/study/none"], r"no run at runs/study/none; there are b; train it: python train\.py name=study/none"),
    (["run=runs/a"], r"no checkpoint runs/a/checkpoints/best\.ckpt; there are last\.ckpt: pass checkpoint=last"),
    (
        ["checkpoint=runs/a/checkpoints/last.ckpt"],
        r"checkpoint=runs/a/checkpoints/last\.ckpt is of a run; write run=runs/a checkpoint=last$",
    ),
    (["run=c"], "no run at c; it is runs/c"),
    (
        ["checkpoint=c"],
        "there is a run of this name: runs/c; its weights are runs/c/checkpoints/best.ckpt",
    ),
    (["checkpoint=nanoo"], r"no shipped weights nanoo; did you mean nano\? Files are named by their path"),
    (["checkpoint=x1"], "no shipped weights x1; there are nano, early, late, surround; files are named by their path"),
    (["checkpoint=README.md"], "no shipped weights README.md; there are nano, early"),
    (
        ["checkpoint=''"],
        r"give a name of shipped weights \(nano, early, late, surround\) or the path of a \.pt file",
    ),
    (["run=runs/study"], "no run at runs/study; it holds 1 run: b"),
    (["run=nope"], r"no run at nope; there are runs/a, runs/c; train it: python train\.py name=nope"),
    (
        ["run=runs/study/bb"],
        r"no run at runs/study/bb; did you mean runs/study/b\? Or train it: python train\.py name=study/bb",
    ),
    (["run=."], r"no run at \.; there are runs/a, runs/c; train it: python train\.py name=mine"),
    (
        ["checkpoint=nano", "data.root=none"],
        r"no data in none; make some: python -m data_gen data=nano data\.root=none",
    ),
    (["checkpoint=nano", "data.root=[tree,none]"], "no data in none"),
    (["checkpoint=nano", "accelerator=cuda"], "unknown accelerator 'cuda'; did you mean 'cpu'"),
    (["checkpoint=nano", "batch_size=0"], "batch_size=0 must be at least 1"),
    (
        ["checkpoint=nano", "late.merge=sum"],
        r"unknown late\.merge 'sum'; .* There are covariance_intersection, information, ",
    ),
    (["checkpoint=nano", "late.merge=5"], r"unknown late\.merge '5'; did you mean"),
    (["checkpoint=nano", "late.score=noisyor"], r"unknown late\.score 'noisyor'; did you mean 'noisy_or'"),
    (["checkpoint=nano", "late.association=mahal"], r"late\.association 'mahal'; did you mean 'mahalanobis'"),
    (["checkpoint=nano", "late.gate=wide"], r"late\.gate=wide is a probability: give a number above 0 and below 1"),
    (
        ["checkpoint=nano", "late.min_probability=2"],
        r"late\.min_probability=2 is a probability: give a number from 0 to 1",
    ),
]


@pytest.mark.parametrize(("overrides", "answer"), EVALUATIONS, ids=[" ".join(words) for words, _ in EVALUATIONS])
def test_an_evaluation_is_refused(here, overrides, answer):
    with pytest.raises((ValueError, FileNotFoundError), match=answer):
        check_evaluation(composed("eval", *overrides))


GOING_ON = [
    ({}, "python train.py name=study/b resume=true"),
    ({"command": "train.py name=study/b seed='2'", "job": None}, "python train.py name=study/b seed=2 resume=true"),
    ({"command": "train.py name=study/b overwrite=true"}, "python train.py name=study/b resume=true"),
    (
        {"command": "train.py -m 'name=study/${job_folder:}' seed=1,2", "job": 0},
        "python train.py -m 'name=study/${job_folder:}' seed=1,2 skip_finished=true",
    ),
]


@pytest.mark.parametrize(("around", "command"), GOING_ON)
def test_a_run_cut_before_its_first_checkpoint_is_answered_with_the_command_that_goes_on(here, around, command):
    (here / "runs/study/b/checkpoints/last.ckpt").unlink()
    (here / "runs/study/b/env.json").write_text(json.dumps(around))
    with pytest.raises(
        FileNotFoundError, match=r"no checkpoint in runs/study/b: it has written none yet; if "
    ) as error:
        check_evaluation(composed("eval", "run=runs/study/b"))
    assert str(error.value).endswith(f"go on with: {command}")


def test_missing_data_is_answered_with_whole_data_sets_those_of_a_similar_name_first(here):
    for name, complete in (("data/try", True), ("data/tray", True), ("data/half", False), ("other/fog", True)):
        (here / name / "v1.0-x").mkdir(parents=True)
        (here / name / "v1.0-x/scene.json").write_text("[]")
        (here / name / "manifest.json").write_text(f'{{"complete": {str(complete).lower()}}}')
    (here / "data/big/shard-1-of-2/v1.0-x").mkdir(parents=True)
    (here / "data/empty").mkdir()
    (here / "data/damaged").mkdir()
    (here / "data/damaged/manifest.json").write_text("{")
    tried = r"write data\.root=data/try \(others: data\.root=data/tray, data\.root=data/big\), or make some: "
    with pytest.raises(ValueError, match=rf"no data in data/tri; {tried}.* data\.root=data/tri$"):
        check_data("data/tri")
    with pytest.raises(ValueError, match=r"no data in other/fgo; write data\.root=other/fog \(others: "):
        check_data("other/fgo")
    with pytest.raises(ValueError, match=r"make some: python -m data_gen data=sequence data\.root=other/sequence$"):
        check_data(["data/try", "other/sequence"])
    (here / "data/file.txt").touch()
    with pytest.raises(ValueError, match=r"no data in data/file\.txt, which is a file; write data\.root=data/"):
        check_data("data/file.txt")


def test_the_data_that_a_run_was_trained_on_is_missed_before_torch_is_imported(here):
    (here / "runs/c/config.yaml").write_text("data: {root: data/gone}\n")
    with pytest.raises(ValueError, match=r"no data in data/gone; make some: .* data\.root=data/gone"):
        check_evaluation(composed("eval", "run=runs/c", "checkpoint=last"))


TRAININGS = [
    (["name=c", "data.root=tree"], "runs/c exists; pass name=ANOTHER, resume=true"),
    (["name=new", "data.root=tree", "resume=true"], "nothing to resume: there is no run runs/new"),
    (["name=new", "data.root=none"], "no data in none; make some"),
    (["trainer.fusion_steps=0"], "trainer.fusion_steps=0 must be at least 1"),
    (["trainer.camera_steps=-5"], "trainer.camera_steps=-5 must be at least 0"),
    (["trainer.max_lr=-1"], "trainer.max_lr=-1 must be above 0"),
    (["trainer.weight_decay=-1"], "trainer.weight_decay=-1 must be a finite number, 0 or more"),
    (["trainer.ema_decay=2"], "trainer.ema_decay=2 is a probability: between 0 and 1"),
    (["modality_dropout=-1"], "modality_dropout=-1 is a probability: between 0 and 1"),
    (["trainer.max_minutes=-1"], "trainer.max_minutes=-1 is no number of minutes above 0; null sets no limit"),
    (["trainer.max_minutes=soon"], "trainer.max_minutes=soon is no number of minutes"),
    (["name=new", "data.root=tree", "init=nanoo"], "init=nanoo: no shipped weights nanoo"),
    (["name=new", "data.root=tree", "init=5"], "init=5: no shipped weights 5; there are nano"),
    (
        ["name=new", "data.root=tree", "model=late", "late.merge=best_of"],
        r"unknown late\.merge 'best_of'; did you mean 'best'",
    ),
    (["name=new", "data.root=tree", "model=late", "late.gate=1.0"], r"late\.gate=1\.0 is a probability"),
]


@pytest.mark.parametrize(("overrides", "answer"), TRAININGS, ids=[" ".join(words) for words, _ in TRAININGS])
def test_a_training_is_refused(here, overrides, answer):
    with pytest.raises(ValueError, match=answer):
        check_training(composed("train", *overrides))


def test_what_can_be_done_is_let_through(here):
    check_evaluation(composed("eval", "run=runs/c", "checkpoint=last", "late.gate=0.9", "late.merge=best"))
    check_evaluation(composed("eval", "checkpoint=nano", "data.root=tree", "late.min_probability=0"))
    check_training(composed("train", "name=new", "data.root=tree", "init=nano"))
    check_training(composed("train", "name=c", "data.root=tree", "resume=true"))


def test_a_run_that_another_process_trains_is_left_alone(here, monkeypatch):
    with only_training(Path("runs/c")):
        for flags in ([], ["resume=true"], ["overwrite=true"]):
            with pytest.raises(
                ValueError, match="another training is writing to runs/c; wait for it, stop it, or pass"
            ):
                check_training(composed("train", "name=c", "data.root=tree", *flags))
        check_training(composed("train", "name=new", "data.root=tree"))
        monkeypatch.setenv("LOCAL_RANK", "1")
        check_training(composed("train", "name=c", "data.root=tree"))
    monkeypatch.delenv("LOCAL_RANK")
    check_training(composed("train", "name=c", "data.root=tree", "resume=true"))


def test_the_other_processes_of_a_run_find_its_folder_open(here, monkeypatch):
    monkeypatch.setenv("LOCAL_RANK", "1")
    check_training(composed("train", "name=c", "data.root=tree"))


def test_refusals_need_no_torch():
    """Each of these modules answers a mistake; torch, Lightning and numba take several times as long to import as all of it."""
    modules = ["runs.checks", "reports.compare.__main__", "reports.compare.folders", "reports.levels.__main__"]
    modules += ["reports.ablation.__main__", "reports.tracks.__main__", "viz.animation.__main__"]
    modules += ["reports.ablation.jobs", "reports.statistics", "viz.rerun_log.__main__", "viz.rerun_log.check"]
    code = f"import sys, {', '.join(f'fusion_net.{name}' for name in modules)}\n"
    code += "print(*{'torch', 'lightning', 'numba', 'scipy', 'matplotlib', 'cv2'} & {*sys.modules})"
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[3], capture_output=True, text=True, check=True
    )
    assert found.stdout.split() == []
