"""Slope and break point of curves whose answers are known."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.evaluation.cells.curves import break_point, slope

AMOUNTS = np.array([0.0, 0.5, 1.0, 3.0])
score = st.floats(0.05, 1.0)


@given(score, st.floats(-0.3, 0.3))
def test_a_straight_line_has_its_own_slope(sound, per_unit):
    scores = (sound + per_unit * AMOUNTS)[:, None]
    np.testing.assert_allclose(slope(AMOUNTS, scores), per_unit, atol=1e-12)


@given(score, st.floats(0.01, 1.0))
def test_a_falling_line_breaks_where_a_tenth_of_its_start_is_lost(sound, per_unit):
    scores = (sound - per_unit * AMOUNTS)[:, None]
    expected = 0.1 * sound / per_unit
    found = break_point(AMOUNTS, scores)[0]
    if expected < AMOUNTS[-1] - 1e-9:
        np.testing.assert_allclose(found, expected)
    elif expected > AMOUNTS[-1] + 1e-9:
        assert found == np.inf


def test_the_first_of_two_falls_counts_and_resamples_are_apart():
    scores = np.array([[1.0, 1.0], [0.8, 1.0], [1.0, 1.0], [0.0, 0.95]])
    np.testing.assert_allclose(break_point(AMOUNTS, scores), [0.25, np.inf])


@given(st.lists(score, min_size=4, max_size=4), st.floats(0.1, 5.0))
def test_a_unit_scales_both(scores, unit):
    column = np.array(scores)[:, None]
    np.testing.assert_allclose(slope(unit * AMOUNTS, column), slope(AMOUNTS, column) / unit, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(break_point(unit * AMOUNTS, column), unit * break_point(AMOUNTS, column))
