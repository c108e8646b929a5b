"""What a comparison cannot read is answered with the command that makes it."""

import shlex

import pytest

from fusion_net.reports.compare.folders import FILES, find_evaluations
from fusion_net.reports.compare.write import LONGEST, folder_name


def evaluated(folder):
    folder.mkdir(parents=True)
    for file in FILES:
        (folder / file).touch()


@pytest.fixture
def here(tmp_path, monkeypatch):
    """runs/A with an evaluation, a second one below it and a half one; runs/B without; shipped weights with one."""
    monkeypatch.chdir(tmp_path)
    for place in ("runs/A/eval", "runs/A/eval/test", "runs/A/eval/half", "runs/checkpoints/early/eval"):
        evaluated(tmp_path / place)
    (tmp_path / "runs/A/eval/half/report.json").unlink()
    (tmp_path / "runs/B and C").mkdir()
    for run in ("A", "B and C"):
        (tmp_path / "runs" / run / "config.yaml").write_text("seed: 1\n")
    return tmp_path


def test_runs_and_evaluations_below_them_are_found(here):
    found = find_evaluations(["runs/A", "runs/A/eval/test", "runs/checkpoints/early", "runs/checkpoints/early/eval"])
    early = "runs/checkpoints/early/eval"
    assert [place.as_posix() for place in found] == ["runs/A/eval", "runs/A/eval/test", early, early]


@pytest.mark.parametrize(
    ("folder", "answer"),
    [
        ("runs/missing", "no run at runs/missing; there are A, B and C; train it: python train.py name=missing"),
        (
            "runs/study/x",
            "no run at runs/study/x; there are runs/A, runs/B and C; train it: python train.py name=study/x",
        ),
        (
            "runs/B and C",
            "no evaluation in runs/B and C; score it: python eval.py " + shlex.quote("run='runs/B and C'"),
        ),
        ("runs/A/eval/val", "no evaluation in runs/A/eval/val; score it: python eval.py run=runs/A"),
        ("runs/A/eval/half", "runs/A/eval/half has no report.json; score it again: python eval.py run=runs/A"),
        ("runs/checkpoints/nano", "no evaluation in runs/checkpoints/nano; score it: python eval.py checkpoint=nano"),
        ("runs/checkpoints/nano/eval/test", "no evaluation in .*; score it: python eval.py checkpoint=nano"),
        ("runs/checkpoints/foo", "no shipped weights foo; there are nano, "),
    ],
)
def test_what_is_not_there_names_the_command_that_makes_it(here, folder, answer):
    with pytest.raises(FileNotFoundError, match=answer):
        find_evaluations(["runs/A", folder])


def test_evaluations_below_a_folder_without_one_of_its_own_are_named(here):
    for place in ("val@data-try", "a b"):
        evaluated(here / "runs/checkpoints/nano/eval" / place)
    there = "there are 'runs/checkpoints/nano/eval/a b', runs/checkpoints/nano/eval/val@data-try: name one of them, or score"
    for folder in ("runs/checkpoints/nano", "runs/checkpoints/nano/eval"):
        with pytest.raises(FileNotFoundError, match=f"no evaluation in {folder}; {there}"):
            find_evaluations(["runs/A", folder])
    find_evaluations(["runs/A", "runs/checkpoints/nano/eval/val@data-try"])


def test_one_is_no_comparison(here):
    with pytest.raises(ValueError, match="name two runs at least"):
        find_evaluations(["runs/A", "runs/A"])


def test_comparisons_of_runs_with_long_names_have_a_folder_each():
    long = "sweeps/mine/" + "x" * 95
    assert folder_name(["runs/A", "B"]) == "runs-A_B"
    names = {folder_name([long, other]) for other in ("A", "B")}
    assert len(names) == 2
    assert {len(name) for name in names} == {LONGEST}
