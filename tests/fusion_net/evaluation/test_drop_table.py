"""The drop table on an oracle whose faults are known: the mask reaches the model, the rows say what it lost."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import invert, transform, wrap_angle, yaw_of
from fusion_net.data.batch import Batch
from fusion_net.evaluation import drop_table as module
from fusion_net.evaluation.bootstrap import bootstrap_map, interval, resample_scenes
from fusion_net.evaluation.drop_table import SUBSETS, drop_table, predict
from fusion_net.evaluation.random_guess import random_guess
from fusion_net.evaluation.scoring import GroundTruth, score
from fusion_net.metrics.results import read_results, write_results
from fusion_net.models.threads import ThreadsBeside
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.random_tree import SPLIT, make_tables, write_tree

CLASSES = ["car", "pedestrian", "truck", "barrier"]
GRID = BEVGrid(-20.0, 44.0, -24.0, 40.0, 0.8)


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    root = tmp_path_factory.mktemp("tree")
    write_tree(root, make_tables(np.random.default_rng(5), scenes=6, keyframes=2, objects=60))
    return NuScenes(root)


@pytest.fixture(scope="module")
def truth(tree):
    return GroundTruth([(tree, token) for token in tree.split(SPLIT)], classes=CLASSES, grid=GRID)


def labels_in_ego(tree, token):
    """The labels of a sample that have points, in its ego frame, with the velocities that are unknown as zero."""
    global_T_ego = tree.global_T_ego(tree.reference(token))
    labels = tree.annotations(token, CLASSES)
    boxes = labels.boxes[labels.num_pts > 0]
    velocity = np.nan_to_num(boxes.velocity) @ global_T_ego[:2, :2]
    center, yaw = transform(invert(global_T_ego), boxes.center), wrap_angle(boxes.yaw - yaw_of(global_T_ego))
    return replace(boxes, center=center, yaw=yaw, velocity=velocity, score=np.linspace(1, 0.5, len(boxes)))


class Oracle:
    """Knows all with three sensors. Without LiDAR boxes are 0.7 m off, without radar they stand still, without camera
    trucks are cars."""

    def __init__(self, tree):
        self.tree, self.masks = tree, []

    def __call__(self, batch, present):
        self.masks.append(present.clone())
        return batch.tokens, present

    def decode(self, outputs):
        return [self._detect(token, mask.tolist()) for token, mask in zip(*outputs, strict=True)]

    def _detect(self, token, mask):
        boxes, (camera, lidar, radar) = labels_in_ego(self.tree, token), mask
        center = boxes.center + (0 if lidar else np.array([0.7, 0, 0]))
        velocity = boxes.velocity * (1 if radar else 0)
        label = boxes.label if camera else np.where(boxes.label == 2, 0, boxes.label)
        return replace(boxes, center=center, velocity=velocity, label=label)


def batches(tokens, size=5):
    """Batches without readings, the last sample's radar dead."""
    for i in range(0, len(tokens), size):
        part = tokens[i : i + size]
        present = torch.ones(len(part), 3, dtype=torch.bool)
        present[-1, 2] = i + size < len(tokens)
        empty = torch.zeros(0)
        yield Batch(part, *[empty] * 7, present, empty)


@pytest.fixture(scope="module")
def table(tree, truth):
    model = Oracle(tree)
    return drop_table(model, list(batches(truth.tokens[::-1])), truth, seed=1, resamples=50), model


class Beside(Oracle):
    """While it looks for boxes a window passes, in which another program takes a core."""

    def __init__(self, tree, cores):
        super().__init__(tree)
        self.cores, self.threads = cores, []

    def __call__(self, batch, present):
        self.threads.append(torch.get_num_threads())
        self.cores.others = 1.0
        self.cores.pass_time()
        return super().__call__(batch, present)


def test_beside_another_program_an_evaluation_takes_one_core(tree, truth, two_cores, monkeypatch, capsys):
    monkeypatch.setattr(module, "ThreadsBeside", partial(ThreadsBeside, measure=two_cores.measure))
    model = Beside(tree, two_cores)
    predict(model, batches(truth.tokens[:5]))
    assert model.threads[:5] == [2, 2, 2, 2, 1]  # a rehearsal and a measured pass of each subset, two windows
    assert set(model.threads[5:]) == {1}
    assert torch.get_num_threads() == 2
    assert "evaluation: other programs take 1.0 of 2 cores; goes on with 1 thread" in capsys.readouterr().err


def test_seven_rows_in_order(table):
    names = ["+".join(name[0].upper() for name in row["sensors"]) for row in table[0].rows]
    assert names == ["C+L+R", "C+L", "C+R", "L+R", "C", "L", "R"]
    assert table[0].random["sensors"] == []


