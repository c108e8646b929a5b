"""A run on a grid whose cells grow with the distance: the same commands as on any other."""

import json
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir

from fusion_net.common.bev_grid import GradedGrid
from fusion_net.common.cli.command import CONFIGS
from fusion_net.evaluate import evaluate_run
from fusion_net.fit import fit
from fusion_net.runs.trained import trained_run
from tests.fixtures.training_setup import settings, write_data


@pytest.mark.slow
def test_it_trains_is_loaded_again_and_is_scored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fit(settings(write_data(Path("tree")), "grid=graded", "name=graded"))
    model = trained_run(Path("runs/graded"), "last").model()
    assert model.grid == model.losses.grid == GradedGrid(0.0, 32.0, -12.8, 16.0, 0.4, 56, 64)
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        evaluate_run(compose("eval", overrides=["run=runs/graded", "bootstrap=5"]))
    rows = json.loads(Path("runs/graded/eval/drop_table.json").read_text())["rows"]
    assert len(rows) == 7
    assert all(0 <= row["mAP"] <= 1 and row["num_gt"]["car"] for row in rows)
