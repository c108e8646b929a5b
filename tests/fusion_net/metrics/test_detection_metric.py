"""The metric against numbers made by hand, and against those of the official devkit."""

import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.metrics.detection import DetectionMetric
from fusion_net.metrics.matching import TP_ERRORS
from fusion_net.metrics.results import read_results
from fusion_net.metrics.sample_boxes import SampleBoxes, to_global
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.random_tree import RACK, SPLIT, make_results, make_tables, write_tree

ROOT = Path(__file__).parents[3]
GOLDEN = ROOT / "tests/fusion_net/golden/detection_metric.json"
DEVKIT = ROOT / ".venv-devkit/bin/python"
needs_devkit = pytest.mark.skipif(not DEVKIT.exists(), reason="no .venv-devkit; make it with tools/devkit/setup.sh")
DEVKIT_ERRORS = dict(zip(TP_ERRORS, ("trans_err", "scale_err", "orient_err", "vel_err", "attr_err"), strict=True))


def table(
    xy, *, sample=None, score=None, label=None, yaw=0.0, wlh=(2, 4, 1.5), velocity=(0, 0), attribute="a", num_pts=5
):
    """N boxes at ``xy``, all alike but for what is given."""
    n = len(xy)
    boxes = Boxes(
        center=np.column_stack([np.reshape(xy, (n, 2)), np.ones(n)]).astype(float),
        wlh=np.tile(wlh, (n, 1)).astype(float),
        yaw=np.full(n, yaw),
        velocity=np.tile(velocity, (n, 1)).astype(float),
        label=np.zeros(n, np.int64) if label is None else np.asarray(label),
        score=np.ones(n) if score is None else np.asarray(score, float),
        log_variance=np.zeros((n, 2)),
    )
    sample = np.zeros(n, np.int64) if sample is None else np.asarray(sample)
    return SampleBoxes(boxes, sample, np.full(n, attribute), np.full(n, num_pts))


def one_class(name="car", **settings):
    return DetectionMetric(classes=[name], **settings)


def devkit_like(root: Path, results: Path):
    """Our official score of a result file over all samples of a tree."""
    tree = NuScenes(root)
    grid = BEVGrid(-8.0, 16.0, 0.0, 12.0, 0.8)  # the official score looks beyond
    truth = GroundTruth([(tree, token) for token in tree.split(SPLIT)], classes=CLASSES, grid=grid)
    return truth.official(read_results(results, tokens=truth.tokens, classes=CLASSES))


def assert_same_as_devkit(ours, summary):
    for k, name in enumerate(CLASSES):
        np.testing.assert_allclose(ours.ap[k], list(summary["label_aps"][name].values()), atol=1e-9, err_msg=name)
        theirs = [summary["label_tp_errors"][name][error] for error in DEVKIT_ERRORS.values()]
        np.testing.assert_allclose(ours.errors[k], theirs, atol=1e-9, err_msg=name)
    assert ours.mAP == pytest.approx(summary["mean_ap"], abs=1e-9)
    assert pytest.approx(summary["nd_score"], abs=1e-9) == ours.NDS
    np.testing.assert_allclose(ours.mean_errors, [summary["tp_errors"][e] for e in DEVKIT_ERRORS.values()], atol=1e-9)


def test_golden_devkit_values(tmp_path):
    golden = json.loads(GOLDEN.read_text())
    write_tree(tmp_path, golden["tables"])
    (tmp_path / "results.json").write_text(json.dumps(golden["results"]))
    ours = devkit_like(tmp_path, tmp_path / "results.json")
    assert_same_as_devkit(ours, golden["summary"])
    assert 0.05 < ours.mAP < 0.95, "the golden case should be neither empty nor perfect"


def test_without_its_racks_the_golden_case_scores_otherwise(tmp_path):
    """Or else it would not test them."""
    golden = json.loads(GOLDEN.read_text())
    racks = {row["token"] for row in golden["tables"]["instance"] if row["category_token"] == RACK}
    kept = [row for row in golden["tables"]["sample_annotation"] if row["instance_token"] not in racks]
    assert len(kept) < len(golden["tables"]["sample_annotation"]) - 10
    write_tree(tmp_path, golden["tables"] | {"sample_annotation": kept})
    (tmp_path / "results.json").write_text(json.dumps(golden["results"]))
    assert abs(devkit_like(tmp_path, tmp_path / "results.json").mAP - golden["summary"]["mean_ap"]) > 1e-4


