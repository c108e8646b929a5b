"""metrics.csv: one header and no row twice, wherever a run was cut."""

import pytest

from fusion_net.training.callbacks import MetricsCSV


@pytest.mark.parametrize("rows_before", [0, 1, 2])
def test_a_resumed_file_is_that_of_an_unbroken_run(tmp_path, rows_before):
    """A checkpoint says how long the file was; what was written after it is written again."""
    whole, cut = MetricsCSV(tmp_path / "whole.csv"), MetricsCSV(tmp_path / "cut.csv")
    for step in range(3):
        whole.write(step, {"loss": 1.0 / (step + 1)})
    for step in range(rows_before):
        cut.write(step, {"loss": 1.0 / (step + 1)})
    checkpoint = cut.state_dict()
    cut.write(rows_before, {"loss": 99.0})
    resumed = MetricsCSV(tmp_path / "cut.csv")
    resumed.load_state_dict(checkpoint)
    for step in range(rows_before, 3):
        resumed.write(step, {"loss": 1.0 / (step + 1)})
    assert resumed.path.read_bytes() == whole.path.read_bytes()
