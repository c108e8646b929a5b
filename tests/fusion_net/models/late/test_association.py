"""Who is whose partner: the lesson's example, crowds, classes, and the association that knows the labels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.boxes import Boxes
from fusion_net.models.late.association import associate, match_to_labels, same_truth
from fusion_net.models.late.covariance import ray_covariance


def cov_of(*variances):
    return np.array([np.diag(v) for v in variances], float).reshape(-1, 2, 2)


def boxes(xy, label=None, score=None) -> Boxes:
    n = len(xy)
    center = np.concatenate([np.reshape(xy, (n, 2)), np.zeros((n, 1))], axis=1)
    label = np.zeros(n, np.int64) if label is None else np.array(label)
    score = np.linspace(0.9, 0.1, n) if score is None else np.array(score)
    return Boxes(center, np.ones((n, 3)), np.zeros(n), np.zeros((n, 2)), label, score, np.zeros((n, 2)))


def test_the_cars_of_the_lesson_are_one():
    """Camera: car at (30, 2), LiDAR: car at (30.4, 1.8)."""
    camera, lidar = ray_covariance([2.25, 0.09], [30.0, 2.0]), ray_covariance([0.04, 0.04], [30.4, 1.8])
    assert associate([[30, 2]], camera[None], [[30.4, 1.8]], lidar[None]).tolist() == [[0, 0]]
    assert not len(associate([[30, 2]], camera[None], [[30.4, 4.8]], lidar[None]))  # the next lane's


def test_the_nearest_in_metres_is_not_always_the_partner():
    """A radar's blob is wide across: 1.5 m beside it is nearer, in its terms, than 1 m behind it."""
    radar = ray_covariance([0.04, 2.25], [20.0, 0.0])[None]
    candidates = np.array([[21.0, 0.0], [20.0, 1.5]])
    pairs = associate([[20, 0]], radar, candidates, cov_of((0.01, 0.01), (0.01, 0.01)))
    assert pairs.tolist() == [[0, 1]]


def test_the_assignment_is_the_best_of_all_not_the_first_that_comes():
    """Two in a row, the second list shifted by 0.6: greedy would take the middle pair and leave the outer ones single."""
    a, b = np.array([[10.0, 0], [11.0, 0]]), np.array([[10.6, 0], [11.6, 0]])
    pairs = associate(a, cov_of((0.05, 0.05), (0.05, 0.05)), b, cov_of((0.05, 0.05), (0.05, 0.05)))
    assert pairs.tolist() == [[0, 0], [1, 1]]


def test_classes_do_not_mix():
    same, unit = np.array([[5.0, 5], [9, 9]]), cov_of((1, 1), (1, 1))
    assert associate(same, unit, same, unit, label_a=[0, 1], label_b=[0, 2]).tolist() == [[0, 0]]


@pytest.mark.parametrize(("first", "second"), [(0, 0), (0, 3), (3, 0)])
def test_empty_lists_have_no_partners(first, second):
    a, b = np.zeros((first, 2)), np.zeros((second, 2))
    assert associate(a, cov_of(*[(1, 1)] * first), b, cov_of(*[(1, 1)] * second)).shape == (0, 2)


def test_a_covariance_that_is_none_is_refused():
    with pytest.raises(ValueError, match="associate, second list: 1 of 1 covariances"):
        associate([[0, 0]], cov_of((1, 1)), [[0, 0]], cov_of((1, -1)))


def test_as_many_covariances_as_means_and_numbers_in_them():
    with pytest.raises(ValueError, match=r"first list: means \(2, 2\) want covariances \(2, 2, 2\), not \(1, 2, 2\)"):
        associate([[0, 0], [1, 1]], cov_of((1, 1)), [[0, 0]], cov_of((1, 1)))
    with pytest.raises(ValueError, match="second list: 1 numbers of the means are not finite"):
        associate([[0, 0]], cov_of((1, 1)), [[np.nan, 0]], cov_of((1, 1)))


def test_one_covariance_may_be_that_of_a_whole_list():
    first, second = [[0, 0], [9, 0], [30, 0]], [[9.5, 0], [0.5, 0]]
    own = associate(first, cov_of(*[(1, 4)] * 3), second, cov_of(*[(1, 4)] * 2))
    assert own.tolist() == [[0, 1], [1, 0]]
    np.testing.assert_array_equal(associate(first, np.diag([1.0, 4]), second, np.diag([1.0, 4])), own)


points = st.lists(st.tuples(st.floats(0, 30), st.floats(-10, 10)), min_size=1, max_size=8)


@given(points, points, st.randoms(use_true_random=False))
@settings(max_examples=30)
def test_the_order_of_either_list_and_of_the_lists_does_not_matter(first, second, random):
    """Ties aside: coordinates are made distinct."""
    a = np.array(first) + 1e-3 * np.arange(len(first))[:, None]
    b = np.array(second) + 1.7e-3 * np.arange(len(second))[:, None]
    A, B = cov_of(*[(0.3, 0.5)] * len(a)), cov_of(*[(1.0, 0.2)] * len(b))
    pairs = associate(a, A, b, B)
    assert len(set(pairs[:, 0])) == len(set(pairs[:, 1])) == len(pairs)

    def cost(found):
        difference = a[found[:, 0]] - b[found[:, 1]]
        return (difference**2 / [1.3, 0.7]).sum() - 9.21034037 * len(found)

    order = list(range(len(a)))
    random.shuffle(order)
    shuffled = associate(a[order], A, b, B)
    shuffled[:, 0] = np.array(order)[shuffled[:, 0]]
    assert cost(shuffled) == pytest.approx(cost(pairs), abs=1e-6)
    assert cost(associate(b, B, a, A)[:, ::-1]) == pytest.approx(cost(pairs), abs=1e-6)


def test_labels_are_taken_as_the_metric_takes_them():
    labels = boxes([[10, 0], [20, 0]], label=[0, 1])
    found = boxes([[10.9, 0], [10.1, 0], [20, 1], [20, 9], [10, 0]], label=[0, 0, 1, 1, 1])
    assert match_to_labels(found, labels, distance=4.0).tolist() == [0, -1, 1, -1, -1]
    assert match_to_labels(found, boxes(np.zeros((0, 2))), distance=4.0).tolist() == [-1] * 5
    assert not len(match_to_labels(boxes(np.zeros((0, 2))), labels, distance=4.0))


def test_the_oracle_pairs_what_took_the_same_truth():
    assert same_truth(np.array([2, -1, 0]), np.array([-1, 0, 1, 2])).tolist() == [[0, 3], [2, 1]]
    assert same_truth(np.array([], int), np.array([1])).shape == (0, 2)
