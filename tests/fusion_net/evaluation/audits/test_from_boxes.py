"""The audits that need nothing but boxes: which subset finds what, by sensor and by condition."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.audits.ablation import audit_ablation, label_scores
from fusion_net.evaluation.audits.conditions import audit_conditions
from fusion_net.evaluation.bootstrap import bootstrap_map, interval, resample_scenes
from fusion_net.evaluation.drop_table import SUBSETS, DropTable, describe
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.random_tree import SPLIT, make_tables, write_tree

CLASSES = ["car", "pedestrian", "truck"]
GRID = BEVGrid(-40.0, 44.0, -44.0, 40.0, 0.8)


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    """Six scenes, every other one in fog."""
    root = tmp_path_factory.mktemp("tree")
    write_tree(root, make_tables(np.random.default_rng(5), scenes=6, keyframes=2, objects=60))
    path = next(root.glob("v1.0-*")) / "scene.json"
    scenes = json.loads(path.read_text())
    for number, scene in enumerate(scenes):
        scene["condition"] = {"name": "fog" if number % 2 else "clear", "severity": 1}
    path.write_text(json.dumps(scenes))
    tree = NuScenes(root)
    return [(tree, token) for token in tree.split(SPLIT)]


@pytest.fixture(scope="module")
def truth(samples):
    return GroundTruth(samples, classes=CLASSES, grid=GRID)


@pytest.fixture(scope="module")
def copies(truth):
    return resample_scenes(truth.scenes, resamples=20, rng=np.random.default_rng(0))


def seen(truth, kept):
    """The labels for which ``kept`` (N,) is true, as predictions."""
    boxes = truth.labels[kept]
    score = np.linspace(1, 0.5, len(boxes))
    return replace(boxes, boxes=replace(boxes.boxes, score=score, velocity=np.zeros((len(boxes), 2))))


def share(truth, fraction):
    """(N,) a share of the labels of each class and sample: the first ones."""
    return np.random.default_rng(1).permutation(len(truth.labels)) < fraction * len(truth.labels)


def drop_table(truth, copies, found_share):
    """What a detector's drop table holds that finds ``found_share[subset]`` of the labels."""
    tables = [seen(truth, share(truth, found_share[subset])) for subset in SUBSETS]
    matches = [truth.matches(table) for table in tables]
    resampled = np.stack([bootstrap_map(truth.metric, match, copies) for match in matches])
    rows = [
        {"sensors": list(subset)} | describe(truth.metric.summarise(match)) | {"mAP_ci95": interval(values)}
        for subset, match, values in zip(SUBSETS, matches, resampled, strict=True)
    ]
    return DropTable(rows, rows[0], tables, [], resampled)


def graceful(weight):
    """Shares of a detector that adds its sensors up."""
    return {subset: sum(weight[name] for name in subset) for subset in SUBSETS}


def test_a_detector_that_adds_its_sensors_up_is_ok(truth, copies):
    table = drop_table(truth, copies, graceful({"camera": 0.25, "lidar": 0.4, "radar": 0.3}))
    audit = audit_ablation(table, truth, encoders=MODALITIES)
    assert audit.ok, audit.verdict
    worth = [value["mAP"] for value in audit.numbers["shapley"].values()]
    assert sum(worth) == pytest.approx(table.rows[0]["mAP"])
    for example in audit.numbers["boxes"]:
        assert sum(example["shapley"].values()) == pytest.approx(example["scores"]["C+L+R"])


def test_a_network_that_leans_on_its_lidar_is_found_out(truth, copies):
    """The lesson's modality imbalance: fine with all, nothing without the dominant sensor."""
    shares = {subset: 0.9 if "lidar" in subset else 0.1 for subset in SUBSETS}
    audit = audit_ablation(drop_table(truth, copies, shares), truth, encoders=MODALITIES)
    assert not audit.ok
    assert "without LiDAR" in audit.verdict


def test_a_sensor_that_is_ignored_is_named(truth, copies):
    shares = {subset: 0.5 * ("lidar" in subset) + 0.4 * ("radar" in subset) for subset in SUBSETS}
    audit = audit_ablation(drop_table(truth, copies, shares), truth, encoders=MODALITIES)
    assert not audit.ok
    assert "camera is ignored" in audit.verdict
    assert audit_ablation(drop_table(truth, copies, shares), truth, encoders=("lidar", "radar")).ok


def test_one_sensor_alone_is_not_judged(truth, copies):
    table = drop_table(truth, copies, dict.fromkeys(SUBSETS, 0.5))
    assert audit_ablation(table, truth, encoders=("lidar",)).ok is None


def test_the_score_at_a_label_is_that_of_its_class_within_two_metres(truth):
    found = seen(truth, np.ones(len(truth.labels), bool))
    near = replace(found, boxes=replace(found.boxes, center=found.boxes.center + np.array([0.0, 1.9, 0.0])))
    assert (label_scores(truth, near) >= near.boxes.score).all()
    far = replace(found, boxes=replace(found.boxes, center=found.boxes.center + np.array([0.0, 0.0, 9.0])))
    np.testing.assert_array_equal(label_scores(truth, far), label_scores(truth, found))  # height does not count
    assert not label_scores(truth, found[:0]).any()


def in_fog(truth, samples):
    fog = np.array([nusc.scene(token)["condition"]["name"] == "fog" for nusc, token in samples])
    return fog[truth.labels.sample]


def test_a_detector_that_sees_nothing_in_fog_is_found_out(truth, samples, copies):
    fog = in_fog(truth, samples)
    tables = [seen(truth, ~fog | share(truth, 0.2))] * len(SUBSETS)
    audit = audit_conditions(truth, samples, tables, copies)
    assert not audit.ok
    assert "worst in fog" in audit.verdict
    assert audit.numbers["left"]["fog"] < 0.5
    assert [group["group"] for group in audit.numbers["range"]] == ["0-20 m", "20-35 m", "35-51 m"]
    assert sum(group["labels"] for group in audit.numbers["condition"]) == len(truth.labels)


def test_a_sensor_that_harms_in_fog_is_named(truth, samples, copies):
    fog, some = in_fog(truth, samples), share(truth, 0.7)
    tables = [seen(truth, np.ones(len(fog), bool) if "camera" not in subset else ~fog | some) for subset in SUBSETS]
    audit = audit_conditions(truth, samples, tables, copies)
    assert not audit.ok
    assert "better without camera" in audit.verdict


def test_a_detector_that_is_as_good_everywhere_is_ok(truth, samples, copies):
    tables = [seen(truth, share(truth, 0.9))] * len(SUBSETS)
    assert audit_conditions(truth, samples, tables, copies).ok


def test_clear_scenes_alone_are_not_judged(truth, samples, copies):
    clear = [pair for pair in samples if pair[0].scene(pair[1])["condition"]["name"] == "clear"]
    part = GroundTruth(clear, classes=CLASSES, grid=GRID)
    some = resample_scenes(part.scenes, resamples=5, rng=np.random.default_rng(0))
    assert audit_conditions(part, clear, [seen(part, share(part, 1))] * len(SUBSETS), some).ok is None
