"""The drop table's files: the contract's fields, every figure in every form, a chart that can be opened."""

import csv
import io
import json
import warnings

import cv2
import numpy as np
import pytest

from fusion_net.evaluation.drop_table import SUBSETS, DropTable
from fusion_net.reports.plots import plot_drop_table
from fusion_net.reports.tables import as_csv, as_markdown, as_text, document, name_of, of_scenes, write_drop_table


def row(sensors, mAP):
    return {
        "sensors": list(sensors), "mAP": mAP, "NDS": 0.5, "mATE": 0.31, "mASE": 0.2, "mAOE": 0.1, "mAVE": None, "mAAE": 1.0,
        "AP": {"car": mAP, "traffic_cone": 0.25}, "num_gt": {"car": 120, "traffic_cone": 7},
        "mAP_ci95": [mAP - 0.05, mAP + 0.04], "mAP_official": 0.1, "NDS_official": 0.2, "ms_per_sample": 31.25,
        "delta_mAP": mAP - 0.8, "delta_mAP_ci95": [-0.5, 0.0],
    }  # fmt: skip


@pytest.fixture
def doc():
    rows = [row(sensors, 0.8 - 0.1 * i) for i, sensors in enumerate(SUBSETS)]
    table = DropTable(rows, row((), 0.001), [], [], np.zeros((len(rows), 2)))
    return document(
        table, run="demo", split="nano_val", num_samples=320, seed=1, command="eval.py run=runs/demo", git="abc"
    )


def test_files_and_fields(doc, tmp_path):
    write_drop_table(tmp_path / "eval", doc)
    read = json.loads((tmp_path / "eval/drop_table.json").read_text())
    assert {"run", "split", "num_samples", "seed", "command", "git", "rows", "random"} <= set(read)
    assert read["rows"] == doc["rows"]
    assert len(read["rows"]) == 7
    assert (tmp_path / "eval/drop_table.csv").exists()
    assert (tmp_path / "eval/drop_table.md").exists()


def test_one_scene_has_no_interval_in_any_form(doc, tmp_path):
    for each in (*doc["rows"], doc["random"]):
        each["mAP_ci95"] = each["delta_mAP_ci95"] = None
    doc["notes"] += of_scenes(1)
    write_drop_table(tmp_path, doc)
    first = next(csv.DictReader(io.StringIO(as_csv(doc))))
    assert (first["mAP_ci95_low"], first["mAP_ci95_high"]) == ("", "")
    for text in (as_text(doc), as_markdown(doc)):
        assert "one scene: no interval" in text
        assert "0.750" not in text
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plot_drop_table(tmp_path / "chart.png", doc)
    assert cv2.imread(str(tmp_path / "chart.png")) is not None


def test_few_scenes_are_said():
    assert of_scenes(2) == ["2 scenes: such intervals are rough, and mostly too narrow"]
    assert of_scenes(4)
    assert of_scenes(5) == []


def test_csv_has_a_column_for_every_figure(doc):
    rows = list(csv.DictReader(io.StringIO(as_csv(doc))))
    assert [r["sensors"] for r in rows] == ["C+L+R", "C+L", "C+R", "L+R", "C", "L", "R", "random"]
    assert float(rows[1]["mAP_ci95_low"]) == pytest.approx(0.65)
    assert float(rows[1]["AP_traffic_cone"]) == 0.25
    assert rows[0]["num_gt_car"] == "120"
    assert rows[0]["mAVE"] == ""


def test_text_is_aligned(doc):
    text = as_text(doc)
    blocks = text.split("\n\n")
    for block in blocks[1:3]:
        assert len({len(line) for line in block.splitlines()}) == 1
    assert "C+L+R" in text
    assert "-0.100" in text
    assert "traffic_cone" not in text  # its short name fits
    assert all(note in text for note in doc["notes"])
    assert max(len(line) for block in blocks[1:3] for line in block.splitlines()) <= 160


def test_notes_say_what_the_official_score_counts(doc):
    notes = " ".join(doc["notes"])
    for words in ("all ten classes", "all around the car", "30 m (traffic cone, barrier)", "at least one LiDAR or radar point",
                  "bicycle rack", "a label off the grid is missed"):  # fmt: skip
        assert words in notes


def test_markdown_rows_have_equal_cells(doc):
    for block in as_markdown(doc).split("\n\n")[1:3]:
        lines = block.splitlines()
        assert len({line.count("|") for line in lines}) == 1
        assert lines[1].startswith("|---|---:")


def test_name_of():
    assert name_of(["camera", "radar"]) == "C+R"


def test_chart(doc, tmp_path):
    plot_drop_table(tmp_path / "drop_table.png", doc)
    image = cv2.imread(str(tmp_path / "drop_table.png"))
    assert image.shape[0] > 300
    assert image.std() > 10
