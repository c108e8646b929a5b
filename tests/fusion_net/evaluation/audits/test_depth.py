"""The camera's depth against the LiDAR's: right, too far and unsure."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fusion_net.evaluation.audits.depth import DepthCells, audit_depth, read_depths
from tests.fixtures.small_model import CLASSES, camera_encoder, small_batch

TOKENS = {"a": "clear", "b": "fog"}


def cells(ratio=1.0, *, count=400, entropy=0.3, label=-1):
    """Cells whose depth is found ``ratio`` times too large."""
    depth = np.random.default_rng(0).uniform(5, 50, count)
    token = np.where(np.arange(count) % 2, "a", "b")
    return DepthCells(
        ratio * depth,
        ratio * depth,
        depth,
        depth,
        np.full(count, entropy),
        np.full(count, 0.6),
        token,
        np.full(count, label),
    )


def audit(seen, objects=None):
    return audit_depth(seen, cells(count=0) if objects is None else objects, condition=TOKENS, classes=CLASSES)


def test_a_right_and_sharp_depth_is_ok():
    found = audit(cells())
    assert found.ok
    assert found.numbers["all"]["abs_rel"] == 0
    assert set(found.numbers["groups"]) == {"0-20 m", "20-35 m", "35-58 m", "clear", "fog"}
    assert found.numbers["exact"]["within_1.25^1"] == 1.0


def test_the_lessons_pedestrian_at_15_m_who_is_taken_for_25_m():
    person = replace(
        cells(25 / 15, count=1, label=1), lidar=np.array([15.0]), exact=np.array([15.0]), found=np.array([25.0])
    )
    found = audit(cells(1.1), person)
    assert "a pedestrian at 15 m was taken for 25 m" in found.verdict
    assert found.numbers["objects"]["too_far"] == 1.0
    assert found.numbers["objects"]["by_class"]["pedestrian"]["mean_error"] == pytest.approx(10.0)


def test_depths_that_are_a_third_too_large_are_wrong():
    found = audit(cells(4 / 3))
    assert not found.ok
    assert found.numbers["all"]["abs_rel"] == pytest.approx(1 / 3)


def test_a_flat_distribution_is_wrong_even_if_its_mean_is_right():
    assert not audit(cells(entropy=0.97)).ok


def test_too_few_returns_are_not_judged():
    assert audit(cells(count=10)).ok is None
    assert audit(replace(cells(), lidar=np.zeros(400))).ok is None
    assert [len(part.lidar) for part in read_depths(None, [small_batch()])] == [0, 0]


@pytest.mark.parametrize(("source", "ok"), [("uniform", False), ("oracle", True)])
def test_what_lifts_the_features_is_what_is_judged(source, ok):
    """``depth_source=uniform`` is the lesson's flat depth, ``oracle`` the truth, to half a bin."""
    batch = small_batch(8)
    depth = torch.rand(batch.lidar_depth.shape, generator=torch.Generator().manual_seed(0)) * 30 + 3
    batch = replace(batch, lidar_depth=depth, dense_depth=depth)
    seen, objects = read_depths(camera_encoder(depth_source=source).eval(), [batch])
    found = audit_depth(seen, objects, condition={}, classes=CLASSES)
    assert found.ok is ok, found.verdict
    assert found.numbers["all"]["entropy"] == pytest.approx(0.0 if ok else 1.0, abs=1e-5)
