"""Scales that make the mean squared normalised innovation 2, and the measures of honesty."""

import numpy as np
import pytest

from fusion_net.models.late.calibration import LEAST_MATCHES, consistency, fit_scales
from fusion_net.models.late.covariance import along_and_across, ray_covariance

FACTOR = np.array([[0.5, 9.0], [4.0, 1.5]])


def errors(n=4000, seed=0):
    """Errors along and across of two classes whose claimed variances are wrong by FACTOR."""
    rng = np.random.default_rng(seed)
    label, variance = rng.integers(0, 2, n), rng.uniform(0.1, 3.0, (n, 2))
    return rng.normal(size=(n, 2)) * np.sqrt(variance * FACTOR[label]), variance, label


def test_the_factors_are_found_by_class_and_direction():
    error, variance, label = errors()
    scales = fit_scales(error, variance, label, num_classes=2)
    np.testing.assert_allclose(scales.factor, FACTOR, rtol=0.1)
    assert scales.matches.tolist() == np.bincount(label).tolist()
    normalised = error**2 / (variance * scales.factor[label])
    for k in range(2):
        assert normalised[label == k].sum(axis=1).mean() == pytest.approx(2.0)


def test_scaled_covariances_are_honest():
    error, variance, label = errors()
    factor = fit_scales(error, variance, label, num_classes=2).factor
    place = np.random.default_rng(1).uniform(-30, 30, (len(error), 2))
    in_ego = np.einsum("nij,nj->ni", np.linalg.inv(ray_covariance(np.ones_like(error), place)), error)
    np.testing.assert_allclose(in_ego, error, atol=1e-9)  # a circle is a circle
    turned = ray_covariance(variance * factor[label], place)
    axes = np.stack([along_and_across(unit, place) for unit in np.eye(2)], axis=1)
    measured = consistency(np.einsum("nij,nj->ni", axes, error), turned)
    assert measured["NIS"] == pytest.approx(2.0, abs=1e-6)
    assert measured["coverage95"] == pytest.approx(0.95, abs=0.01)
    assert measured["matches"] == len(error)
    overconfident = consistency(np.einsum("nij,nj->ni", axes, error), turned / 3)
    assert overconfident["NIS"] == pytest.approx(6.0)
    assert overconfident["NLL"] > measured["NLL"]


def test_a_class_with_few_matches_gets_the_scale_of_all():
    error, variance, label = errors()
    rare = np.where(np.arange(len(label)) < LEAST_MATCHES - 1, 2, label)
    scales = fit_scales(error, variance, rare, num_classes=4)
    everything = (error**2 / variance).mean(axis=0)
    np.testing.assert_allclose(scales.factor[2:], [everything, everything])
    assert scales.matches[2:].tolist() == [LEAST_MATCHES - 1, 0]


def test_unknown_errors_do_not_count_and_without_any_nothing_is_scaled():
    error, _variance, label = errors()
    holes = np.concatenate([error, np.full((50, 2), np.nan)])
    with_holes = fit_scales(holes, np.ones((4050, 2)), np.append(label, [0] * 50), num_classes=2)
    np.testing.assert_allclose(with_holes.factor, fit_scales(error, np.ones((4000, 2)), label, num_classes=2).factor)
    none = fit_scales(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, int), num_classes=2)
    np.testing.assert_array_equal(none.factor, np.ones((2, 2)))
    assert consistency(np.zeros((0, 2)), np.zeros((0, 2, 2)))["NIS"] is None


def test_no_scale_is_absurd():
    absurd = fit_scales(np.full((40, 2), 1e6), np.ones((40, 2)), np.zeros(40, int), num_classes=1)
    assert absurd.factor.max() == 1e2
