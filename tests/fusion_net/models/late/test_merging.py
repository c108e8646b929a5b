"""What each rule claims of the merged error, measured on errors that were drawn with known correlations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from fusion_net.models.late.covariance import mahalanobis_squared, ray_covariance
from fusion_net.models.late.merging import (
    MERGES,
    MERGING,
    best,
    covariance_intersection,
    information,
    inverse_covariance_intersection,
)

CAMERA, LIDAR = ray_covariance([2.25, 0.09], [30.0, 2.0]), ray_covariance([0.04, 0.16], [30.4, 1.8])


def random_cov(rng, n, d=2):
    root = rng.normal(size=(n, d, d))
    return root @ root.swapaxes(1, 2) + 0.05 * np.eye(d)


def drawn(A, B, *, correlation, n=20_000, seed=0):
    """Errors of two sensors with these covariances, of which the shared part is ``correlation`` of each one's variance."""
    rng = np.random.default_rng(seed)
    shared = rng.normal(size=(n, 2))
    errors = []
    for P in (A, B):
        own = rng.normal(size=(n, 2))
        errors.append((correlation**0.5 * shared + (1 - correlation) ** 0.5 * own) @ np.linalg.cholesky(P).T)
    return errors


def nis(rule, correlation):
    a, b = drawn(CAMERA, LIDAR, correlation=correlation)
    mean, cov = rule(a, CAMERA, b, LIDAR)
    return mahalanobis_squared(mean, cov).mean()


def test_information_is_honest_only_where_errors_are_independent():
    assert nis(information, 0.0) == pytest.approx(2.0, abs=0.05)
    assert nis(information, 0.5) > 2.4
    assert nis(information, 0.9) > 2.7


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.6, 0.9, 1.0])
def test_covariance_intersection_is_never_overconfident(correlation):
    assert nis(covariance_intersection, correlation) < 2.05


def test_inverse_covariance_intersection_stands_between_them():
    det = {rule: np.linalg.det(rule(np.zeros(2), CAMERA, np.zeros(2), LIDAR)[1]) for rule in MERGING.values()}
    assert det[information] < det[inverse_covariance_intersection] < det[covariance_intersection] <= det[best]


def test_inverse_covariance_intersection_is_honest_about_information_that_both_hold():
    """Each sensor's own information, independent, and a common one that both have taken in already."""
    rng = np.random.default_rng(3)
    common, own = np.diag([0.5, 0.8]), (np.diag([0.3, 2.0]), np.diag([1.5, 0.4]))
    drawn_common = rng.normal(size=(20_000, 2)) @ np.sqrt(common)
    parts = [information(rng.normal(size=(20_000, 2)) @ np.sqrt(P), P, drawn_common, common) for P in own]
    (a, A), (b, B) = [(mean, np.broadcast_to(cov, (20_000, 2, 2))) for mean, cov in parts]
    for rule, honest in ((inverse_covariance_intersection, True), (information, False)):
        assert (mahalanobis_squared(*rule(a, A, b, B)).mean() < 2.02) == honest


def test_the_merged_cars_of_the_lesson():
    """Camera (30, 2), sharp across; LiDAR (30.4, 1.8), sharp along: the merged car is along the LiDAR's, across between."""
    mean, cov = information([30, 2], np.diag([2.25, 0.09]), [30.4, 1.8], np.diag([0.04, 0.09]))
    np.testing.assert_allclose(mean, [30.4 - 0.4 * 0.04 / 2.29, 1.9])
    np.testing.assert_allclose(cov, np.diag([2.25 * 0.04 / 2.29, 0.045]))
    mean, cov = covariance_intersection([30, 2], np.diag([2.25, 0.09]), [30.4, 1.8], np.diag([0.04, 0.09]))
    np.testing.assert_allclose(mean, [30.4, 1.8], atol=1e-6)  # the LiDAR knows no less in any direction
    np.testing.assert_allclose(cov, np.diag([0.04, 0.09]), atol=1e-6)


def test_omega_is_the_one_of_the_closed_form():
    """In the plane det(w A^-1 + (1 - w) B^-1) is a quadratic in w (Reinhardt, Noack & Hanebeck 2012)."""
    rng = np.random.default_rng(0)
    A, B = random_cov(rng, 200), random_cov(rng, 200)
    X, Y = np.linalg.inv(A), np.linalg.inv(B)
    D = X - Y
    adjugate = np.stack([np.stack([Y[:, 1, 1], -Y[:, 0, 1]], 1), np.stack([-Y[:, 1, 0], Y[:, 0, 0]], 1)], 1)
    linear, square = np.einsum("nij,nji->n", adjugate, D), np.linalg.det(D)
    ends = np.where(np.linalg.det(X) > np.linalg.det(Y), 1.0, 0.0)
    w = np.where(square < 0, np.clip(-linear / (2 * square), 0, 1), ends)[:, None, None]
    zero = np.zeros((200, 2))
    found = np.linalg.inv(covariance_intersection(zero, A, zero, B)[1])
    np.testing.assert_allclose(found, w * X + (1 - w) * Y, rtol=1e-4, atol=1e-4)