def test_the_mask_reaches_the_model_and_keeps_dead_sensors_dead(table, truth):
    masks = table[1].masks[1:14:2] + table[1].masks[14:]  # the first batch is rehearsed
    for row, subset in enumerate(SUBSETS):
        seen = torch.cat(masks[row :: len(SUBSETS)])
        assert seen.shape == (len(truth.tokens), 3)
        np.testing.assert_array_equal(seen[:-1].all(0), [name in subset for name in ("camera", "lidar", "radar")])
        assert not seen[-1, 2]


def test_rows_say_what_each_sensor_gave(table):
    full, no_radar, no_lidar, no_camera = table[0].rows[:4]
    assert full["mAP"] == pytest.approx(1.0)
    assert full["mATE"] == pytest.approx(0, abs=1e-6)
    assert no_radar["mAP"] == pytest.approx(1.0)
    assert no_radar["mAVE"] > full["mAVE"] + 1
    assert no_lidar["mATE"] == pytest.approx(0.7)
    assert no_lidar["mAP"] == pytest.approx(0.75, abs=0.05)  # three of four thresholds; some boxes leave the grid
    assert no_camera["AP"]["truck"] == 0
    assert no_camera["delta_mAP"] == pytest.approx(no_camera["mAP"] - 1)
    assert no_camera["delta_mAP_ci95"][1] < 0
    assert full["delta_mAP_ci95"] == [0, 0]


def test_intervals_and_random_guess(table):
    for row in [*table[0].rows, table[0].random]:
        low, high = row["mAP_ci95"]
        assert 0 <= low <= row["mAP"] + 1e-9 or row is table[0].random
        assert low <= high <= 1 + 1e-9
    assert table[0].random["mAP"] < 0.1


def test_official_score_counts_what_the_model_does_not_know(table):
    full = table[0].rows[0]
    assert full["mAP_official"] == pytest.approx(0.4)  # four of ten classes, all of them found, on the grid or off


def test_result_file_scores_like_the_row(table, truth, tmp_path):
    write_results(tmp_path / "r.json", table[0].tables[2], tokens=truth.tokens, classes=CLASSES)
    read = read_results(tmp_path / "r.json", tokens=truth.tokens, classes=CLASSES)
    np.testing.assert_allclose(truth.official(read).NDS, table[0].rows[2]["NDS_official"], atol=1e-9)


def test_labels_are_on_the_grid_near_and_seen(truth, tree):
    counted = 0
    for token in truth.tokens:
        global_T_ego = tree.global_T_ego(tree.reference(token))
        labels = tree.annotations(token, CLASSES)
        xy = transform(invert(global_T_ego), labels.boxes.center)[:, :2]
        reach = np.array([50, 40, 50, 30])[labels.boxes.label]
        counted += (GRID.contains(xy) & (np.hypot(*xy.T) < reach) & (labels.num_pts > 0)).sum()
    assert counted == len(truth.labels) > 50


def test_a_sample_without_predictions_is_an_error(tree, truth):
    with pytest.raises(ValueError, match=f"no predictions for 2 of 12 samples, first {truth.tokens[0]}"):
        drop_table(Oracle(tree), list(batches(truth.tokens[2:])), truth, seed=1, resamples=2)


def test_score_of_nothing_is_zero(truth):
    assert score(truth, [Boxes.empty() for _ in truth.tokens]).NDS == 0


def test_random_guess_follows_the_seed_and_the_prior(truth):
    first, again, other = (random_guess(truth, rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first[3].center, again[3].center)
    assert not np.array_equal(first[3].center, other[3].center)
    assert all(GRID.contains(boxes.center[:, :2]).all() for boxes in first)
    assert abs(sum(map(len, first)) - len(truth.labels)) <= len(truth.tokens)


def test_scenes_are_drawn_whole():
    copies = resample_scenes(np.array(["b", "a", "b", "c"]), resamples=300, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(copies[:, 0], copies[:, 2])
    np.testing.assert_array_equal(copies[:, [0, 1, 3]].sum(1), 3)
    np.testing.assert_allclose(copies.mean(0), 1, atol=0.15)


def test_bootstrap_spread_is_that_of_the_mean_over_scenes(truth):
    """A detector that finds everything in half of the scenes and nothing in the others: recall is the share of scenes."""
    good = [i for i, scene in enumerate(truth.scenes) if scene <= "scene-0002"]
    table = truth.labels[np.isin(truth.labels.sample, good)]
    copies = resample_scenes(truth.scenes, resamples=200, rng=np.random.default_rng(0))
    draws = bootstrap_map(truth.metric, truth.matches(table), copies)
    low, high = interval(draws)
    assert low < 0.25
    assert high > 0.75
    assert 0.3 < draws.mean() < 0.6  # AP leaves out the first tenth of recall