def test_golden_numbers_are_rounded_so_that_every_processor_writes_the_same():
    numbers = []
    json.loads(GOLDEN.read_text(), parse_float=numbers.append)
    assert all(float(text) == round(float(text), 9) for text in numbers)


@needs_devkit
@pytest.mark.slow
@pytest.mark.parametrize("core", ["", "Nehalem"])
def test_the_golden_file_is_what_its_script_writes(tmp_path, core):
    """With the processor's own vector instructions, and with those of 2008."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | ({"OPENBLAS_CORETYPE": core} if core else {})
    command = [DEVKIT, ROOT / "tools/devkit/make_golden.py", tmp_path / "golden.json"]
    subprocess.run([*map(str, command)], check=True, capture_output=True, env=environment)
    assert (tmp_path / "golden.json").read_bytes() == GOLDEN.read_bytes()


@needs_devkit
@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_live_devkit(tmp_path, seed):
    rng = np.random.default_rng(seed)
    tables = make_tables(rng, scenes=4, keyframes=3, objects=60)
    write_tree(tmp_path, tables)
    results = tmp_path / "results.json"
    results.write_text(json.dumps(make_results(tables, rng, boxes=120, empty=seed)))
    command = [DEVKIT, ROOT / "tools/devkit/score.py", "--root", tmp_path, "--split", SPLIT, "--results", results]
    subprocess.run([*map(str, command), "--json", str(tmp_path / "summary.json")], check=True, capture_output=True)
    assert_same_as_devkit(devkit_like(tmp_path, results), json.loads((tmp_path / "summary.json").read_text()))


def test_perfect_detections_score_one():
    truth = table(np.random.default_rng(0).uniform(-30, 30, (40, 2)), sample=np.repeat([0, 1, 2, 3], 10))
    score = one_class()(truth, truth, 4)
    assert score.mAP == pytest.approx(1.0)
    assert pytest.approx(1.0) == score.NDS
    np.testing.assert_allclose(score.errors, 0, atol=1e-12)


def test_average_precision_by_hand():
    """Ten labels; hit, miss, hit: recall 0.1, 0.1, 0.2 at precision 1, 1/2, 2/3, linear between, nothing beyond."""
    truth = table([(20.0 * i, 0) for i in range(10)])
    found = table([(0, 0), (10, 0), (20, 0)], score=[0.9, 0.8, 0.7])
    recall = np.arange(11, 21) / 100
    precision = 0.5 + (recall - 0.1) / 0.1 * (2 / 3 - 0.5)
    expected = (precision - 0.1).sum() / 90 / 0.9
    np.testing.assert_allclose(one_class()(truth, found, 1).ap[0], expected)


def test_threshold_is_strict_and_distances_differ():
    truth, found = table([(0, 0)]), table([(1.0, 0)])
    np.testing.assert_array_equal(one_class()(truth, found, 1).ap[0] > 0, [False, False, True, True])


def test_a_label_is_taken_once_and_the_second_takes_the_next():
    truth = table([(0, 0), (3, 0)])
    found = table([(0.1, 0), (0.2, 0), (0.3, 0)], score=[0.9, 0.8, 0.7])
    match = one_class().match(truth, found, 1)[0]
    np.testing.assert_array_equal(match.hit.sum(axis=1), [1, 1, 1, 2])  # only within 4 m is there a second label


def test_equal_scores_are_ranked_later_first():
    truth, found = table([(0, 0)]), table([(0.1, 0), (0.4, 0)], score=[0.5, 0.5])
    match = one_class().match(truth, found, 1)[0]
    np.testing.assert_array_equal(match.hit[0], [True, False])
    assert match.errors[0, 0] == pytest.approx(0.4)


def test_boxes_of_another_sample_do_not_match():
    assert one_class()(table([(0, 0)], sample=[0]), table([(0, 0)], sample=[1]), 2).mAP == 0


def test_errors_by_hand():
    truth = table([(0, 0)], yaw=3.0, velocity=(1, 1))
    found = table([(0.3, 0.4)], yaw=-3.0, wlh=(2.0, 4.0, 3.0), velocity=(4, 5), attribute="b")
    errors = one_class()(truth, found, 1).errors[0]
    np.testing.assert_allclose(errors, [0.5, 0.5, 2 * np.pi - 6, 5.0, 1.0])


def test_barrier_has_no_front_and_cone_no_heading():
    truth, found = table([(0, 0)], yaw=0.0), table([(0, 0)], yaw=np.pi - 0.1)
    barrier = one_class("barrier")(truth, found, 1).errors[0]
    np.testing.assert_allclose(barrier, [0, 0, 0.1, np.nan, np.nan], atol=1e-12)
    cone = one_class("traffic_cone")(truth, found, 1)
    np.testing.assert_array_equal(np.isnan(cone.errors[0]), [False, False, True, True, True])
    assert pytest.approx((5 + 2) / 10) == cone.NDS  # errors that no class defines score nothing


def test_unknown_velocity_and_attribute_are_left_out():
    truth = table([(0, 0), (20, 0)])
    velocity = np.array([[np.nan, np.nan], [0.0, 0.0]])
    truth = replace(truth, boxes=replace(truth.boxes, velocity=velocity), attribute=np.array(["", "a"]))
    found = table([(0, 0), (20, 0)], score=[0.8, 0.9], velocity=(3, 4), attribute="b")
    assert one_class()(truth, found, 1).errors[0, 3:] == pytest.approx([5.0, 1.0])
    nothing = replace(truth, boxes=replace(truth.boxes, velocity=velocity * np.nan), attribute=np.array(["", ""]))
    assert one_class()(nothing, found, 1).errors[0, 3:] == pytest.approx([1.0, 1.0])


def test_without_predictions_or_labels():
    none, some = table(np.zeros((0, 2))), table([(0, 0)])
    for truth, found in ((some, none), (none, some), (none, none)):
        score = one_class()(truth, found, 1)
        assert (score.mAP, score.NDS) == (0, 0)
        np.testing.assert_array_equal(score.errors, 1)


def test_relabel_drops_other_classes():
    boxes = table([(0, 0), (1, 0), (2, 0)], label=[0, 1, 2]).relabel(["car", "truck", "bus"], ["bus", "car"])
    np.testing.assert_array_equal(boxes.boxes.label, [1, 0])
    np.testing.assert_array_equal(boxes.boxes.center[:, 0], [0, 2])


def test_to_global_turns_heading_and_velocity():
    quarter = np.array([[0, -1, 0, 10], [1, 0, 0, 20], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    moved = to_global(table([(5, 1), (0, 0)], velocity=(2, 0)).boxes, quarter)
    np.testing.assert_allclose(moved.center[0], [9, 25, 1])
    np.testing.assert_allclose(moved.velocity[0], [0, 2], atol=1e-12)
    np.testing.assert_allclose(moved.yaw, np.pi / 2)


def test_class_without_range_is_refused():
    with pytest.raises(ValueError, match=r"'cra'.*car"):
        DetectionMetric(classes=["cra"])


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_copies_are_the_same_as_repeated_samples(seed):
    """A sample that counts twice is a sample that is there twice."""
    rng = np.random.default_rng(seed)
    truth = table(rng.uniform(0, 20, (12, 2)), sample=rng.integers(0, 3, 12))
    found = table(rng.uniform(0, 20, (30, 2)), sample=rng.integers(0, 3, 30), score=rng.permutation(30))
    copies = rng.integers(0, 3, 3)
    chosen = np.repeat(np.arange(3), copies)
    repeated = [
        replace(boxes[rows], sample=new) for boxes in (truth, found) for rows, new in [_repeat(boxes.sample, chosen)]
    ]
    metric = one_class()
    expected = metric(*repeated, len(chosen)).ap[0]
    got = metric.average_precision(metric.match(truth, found, 3)[0], copies)
    np.testing.assert_allclose(got, expected, atol=1e-12)


def _repeat(sample, chosen):
    rows = [np.flatnonzero(sample == old) for old in chosen]
    new = np.repeat(np.arange(len(chosen)), [len(r) for r in rows])
    return np.concatenate([np.zeros(0, np.int64), *rows]), new