def test_stone_soup_merges_the_same():
    """``CovarianceIntersection.merge_components`` of stonesoup 1.9.1 with the weights under which its own determinant is least.
    Computed once: it would bring 80 MB into the environment, most of it plotly."""
    mean, cov = covariance_intersection(
        [30.0, 2.0], [[2.25, 0.3], [0.3, 0.09]], [30.4, 1.8], [[0.04, -0.02], [-0.02, 0.16]]
    )
    np.testing.assert_allclose(mean, [30.375012941, 1.944092996], atol=1e-6)
    np.testing.assert_allclose(cov, [[0.053034009, -0.007906321], [-0.007906321, 0.095770286]], atol=1e-6)


def test_states_of_four_dimensions_too_as_scipy_finds_them():
    rng = np.random.default_rng(1)
    A, B = random_cov(rng, 5, d=4), random_cov(rng, 5, d=4)
    a, b = rng.normal(size=(2, 5, 4))
    mean, cov = covariance_intersection(a, A, b, B)
    inverse_mean, inverse_cov = inverse_covariance_intersection(a, A, b, B)
    inv, det = np.linalg.inv, np.linalg.det
    for i in range(5):
        X, Y = inv(A[i]), inv(B[i])
        w = minimize_scalar(lambda w: -det(w * X + (1 - w) * Y), bounds=(0, 1), method="bounded").x  # noqa: B023
        P = inv(w * X + (1 - w) * Y)
        np.testing.assert_allclose(cov[i], P, rtol=1e-3, atol=1e-4)
        np.testing.assert_allclose(mean[i], P @ (w * X @ a[i] + (1 - w) * Y @ b[i]), rtol=1e-3, atol=1e-3)
        shared = lambda w: inv(w * A[i] + (1 - w) * B[i])  # noqa: B023, E731
        w = minimize_scalar(lambda w: -det(X + Y - shared(w)), bounds=(0, 1), method="bounded").x  # noqa: B023
        P = inv(X + Y - shared(w))
        np.testing.assert_allclose(inverse_cov[i], P, rtol=1e-3, atol=1e-4)
        expected = P @ ((X - w * shared(w)) @ a[i] + (Y - (1 - w) * shared(w)) @ b[i])
        np.testing.assert_allclose(inverse_mean[i], expected, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("merge", MERGES)
@given(seed=st.integers(0, 1000))
@settings(max_examples=15)
def test_every_rule_is_symmetric_moves_with_its_input_and_gains_nothing_from_one_estimate_alone(merge, seed):
    rule, rng = MERGING[merge], np.random.default_rng(seed)
    A, B = random_cov(rng, 3), random_cov(rng, 3)
    a, b = rng.normal(size=(2, 3, 2))
    mean, cov = rule(a, A, b, B)
    turned_mean, turned_cov = rule(b, B, a, A)
    np.testing.assert_allclose(turned_mean, mean, atol=1e-4)
    np.testing.assert_allclose(turned_cov, cov, atol=1e-4)
    moved, _ = rule(a + 7, A, b + 7, B)
    np.testing.assert_allclose(moved, mean + 7)
    one_by_one = [rule(a[i], A[i], b[i], B[i])[0] for i in range(3)]
    np.testing.assert_allclose(one_by_one, mean, atol=1e-9)
    assert (np.linalg.eigvalsh(cov) > 0).all()


@pytest.mark.parametrize("merge", MERGES)
def test_equal_covariances_meet_half_way_or_stay(merge):
    mean, cov = MERGING[merge]([0, 0], np.eye(2), [1, 0], np.eye(2))
    shrunk = 0.5 if merge == "information" else 1.0
    np.testing.assert_allclose(cov, shrunk * np.eye(2))
    np.testing.assert_allclose(mean, [0 if merge == "best" else 0.5, 0])


@pytest.mark.parametrize("merge", MERGES)
def test_nothing_to_merge_and_no_covariance(merge):
    mean, cov = MERGING[merge](np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    assert mean.shape == (0, 2)
    assert cov.shape == (0, 2, 2)
    with pytest.raises(ValueError, match="merge, second estimates: 1 of 1 covariances are not"):
        MERGING[merge]([[0, 0]], [np.eye(2)], [[0, 0]], [np.diag([1.0, 0.0])])
    with pytest.raises(ValueError, match=r"merge, first estimates: means \(1, 2\) want covariances \(1, 2, 2\), not"):
        MERGING[merge]([[0, 0]], [np.eye(3)], [[0, 0]], [np.eye(3)])
