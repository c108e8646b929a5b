"""The result file of a run: small, whole, and read back as it was."""

import numpy as np
import pytest

from fusion_net.reports.run_result import RESULT, is_scored, read_result, write_result
from tests.fixtures.run_results import RESAMPLES, make_result


def test_a_result_of_ten_classes_is_under_twenty_kilobytes_and_read_as_it_was_written(tmp_path):
    result = make_result(noise=np.random.default_rng(0).normal(0, 0.02, RESAMPLES))
    write_result(tmp_path / "a/result.json", result)
    assert (tmp_path / "a/result.json").stat().st_size < 20_000
    assert read_result(tmp_path / "a/result.json") == result
    assert len(result["mAP_resampled"]["C+L+R"]) == RESAMPLES
    assert result["rows"][0]["mAOE"] == 0.4568


def test_a_file_that_is_no_result_is_named(tmp_path):
    (tmp_path / "result.json").write_text('{"rows": []}')
    with pytest.raises(ValueError, match=r"result\.json is no result of a run"):
        read_result(tmp_path / "result.json")


@pytest.mark.parametrize(
    "damage",
    [
        lambda result: result["rows"][0].update(mAP="high"),
        lambda result: result["rows"][3].update(mAP=float("nan")),
        lambda result: result["rows"].pop(2),
        lambda result: result["mAP_resampled"].pop("C"),
        lambda result: result["mAP_resampled"].update(C=[1, 2, 3]),
        lambda result: result.pop("seed"),
        lambda result: result.update(rows=3),
    ],
)
def test_a_result_without_its_figures_is_told_how_to_have_it_again_and_is_no_score(tmp_path, damage):
    result = make_result()
    write_result(tmp_path / RESULT, result)
    assert is_scored(tmp_path)
    damage(result)
    write_result(tmp_path / RESULT, result)
    with pytest.raises(
        ValueError, match=r"eval/result\.json is no result of a run .*; have it again: python eval\.py run="
    ):
        read_result(tmp_path / RESULT)
    assert not is_scored(tmp_path)
    assert not is_scored(tmp_path / "nowhere")
