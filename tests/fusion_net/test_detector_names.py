"""What ``Detector.load`` takes: the example of the docs runs, and what is no detector is answered with the nearest."""

import re
from pathlib import Path

import pytest

from fusion_net.detector import Detector
from tests.fixtures.training_setup import write_data
from tests.fixtures.untrained_run import write_run

PROJECT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run that is the only one beside it."""
    return write_run(tmp_path_factory.mktemp("place") / "runs/mini")


def test_weights_that_are_not_there_are_named():
    with pytest.raises(FileNotFoundError, match="no shipped weights nonsense"):
        Detector.load("nonsense")


@pytest.mark.parametrize("name", [None, "", 5])
def test_what_is_no_name_is_answered_with_those_there_are(name):
    with pytest.raises(ValueError, match=rf'detector: {name!r} names none; give shipped weights \("nano", '):
        Detector.load(name)


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("nan", r"no shipped weights nan; did you mean nano\?"),
        ("README.md", "no shipped weights README.md; there are nano, "),
        ("data", "no run at data; there are runs/mini; train it"),
        ("mini", "there is a run of this name: runs/mini"),
        ("runs/min", r"no run at runs/min; did you mean runs/mini\?"),
    ],
)
def test_a_file_or_folder_that_is_no_detector_is_answered_with_the_nearest(folder, monkeypatch, name, answer):
    monkeypatch.chdir(folder.parents[1])
    (folder.parents[1] / "README.md").touch()
    (folder.parents[1] / "data").mkdir(exist_ok=True)
    with pytest.raises(FileNotFoundError, match=answer):
        Detector.load(name)


def test_a_folder_is_taken_for_a_run(folder, monkeypatch):
    monkeypatch.chdir(folder.parents[1])
    answer = r"no run at runs/nothing; there are mini; train it: python train\.py name=nothing"
    with pytest.raises(FileNotFoundError, match=answer):
        Detector.load("runs/nothing")


@pytest.mark.parametrize("page", ["README.md", "docs/report.md"])
def test_the_example_of_the_docs_runs_as_it_stands(page, tmp_path, monkeypatch):
    write_data(tmp_path / "data/try")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (PROJECT / page).read_text(encoding="utf-8"), re.DOTALL)
    (example,) = [block for block in blocks if "Detector.load" in block]
    names: dict = {}
    exec(example, names)
    assert len(names["found"])
