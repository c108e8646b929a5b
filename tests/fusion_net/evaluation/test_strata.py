"""Groups of labels: who counts where, and that their scores are those of the parts."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.evaluation.bootstrap import resample_scenes
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.evaluation.strata import (
    NOWHERE,
    by_condition,
    by_range,
    by_visibility,
    condition_of,
    group_matches,
    score_groups,
)
from fusion_net.metrics.sample_boxes import stack
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.random_tree import SPLIT, make_tables, write_tree

CLASSES = ["car", "pedestrian", "truck"]
GRID = BEVGrid(-40.0, 44.0, -44.0, 40.0, 0.8)


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    """Six scenes, every other one at night."""
    root = tmp_path_factory.mktemp("tree")
    write_tree(root, make_tables(np.random.default_rng(5), scenes=6, keyframes=2, objects=60))
    path = next(root.glob("v1.0-*")) / "scene.json"
    scenes = json.loads(path.read_text())
    for number, scene in enumerate(scenes):
        scene["condition"] = {"name": "night" if number % 2 else "clear", "severity": 1 + number // 2}
    path.write_text(json.dumps(scenes))
    tree = NuScenes(root)
    return [(tree, token) for token in tree.split(SPLIT)]


@pytest.fixture(scope="module")
def truth(samples):
    return GroundTruth(samples, classes=CLASSES, grid=GRID)


@pytest.fixture(scope="module")
def found(truth):
    """The labels, up to 1.5 m off and scored at random, and as many false alarms."""
    rng = np.random.default_rng(0)
    labels = truth.labels
    boxes = labels.boxes
    moved = boxes.center + np.column_stack([rng.uniform(-1, 1, (len(labels), 2)), np.zeros(len(labels))])
    hits = replace(boxes, center=moved, score=rng.uniform(0.3, 1, len(labels)), velocity=np.zeros((len(labels), 2)))
    false = replace(hits, center=moved + np.array([9.0, 7.0, 0.0]), score=rng.uniform(0, 0.7, len(labels)))
    per_sample = [_joined(*(part[labels.sample == s] for part in (hits, false))) for s in range(len(truth.tokens))]
    return stack(per_sample, [np.full(len(b), "") for b in per_sample], [np.full(len(b), -1) for b in per_sample])


def _joined(*parts):
    names = ("center", "wlh", "yaw", "velocity", "label", "score", "log_variance")
    return Boxes(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def test_a_group_of_everything_has_the_score_of_the_whole(truth, found):
    copies = resample_scenes(truth.scenes, resamples=4, rng=np.random.default_rng(0))
    (all_of_it,) = score_groups(truth, found, replace(by_range(truth, ()), names=("all",)), copies)
    assert all_of_it.mAP == pytest.approx(truth.metric.summarise(truth.matches(found)).mAP)
    assert sum(all_of_it.num_gt.values()) == len(truth.labels)


def test_conditions_score_as_their_samples_alone(samples, truth, found):
    grouping = by_condition(truth, samples)
    assert grouping.names == ("clear", "night")
    night = np.array([condition_of(nusc.scene(token)) == "night" for nusc, token in samples])
    for matches, chosen in zip(group_matches(truth, found, grouping), (~night, night), strict=True):
        for match, whole in zip(matches, truth.matches(found), strict=True):
            expected = truth.metric.average_precision(whole, chosen.astype(int))
            np.testing.assert_allclose(truth.metric.average_precision(match), expected)


def test_severities_have_groups_of_their_own(samples, truth):
    names = by_condition(truth, samples, by_severity=True).names
    assert names[0] == "clear"
    assert set(names[1:]) <= {"night 1", "night 2", "night 3"}


def test_every_label_and_every_prediction_is_in_one_range(truth, found):
    parts = group_matches(truth, found, by_range(truth))
    for whole, *split in zip(truth.matches(found), *parts, strict=True):
        assert sum(part.num_gt.sum() for part in split) == whole.num_gt.sum()
        assert sum(len(part.score) for part in split) == len(whole.score)
        assert sum(part.hit.sum() for part in split) <= whole.hit.sum()
        assert (
            sum(part.hit[2].sum() for part in split) >= 0.97 * whole.hit[2].sum()
        )  # another label at another distance


def test_a_prediction_across_a_border_counts_where_its_label_is(truth):
    edge = float(np.median(np.linalg.norm(truth.in_ego(truth.labels)[:, :2], axis=1)))
    label = truth.labels
    outward = truth.in_ego(label)[:, :2]
    outward = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    center = label.boxes.center.copy()
    rotation = truth.global_T_ego[label.sample][:, :2, :2]
    center[:, :2] += 0.4 * np.einsum("nij,nj->ni", rotation, outward)
    pushed = replace(label, boxes=replace(label.boxes, center=center, velocity=np.zeros((len(label), 2))))
    near, far = group_matches(truth, pushed, by_range(truth, (edge,)))
    for match in (*near, *far):
        assert len(match.score) <= match.num_gt.sum()  # nothing came over the border


def test_false_alarms_count_in_every_visibility_and_unknown_labels_in_none(truth, found):
    grouping = by_visibility(truth)
    assert ((grouping.label == NOWHERE) == (truth.visibility == 0)).all()
    parts = group_matches(truth, found, grouping)
    false = [int((~match.hit.any(axis=0)).sum()) for match in truth.matches(found)]
    for matches in parts:
        for match, alarms in zip(matches, false, strict=True):
            assert (~match.hit.any(axis=0)).sum() >= alarms


def test_recorded_scenes_are_grouped_by_their_description():
    assert condition_of({"description": "Night, big street, pedestrians"}) == "night"
    assert condition_of({"description": "Rain, parking lot"}) == "rain"
    assert condition_of({"description": "Peds in sidewalk"}) == "clear"


def test_a_group_of_one_scene_has_no_interval(truth, samples, found):
    copies = resample_scenes(truth.scenes, resamples=20, rng=np.random.default_rng(0))
    groups = {
        each.name: each for each in score_groups(truth, found, by_condition(truth, samples, by_severity=True), copies)
    }
    assert {name: each.scenes for name, each in groups.items()} == {
        "clear": 3,
        "night 1": 1,
        "night 2": 1,
        "night 3": 1,
    }
    assert groups["clear"].row()["mAP_ci95"][0] < groups["clear"].mAP
    assert all(groups[f"night {severity}"].row()["mAP_ci95"] is None for severity in (1, 2, 3))
