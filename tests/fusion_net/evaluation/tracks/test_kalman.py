"""The filter against physics, against the Riccati equation, and on simulated motion."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

from fusion_net.evaluation.tracks.kalman import PLACE, VELOCITY, Motion
from fusion_net.models.late.covariance import mahalanobis_squared
from fusion_net.models.late.merging import covariance_intersection, information

PERIOD = 0.5


def motion(place, velocity, *, sigma=1.0) -> Motion:
    return Motion(np.array([[*place, *velocity]], float), sigma**2 * np.eye(4)[None])


def isotropic(variance, count=1):
    return np.tile(variance * np.eye(2), (count, 1, 1))


def test_a_car_at_20_m_per_s_is_a_metre_further_after_50_ms():
    later = motion((30.0, 2.0), (20.0, 0.0)).predict(0.05, np.array([4.0]))
    np.testing.assert_allclose(later.mean, [[31.0, 2.0, 20.0, 0.0]])


def test_velocity_spreads_with_the_root_of_time_and_place_with_its_power_of_three_halves():
    """White noise of acceleration of density q: variances q t and q t^3 / 3."""
    start = Motion(np.zeros((1, 4)), np.zeros((1, 4, 4)))
    for seconds in (0.5, 2.0):
        cov = start.predict(seconds, np.array([3.0])).cov[0]
        np.testing.assert_allclose(np.diag(cov), np.repeat([3 * seconds**3 / 3, 3 * seconds], 2))


@given(st.floats(0.01, 3.0), st.floats(0.01, 3.0))
@settings(max_examples=30)
def test_two_short_steps_are_one_long_one(first, second):
    start, density = motion((1.0, -2.0), (3.0, 4.0)), np.array([2.0])
    once, twice = start.predict(first + second, density), start.predict(first, density).predict(second, density)
    np.testing.assert_allclose(once.mean, twice.mean, rtol=1e-9)
    np.testing.assert_allclose(once.cov, twice.cov, rtol=1e-9)


@pytest.mark.parametrize("measures_velocity", [False, True])
def test_the_covariance_settles_where_the_riccati_equation_says(measures_velocity):
    q, r, s = 4.0, 0.3, 1.5
    F = np.array([[1.0, PERIOD], [0.0, 1.0]])
    Q = q * np.array([[PERIOD**3 / 3, PERIOD**2 / 2], [PERIOD**2 / 2, PERIOD]])
    H = np.eye(2) if measures_velocity else np.array([[1.0, 0.0]])
    R = np.diag([r, s]) if measures_velocity else np.array([[r]])
    predicted = solve_discrete_are(F.T, H.T, Q, R)
    now = motion((0.0, 0.0), (0.0, 0.0), sigma=10.0)
    for _ in range(60):
        before = now.predict(PERIOD, np.array([q]))
        now = before.update(np.zeros((1, 2)), isotropic(r), PLACE)
        if measures_velocity:
            now = now.update(np.zeros((1, 2)), isotropic(s), VELOCITY)
    np.testing.assert_allclose(before.cov[0][np.ix_([0, 2], [0, 2])], predicted, rtol=1e-6)
    np.testing.assert_allclose(before.cov[0][np.ix_([1, 3], [1, 3])], predicted, rtol=1e-6)


def test_what_is_not_measured_is_left_as_it_is():
    start = Motion(np.arange(8.0).reshape(2, 4), np.tile(np.eye(4), (2, 1, 1)))
    after = start.update(np.array([[np.nan, np.nan], [9.0, 9.0]]), isotropic(1.0, 2), VELOCITY)
    np.testing.assert_array_equal(after.mean[0], start.mean[0])
    np.testing.assert_array_equal(after.cov[0], start.cov[0])
    np.testing.assert_allclose(after.mean[1], [4.0, 5.0, 7.5, 8.0])


def test_a_first_box_without_velocity_may_go_anywhere_at_its_class_s_speed():
    first = Motion.begin(
        np.zeros((2, 2)), isotropic(0.1, 2), np.array([[3.0, 1.0], [np.nan, np.nan]]), isotropic(2.0, 2),
        speed=np.full(2, 9.0),
    )  # fmt: skip
    np.testing.assert_array_equal(first.mean, [[0, 0, 3, 1], [0, 0, 0, 0]])
    np.testing.assert_allclose(first.cov[:, 2, 2], [2.0, 81.0])


def test_no_tracks_stay_no_tracks():
    none = Motion(np.zeros((0, 4)), np.zeros((0, 4, 4)))
    after = none.predict(0.5, np.zeros(0)).update(np.zeros((0, 2)), np.zeros((0, 2, 2)), PLACE)
    assert after.mean.shape == (0, 4)
    assert after.cov.shape == (0, 4, 4)


def simulated(count=4000, steps=12, q=3.0, r=0.4, seed=5):
    """True states of ``count`` objects after ``steps``, and two filters that saw them through noises of their own."""
    rng = np.random.default_rng(seed)
    F = np.eye(4)
    F[0, 2] = F[1, 3] = PERIOD
    Q = np.kron(q * np.array([[PERIOD**3 / 3, PERIOD**2 / 2], [PERIOD**2 / 2, PERIOD]]), np.eye(2))
    true = np.zeros((count, 4))
    density, noise = np.full(count, q), isotropic(r, count)
    filters = [
        Motion.begin(rng.normal(0, r**0.5, (count, 2)), noise, rng.normal(0, 1, (count, 2)), isotropic(1.0, count),
                     speed=np.ones(count))
        for _ in range(2)
    ]  # fmt: skip
    for _ in range(steps):
        true = true @ F.T + rng.multivariate_normal(np.zeros(4), Q, count)
        filters = [
            f.predict(PERIOD, density).update(true[:, :2] + rng.normal(0, r**0.5, (count, 2)), noise, PLACE)
            for f in filters
        ]
    return true, filters


def nees(mean, cov, true):
    """Mean squared normalised error: 4, the dimension, if the covariance is honest."""
    return mahalanobis_squared(mean - true, cov).mean()


def test_the_filter_is_as_wrong_as_it_says():
    true, filters = simulated()
    for each in filters:
        assert nees(each.mean, each.cov, true) == pytest.approx(4.0, abs=0.2)


def test_tracks_share_the_noise_of_the_motion_so_merging_them_as_independent_is_overconfident():
    true, (a, b) = simulated()
    assert nees(*information(a.mean, a.cov, b.mean, b.cov), true) > 4.6
    assert nees(*covariance_intersection(a.mean, a.cov, b.mean, b.cov), true) < 4.0
