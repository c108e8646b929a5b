"""The shape of a sensor's blur on the ground, and what is no covariance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, multivariate_normal

from fusion_net.models.late.covariance import (
    along_and_across,
    check_covariance,
    gate_of,
    gaussian_nll,
    mahalanobis_squared,
    ray_covariance,
    ray_variance,
)

PLACES = np.array([[20.0, 0.0], [0.0, 15.0], [12.0, -12.0], [3.0, 30.0]])


def test_a_radar_is_sharp_along_its_ray_and_blurred_across_wherever_it_looks():
    cov = ray_covariance(np.array([0.04, 4.0]), PLACES)
    along = PLACES / np.linalg.norm(PLACES, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    np.testing.assert_allclose(np.einsum("ni,nij,nj->n", along, cov, along), 0.04)
    np.testing.assert_allclose(np.einsum("ni,nij,nj->n", across, cov, across), 4.0)
    np.testing.assert_allclose(cov[0], [[0.04, 0], [0, 4.0]], atol=1e-12)
    np.testing.assert_allclose(cov[1], [[4.0, 0], [0, 0.04]], atol=1e-12)
    assert cov[2, 0, 1] > 1.9  # ahead and to the right: the ellipse leans from the far left to the near right


def test_it_has_the_spread_of_errors_that_were_drawn_in_range_and_bearing():
    rng = np.random.default_rng(0)
    distance, bearing = 30 + 0.2 * rng.normal(size=40_000), 0.6 + 0.03 * rng.normal(size=40_000)
    drawn = np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=1)
    place = 30 * np.array([np.cos(0.6), np.sin(0.6)])
    cov = ray_covariance([0.2**2, (30 * 0.03) ** 2], place)
    np.testing.assert_allclose(np.cov(drawn.T), cov, atol=0.02)


def test_straight_ahead_the_variances_of_the_head_are_those_along_and_across():
    np.testing.assert_allclose(ray_variance(np.log([0.3, 2.0]), [25.0, 0.0]), [0.3, 2.0])
    np.testing.assert_allclose(ray_variance(np.log([0.3, 2.0]), [0.0, 25.0]), [2.0, 0.3])
    np.testing.assert_allclose(ray_variance(np.log([0.3, 2.0]), [9.0, 9.0]), [1.15, 1.15])


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-9, 9), st.floats(-9, 9))
def test_parts_along_and_across_keep_length_and_a_place_at_the_origin_is_fine(x, y, u, v):
    parts = along_and_across([u, v], [x, y])
    assert np.hypot(*parts) == pytest.approx(np.hypot(u, v))
    assert along_and_across([x, y], [x, y])[1] == pytest.approx(0, abs=1e-9)


def test_distance_and_likelihood_are_those_of_the_textbook():
    rng = np.random.default_rng(1)
    for d in (2, 4):
        root = rng.normal(size=(6, d, d))
        cov, error = root @ root.swapaxes(1, 2) + 0.1 * np.eye(d), rng.normal(size=(6, d))
        expected = [e @ np.linalg.inv(P) @ e for e, P in zip(error, cov, strict=True)]
        np.testing.assert_allclose(mahalanobis_squared(error, cov), expected)
        expected = [-multivariate_normal(cov=P).logpdf(e) for e, P in zip(error, cov, strict=True)]
        np.testing.assert_allclose(gaussian_nll(error, cov), expected)


def test_the_gate_is_the_quantile_of_chi_squared():
    assert gate_of(0.99) == pytest.approx(chi2.ppf(0.99, 2))
    with pytest.raises(ValueError, match=r"gate=1\.5 is a probability"):
        gate_of(1.5)


@pytest.mark.parametrize(
    "wrong", [[[1, 2], [2, 1]], [[0, 0], [0, 1]], [[1, 0.5], [0, 1]], [[np.nan, 0], [0, 1]], [[-1, 0], [0, -1]]]
)
def test_what_is_no_covariance_is_named(wrong):
    with pytest.raises(ValueError, match=r"tracks: 1 of 3 covariances are not symmetric and positive .* number 1") as e:
        check_covariance([np.eye(2), wrong, np.eye(2)], "tracks")
    assert "\n" not in str(e.value)


def test_no_covariances_are_all_right():
    check_covariance(np.zeros((0, 2, 2)), "none")
