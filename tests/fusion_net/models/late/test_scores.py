"""Scores as probabilities, and what several detectors' say together."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.models.late.scores import SCORES, Platt, combine, fit_platt, log_odds, sigmoid

SILENT = np.nan
probabilities = st.floats(0.01, 0.99)


def test_platt_finds_how_the_scores_were_distorted():
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.02, 0.98, 20_000)
    hit = rng.random(20_000) < truth
    score = sigmoid((log_odds(truth) - 0.7) / 1.6)
    found = fit_platt(score, hit)
    assert found.slope == pytest.approx(1.6, abs=0.08)
    assert found.shift == pytest.approx(0.7, abs=0.08)
    np.testing.assert_allclose(found(score), truth, atol=0.02)


@pytest.mark.parametrize("hits", [[], [True], [False, False]])
def test_without_both_kinds_scores_stay_as_they_are(hits):
    found = fit_platt(np.full(len(hits), 0.4), hits)
    assert found == Platt()
    np.testing.assert_allclose(found([0.2, 0.9]), [0.2, 0.9])


def test_it_never_turns_an_order_round():
    found = fit_platt([0.9, 0.8, 0.2, 0.1], [False, False, True, True])
    assert found.slope > 0


def test_worked_numbers():
    """Two detectors at 0.6 where half of all boxes are objects, and one of them alone."""
    both, alone = [[0.6, 0.6, SILENT]], [[0.6, SILENT, SILENT]]
    assert combine(both, "noisy_or", prior=0.5)[0] == pytest.approx(0.84)
    assert combine(both, "max", prior=0.5)[0] == pytest.approx(0.6)
    assert combine(both, "mean", prior=0.5)[0] == pytest.approx(0.6)
    assert combine(both, "bayes", prior=0.5)[0] == pytest.approx(2.25 / 3.25)  # odds 1.5 * 1.5
    assert combine(both, "bayes", prior=0.2)[0] == pytest.approx(9 / 10)  # odds 0.25 * 6 * 6
    for rule in SCORES:
        assert combine(alone, rule, prior=0.2)[0] == pytest.approx(0.6)


@given(probabilities, probabilities, st.floats(0.05, 0.6))
def test_the_order_of_detectors_does_not_matter_and_a_silent_one_says_nothing(p, q, prior):
    for rule in SCORES:
        first = combine([[p, SILENT, q]], rule, prior=prior)[0]
        assert first == pytest.approx(combine([[q, p, SILENT]], rule, prior=prior)[0])
        assert 0 <= first <= 1


@given(probabilities, st.floats(0.05, 0.6))
def test_a_second_opinion_at_the_prior_changes_no_belief(p, prior):
    assert combine([[p, prior, SILENT]], "bayes", prior=prior)[0] == pytest.approx(p, abs=1e-6)


def test_none_and_nobody():
    for rule in SCORES:
        assert combine(np.zeros((0, 3)), rule, prior=0.5).shape == (0,)
        with pytest.raises(ValueError, match="no detector found"):
            combine([[SILENT] * 3], rule, prior=0.5)
    with pytest.raises(ValueError, match="no score rule 'sum'; choose from noisy_or, max, mean, bayes"):
        combine([[0.5]], "sum", prior=0.5)
