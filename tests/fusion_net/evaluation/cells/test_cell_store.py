"""Cells on disk: kept one by one, taken up again, never those of other weights."""

import json

import pytest

from fusion_net.evaluation.cells.store import ABOUT, CellStore, read_cells, write_cells

OWN = {"weights": "a1", "data": ["f"], "samples": "val-25", "git": "1"}


def cell(score):
    return {"curve": "", "amount": 0.0, "seconds": 1.0, "scores": {"C+L+R": {"mAP": score}}}


def test_a_cell_is_on_disk_at_once_and_found_again_with_what_is_committed(tmp_path):
    write_cells(tmp_path / "docs/deaths.json", OWN, {"old": cell(0.1), "both": cell(0.2)})
    store = CellStore(tmp_path / "run", committed=tmp_path / "docs", about=OWN)
    assert store.get("deaths", "old") == cell(0.1)
    assert store.get("deaths", "new") is None
    store.put("deaths", "new", cell(0.3))
    store.put("deaths", "both", cell(0.4))
    again = CellStore(tmp_path / "run", committed=None, about=OWN | {"git": "2"})
    assert [again.get("deaths", name) for name in ("old", "new", "both")] == [cell(0.1), cell(0.3), cell(0.4)]


@pytest.mark.parametrize("other", [{"weights": "b2"}, {"data": ["e"]}, {"samples": "val-all"}])
def test_cells_of_other_weights_data_or_scenes_are_not_the_runs_own(tmp_path, other):
    CellStore(tmp_path, committed=None, about=OWN).put("deaths", "one", cell(0.5))
    store = CellStore(tmp_path, committed=tmp_path, about=OWN | other)
    assert store.get("deaths", "one") is None
    store.put("deaths", "two", cell(0.6))
    assert set(read_cells(tmp_path / "deaths.json")) == {ABOUT, "two"}


def test_a_file_has_a_cell_a_line_and_a_damaged_one_is_named(tmp_path):
    path = tmp_path / "deaths.json"
    write_cells(path, OWN, {"one": cell(0.5), "two": cell(0.6)})
    assert len(path.read_text().splitlines()) == 5
    path.write_text(path.read_text()[:-20])
    with pytest.raises(ValueError, match=r"deaths\.json holds no cells .*; delete it"):
        read_cells(path)
    path.write_text(json.dumps({"about": OWN, "one": 5}))
    with pytest.raises(ValueError, match="holds no cells"):
        CellStore(tmp_path, committed=None, about=OWN)
