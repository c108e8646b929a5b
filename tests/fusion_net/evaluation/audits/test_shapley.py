"""Shapley values: what defines them."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.evaluation.audits.shapley import shapley
from fusion_net.evaluation.drop_table import SUBSETS

SCORES = st.lists(st.floats(0, 1), min_size=7, max_size=7)


@given(SCORES)
def test_values_sum_to_what_all_sensors_are_worth(scores):
    values = dict(zip(SUBSETS, scores, strict=True))
    assert sum(float(value) for value in shapley(values).values()) == pytest.approx(values[SUBSETS[0]])


@given(SCORES)
def test_a_sensor_that_changes_nothing_is_worth_nothing(scores):
    without = dict(zip(SUBSETS, scores, strict=True))
    values = {}
    for subset in SUBSETS:
        rest = tuple(name for name in subset if name != "radar")
        values[subset] = without[rest] if rest else 0.0
    assert float(shapley(values)["radar"]) == pytest.approx(0.0, abs=1e-12)


@given(SCORES)
def test_sensors_that_can_be_exchanged_are_worth_the_same(scores):
    swap = {"camera": "lidar", "lidar": "camera", "radar": "radar"}
    values = {frozenset(subset): score for subset, score in zip(SUBSETS, scores, strict=True)}
    same = {subset: (values[frozenset(subset)] + values[frozenset(swap[n] for n in subset)]) / 2 for subset in SUBSETS}
    found = shapley(same)
    assert float(found["camera"]) == pytest.approx(float(found["lidar"]))


def test_independent_sensors_are_worth_what_they_are_alone():
    alone = {"camera": 0.1, "lidar": 0.4, "radar": 0.2}
    values = {s: sum(alone[n] for n in s) for k in (1, 2, 3) for s in combinations(alone, k)}
    assert {name: pytest.approx(value) for name, value in shapley(values).items()} == alone


def test_arrays_are_taken_element_by_element():
    values = {subset: np.array([1.0, len(subset)]) for subset in SUBSETS}
    np.testing.assert_allclose(shapley(values)["lidar"], [1 / 3, 1.0])


def test_a_missing_subset_is_named():
    with pytest.raises(ValueError, match="shapley: no value of camera, lidar"):
        shapley({subset: 1.0 for subset in SUBSETS if subset != ("camera", "lidar")})
