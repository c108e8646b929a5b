"""Runs side by side: the same samples or a clear word, paired differences, only what differs."""

import json
import shutil

import pytest

from fusion_net.reports.compare.runs import paired, read_evaluations, settings_apart
from fusion_net.reports.compare.write import write_comparison
from tests.fixtures.evaluated_run import evaluate, make_run
from tests.fixtures.html_page import read_page


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """runs/mini and runs/other, which differ in one setting and in their scores; runs/mini also with a broken LiDAR."""
    place = tmp_path_factory.mktemp("place")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        make_run(place)
        evaluate("run=runs/mini")
        evaluate("run=runs/mini", "fault=lidar_beams", "fault.severity=2")
        shutil.copytree("runs/mini", "runs/other")
        better(place / "runs/other/eval", by=0.25)
        evaluate("run=runs/mini", "split=train")
    return place


def better(folder, *, by):
    """Adds to every mAP of an evaluation, on every resample too, and to its settings."""
    path = folder / "result.json"
    result = json.loads(path.read_text())
    for row in result["rows"]:
        row["mAP"] += by
    result["mAP_resampled"] = {
        name: [n + round(10_000 * by) for n in values] for name, values in result["mAP_resampled"].items()
    }
    result["settings"] |= {"fuser": "average"}
    path.write_text(json.dumps(result))
    path = folder / "drop_table.json"
    doc = json.loads(path.read_text())
    for row in doc["rows"]:
        row["mAP"] += by
    path.write_text(json.dumps(doc))


@pytest.fixture
def here(place, monkeypatch):
    monkeypatch.chdir(place)
    return place


def test_differences_are_paired_and_only_what_differs_is_shown(here):
    one, other = read_evaluations(["runs/mini", "runs/other"])
    assert (one.label, other.label) == ("mini", "other")
    difference = paired(other, one, "C+L+R")
    assert difference["mean"] == pytest.approx(0.25)
    assert difference["ci95"] is None  # of one scene
    assert settings_apart([one, other]) == [("fuser", ["default", "average"])]


def test_the_page_and_the_table_say_so(here, capsys):
    page = write_comparison(["runs/mini", "runs/other"])
    assert page.as_posix() == "runs/compare/mini_other/compare.html"
    assert capsys.readouterr().out == f"comparison: {page}\n"
    found = read_page(page)
    assert found.needs_nothing_beside_it()
    assert page.stat().st_size < 1_000_000
    titles = ["settings", "drop-tables", "differences", "what-each-sensor-is-worth", "by-class-range-and-condition"]
    assert [tag["id"] for tag in found.tags["h2"]][:5] == titles
    assert "python -m fusion_net.reports.compare runs/mini runs/other" in found.text
    text = page.with_suffix(".md").read_text()
    assert "| fuser | default | average |" in text
    assert "| +0.250 - |" in text  # one scene, of which there is no interval


def test_an_evaluation_below_a_run_can_be_compared_with_it(here):
    sound, broken = read_evaluations(["runs/mini", "runs/mini/eval/lidar_beams_2"])
    assert (sound.label, broken.label) == ("mini", "mini/eval/lidar_beams_2")
    assert ("fault", ["none", "lidar_beams, severity 2"]) in settings_apart([sound, broken])


@pytest.mark.parametrize(
    ("folders", "error", "message"),
    [
        ([], ValueError, "name two runs at least"),
        (["runs/mini"], ValueError, "name two runs at least: python -m"),
        (["runs/mini", "runs/mini"], ValueError, "name two runs at least"),
        (
            ["runs/mini", "runs/none"],
            FileNotFoundError,
            "no run at runs/none; there are mini, other; train it: python train.py name=none",
        ),
        (["runs/mini", "runs/mini/eval/train"], ValueError, "they cannot be compared"),
    ],
)
def test_mistakes_are_named(here, folders, error, message):
    with pytest.raises(error, match=message):
        write_comparison(folders)


def test_an_evaluation_without_its_figures_says_how_to_get_them(here):
    shutil.copytree("runs/other", "runs/old")
    (here / "runs/old/eval/report.json").unlink()
    with pytest.raises(FileNotFoundError, match="has no report\\.json; score it again: python eval"):
        write_comparison(["runs/mini", "runs/old"])
