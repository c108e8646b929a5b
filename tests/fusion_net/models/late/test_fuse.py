"""Three lists become one: nothing is lost, a radar gives the speed, headings do not cancel."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.models.late.association import associate
from fusion_net.models.late.estimates import Estimates
from fusion_net.models.late.fuse import ORDER, fuse, merged_heading
from fusion_net.models.late.merging import MERGES
from fusion_net.models.late.scores import SCORES


def pair(a, b):
    return associate(
        a.boxes.center[:, :2], a.cov, b.boxes.center[:, :2], b.cov, label_a=a.boxes.label, label_b=b.boxes.label
    )


fuse = partial(fuse, pair=pair)
DEFAULT = {"merge": "covariance_intersection", "score": "noisy_or", "prior": 0.2}


def estimates(sensor, xy, *, yaw=0.0, velocity=(0.0, 0.0), var=(0.1, 0.1), velocity_var=(1.0, 1.0), score=0.5):
    n = len(xy)
    center = np.concatenate([np.reshape(xy, (n, 2)), np.zeros((n, 1))], axis=1)
    rows = (np.tile(np.asarray(x, float), (n, 1)) for x in (velocity, (2.0, 4.0, 1.5)))
    velocity, wlh = rows
    probability = np.full((n, len(MODALITIES)), np.nan)
    probability[:, MODALITIES.index(sensor)] = score
    boxes = Boxes(center, wlh, np.full(n, yaw), velocity, np.zeros(n, np.int64), np.full(n, score), np.zeros((n, 2)))
    return Estimates(
        boxes, np.tile(np.diag(var), (n, 1, 1)), np.tile(np.diag(velocity_var), (n, 1, 1)), probability, np.full(n, -1)
    )


def test_three_see_one_car():
    lists = {name: estimates(name, [[30 + 0.1 * i, 2.0]]) for i, name in enumerate(MODALITIES)}
    fused = fuse(lists, **DEFAULT)
    assert len(fused) == 1
    assert fused.boxes.score[0] == pytest.approx(1 - 0.5**3)
    assert 30 < fused.boxes.center[0, 0] < 30.2
    np.testing.assert_allclose(fused.boxes.log_variance, np.log(np.diagonal(fused.cov, axis1=1, axis2=2)))


def test_a_box_without_partner_is_kept_as_it_is():
    lists = {"lidar": estimates("lidar", [[10, 0], [20, 0]]), "camera": estimates("camera", [[20, 0], [40, 5]])}
    fused = fuse(lists, **DEFAULT)
    assert sorted(fused.boxes.center[:, 0]) == [10, 20, 40]
    assert fused.boxes.center[0, 0] == 20  # seen by two: first
    assert fused.boxes.score.tolist() == [0.75, 0.5, 0.5]


@pytest.mark.parametrize("there", [[], ["lidar"], ["radar", "camera"], [*ORDER]])
@pytest.mark.parametrize("merge", MERGES)
def test_empty_lists_from_any_sensors(there, merge):
    for score in SCORES:
        nothing = {name: Estimates.empty() for name in there}
        assert len(fuse(nothing, merge=merge, score=score, prior=0.3)) == 0
        one = nothing | {"radar": estimates("radar", [[8, 1]])}
        assert len(fuse(one, merge=merge, score=score, prior=0.3)) == 1


places = st.lists(st.tuples(st.floats(5, 25), st.floats(-8, 8)), max_size=6)


@given(st.tuples(places, places, places), st.sampled_from(MERGES), st.permutations(MODALITIES))
@settings(max_examples=25)
def test_the_order_in_which_the_lists_come_does_not_matter_and_none_is_lost(found, merge, order):
    lists = {name: estimates(name, np.reshape(xy, (-1, 2))) for name, xy in zip(MODALITIES, found, strict=True)}
    fused = fuse(lists, merge=merge, score="bayes", prior=0.2)
    again = fuse({name: lists[name] for name in order}, merge=merge, score="bayes", prior=0.2)
    np.testing.assert_array_equal(fused.boxes.center, again.boxes.center)
    assert np.isfinite(fused.probability).sum() == sum(map(len, found))  # every box has a part in just one
    assert (np.diff(fused.boxes.score) <= 0).all()


@pytest.mark.parametrize("merge", ["covariance_intersection", "information"])
def test_the_speed_is_the_radars_where_it_knows_more(merge):
    lidar = estimates("lidar", [[20, 0]], velocity=(0, 0), velocity_var=(9.0, 9.0))
    radar = estimates("radar", [[20, 0.5]], velocity=(8, 1), velocity_var=(0.04, 4.0), var=(0.1, 1.0))
    fused = fuse({"lidar": lidar, "radar": radar}, merge=merge, score="max", prior=0.2)
    assert fused.boxes.velocity[0, 0] == pytest.approx(8, abs=0.1)


def test_headings_that_point_the_other_way_are_flipped_first():
    lidar, camera = estimates("lidar", [[20, 0]], yaw=0.1), estimates("camera", [[20, 0]], yaw=np.pi - 0.1)
    fused = fuse({"lidar": lidar, "camera": camera}, **DEFAULT)
    assert fused.boxes.yaw[0] == pytest.approx(0, abs=0.05)


@given(st.floats(-3.2, 3.2), st.floats(-3.2, 3.2), st.floats(0, 1))
@settings(max_examples=25)
def test_a_merged_heading_lies_between_the_axes_and_points_where_the_surer_one_does(a, b, share):
    merged = merged_heading(np.array([a]), np.array([b]), np.array([share]))[0]
    apart = abs((b - a + np.pi / 2) % np.pi - np.pi / 2)
    off = [abs((merged - yaw + np.pi / 2) % np.pi - np.pi / 2) for yaw in (a, b)]
    assert off[0] <= apart + 1e-6
    assert off[1] <= apart + 1e-6
    assert np.cos(merged - (a if share >= 0.5 else b)) >= -1e-6


def test_the_best_keeps_one_box_whole():
    lidar = estimates("lidar", [[20, 0]], yaw=0.3, var=(0.01, 0.01))
    camera = estimates("camera", [[20.5, 0]], yaw=1.0, var=(4.0, 0.2))
    fused = fuse({"camera": camera, "lidar": lidar}, merge="best", score="max", prior=0.2)
    assert fused.boxes.center[0].tolist() == [20, 0, 0]
    assert fused.boxes.yaw[0] == pytest.approx(0.3)
