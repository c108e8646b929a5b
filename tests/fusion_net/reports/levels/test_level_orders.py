"""Verdicts on orders: by the intervals of neighbours, and never on a level that was not measured."""

import numpy as np
import pytest

from fusion_net.reports.levels.orders import verdict
from fusion_net.reports.levels.scores import Estimate

NOISE = np.random.default_rng(0).normal(0, 0.01, 400)
ORDER = ("early", "mid", "late")


def found(*values, independent=0.0):
    rng = np.random.default_rng(1)
    return {
        level: Estimate(value, value + NOISE + rng.normal(0, 1, 400) * independent)
        for level, value in zip(ORDER, values, strict=True)
    }


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ((0.6, 0.58, 0.5), "holds"),
        ((0.5, 0.58, 0.6), "does not hold"),
        ((0.5, 0.6, 0.4), "holds partly"),
        ((0.6, 0.4, 0.5), "holds partly"),
        ((0.5, 0.5, 0.4), "holds partly"),
        ((0.5, 0.6, 0.5), "holds partly"),
        ((0.5, 0.6, 0.55), "does not hold"),
        ((0.5, 0.5, 0.5), "undecided"),
    ],
)
def test_paired_draws_decide(values, word):
    assert verdict("c", ORDER, found(*values))["verdict"] == word


def test_differences_within_the_noise_decide_nothing():
    result = verdict("c", ORDER, found(0.52, 0.51, 0.5, independent=0.1))
    assert result["verdict"] == "undecided"
    assert [pair["pair"] for pair in result["pairs"]] == ["early - mid", "mid - late", "early - late"]
    assert result["pairs"][0]["difference"] == pytest.approx(0.01)


def test_a_level_without_a_figure_is_named():
    result = verdict("c", ORDER, found(0.5, 0.4, 0.3) | {"mid": None})
    assert result["verdict"] == "not measured"
    assert result["missing"] == ["mid"]
