"""The report of an evaluation: complete, in order, self-contained, and honest about what it could not measure."""

import json
import shutil

import cv2
import numpy as np
import pytest

from fusion_net.evaluation.breakdown.error_budget import BUDGET
from fusion_net.reports.evaluation.page import CONTENTS
from tests.fixtures.evaluated_run import evaluate, make_run
from tests.fixtures.html_page import read_page

AUDIT = {"name": "blind", "title": "Is it <blind>?", "verdict": "it is not", "ok": True, "numbers": {}, "picture": "blind.png",
         "explanation": "It looks."}  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """runs/mini, evaluated."""
    place = tmp_path_factory.mktemp("place")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        folder = make_run(place, "mini", "modality_dropout=0.4", "fuser=average")
        (folder / "metrics.csv").write_text(
            "step,name,value\n20,train/loss,5.0\n40,train/loss,3.0\n40,val/mAP,0.25\n60,train/loss,nan\n"
        )
        evaluate("run=runs/mini")
    return place


@pytest.fixture(scope="module")
def folder(place):
    return place / "runs/mini/eval"


@pytest.fixture(scope="module")
def page(folder):
    return read_page(folder / "report.html")


def test_it_needs_nothing_beside_it_and_is_small(page, folder):
    assert page.needs_nothing_beside_it()
    assert (folder / "report.html").stat().st_size < 1_000_000


def test_its_sections_are_in_order_and_linked(page):
    assert [tag["id"] for tag in page.tags["h2"]] == [anchor for anchor, _ in CONTENTS]
    assert [tag["href"] for tag in page.tags["a"]] == [f"#{anchor}" for anchor, _ in CONTENTS]


def test_it_can_be_read_on_a_phone_and_aloud(page, folder):
    assert any(tag.get("name") == "viewport" for tag in page.tags["meta"])
    assert all(tag["alt"] for tag in page.tags["img"])
    assert all(tag["aria-label"] and tag["role"] == "img" for tag in page.tags["svg"])
    source = (folder / "report.html").read_text()
    assert "prefers-color-scheme: dark" in source
    assert "@media print" in source


def test_it_says_what_was_run_and_with_which_settings(page):
    for text in ("modality_dropout0.4", "fuseraverage", "checkpoint best.ckpt", "split val", "To run it again"):
        assert text in page.text, text


def test_it_shows_the_same_samples_with_what_each_row_found(page):
    assert "The best sample" in page.text
    assert "The worst sample" in page.text
    assert "Sample 3 of 3" in page.text
    assert page.text.count("Every label, and who found it") == 5
    assert "radar alone" in page.text


def test_its_figures_are_json(folder):
    found = json.loads((folder / "report.json").read_text())
    table = json.loads((folder / "drop_table.json").read_text())
    assert sum(found["worth"]["mAP"][s]["value"] for s in ("camera", "lidar", "radar")) == pytest.approx(
        table["rows"][0]["mAP"], abs=1e-3
    )
    assert [row["kind"] for row in found["budget"]["budget"]] == list(BUDGET)
    assert found["budget"]["mAP"] == pytest.approx(table["rows"][0]["mAP"], abs=1e-3)
    labels = table["rows"][0]["num_gt"]
    assert [row["count"] for row in found["confusion"]["labels"]] == list(labels.values())
    for axis in ("range", "condition"):
        assert sum(group["labels"] for group in found["groups"][axis]) == sum(labels.values())


def test_audits_are_shown_where_they_were_written(place, monkeypatch, capsys):
    monkeypatch.chdir(place)
    shutil.copytree("runs/mini", "runs/audited")
    audits = place / "runs/audited/eval/audits"
    audits.mkdir()
    (audits / "blind.json").write_text(json.dumps(AUDIT))
    cv2.imwrite(str(audits / "blind.png"), np.full((20, 1500, 3), 200, np.uint8))
    evaluate("run=runs/audited")
    page = read_page(audits.parent / "report.html")
    assert page.tags["h2"][-1]["id"] == "audits"
    assert "Is it <blind>?" in page.text
    assert "ok: it is not" in page.text
    assert capsys.readouterr().out.splitlines()[-1] == "report: runs/audited/eval/report.html"


def test_a_network_without_a_camera_and_without_training_has_a_report_too(place, monkeypatch):
    monkeypatch.chdir(place)
    make_run(place, "lidar", "encoders=[lidar]")
    evaluate("run=runs/lidar")
    page = read_page(place / "runs/lidar/eval/report.html")
    assert "the network has no camera" in page.text
    assert "were not trained here have none" in page.text
    assert [tag["id"] for tag in page.tags["h2"]] == [anchor for anchor, _ in CONTENTS]


def test_who_wants_none_gets_none(place, monkeypatch):
    monkeypatch.chdir(place)
    evaluate("run=runs/mini", "split=train", "report=false")
    assert (place / "runs/mini/eval/train/drop_table.json").exists()
    assert not (place / "runs/mini/eval/train/report.html").exists()
