"""The tracking metric against cases worked by hand, and against the official devkit."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.evaluation.tracks.truth import TrackTruth
from fusion_net.metrics.sample_boxes import SampleBoxes
from fusion_net.metrics.track_boxes import TrackBoxes
from fusion_net.metrics.track_paths import Frames, without_holes
from fusion_net.metrics.track_results import read_tracks, write_tracks
from fusion_net.metrics.tracking import FIGURES, TRACKING_CLASSES, TrackingMetric
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.random_tree import SPLIT, make_tables, make_tracks, write_tree

ROOT = Path(__file__).parents[3]
GOLDEN = ROOT / "tests/fusion_net/golden/tracking_metric.json"
DEVKIT = ROOT / ".venv-devkit/bin/python"
needs_devkit = pytest.mark.skipif(not DEVKIT.exists(), reason="no .venv-devkit; make it with tools/devkit/setup.sh")


def tracks(*ways, label=0):
    """Tracks by (name, {frame: place}, score) or (name, {frame: place})."""
    rows = [(name, frame, xy, *(score or [1.0])) for name, way, *score in ways for frame, xy in way.items()]
    n = len(rows)
    center = np.array([[*np.broadcast_to(xy, 2), 1.0] for _, _, xy, _ in rows]).reshape(n, 3)
    boxes = Boxes(
        center, np.tile([2.0, 4.0, 1.5], (n, 1)), np.zeros(n), np.zeros((n, 2)), np.full(n, label),
        np.array([score for *_, score in rows], float), np.zeros((n, 2)),
    )  # fmt: skip
    sample = np.array([frame for _, frame, _, _ in rows], np.int64)
    table = SampleBoxes(boxes, sample, np.full(n, "", np.str_), np.full(n, -1))
    return TrackBoxes(table, np.array([name for name, *_ in rows], np.str_))


def frames(count=10, scenes=1):
    return Frames(np.repeat(np.arange(scenes), count), np.tile(500_000 * np.arange(count), scenes))


def along(numbers, y=0.0, speed=2.0):
    """A straight way through these frames."""
    return {k: (speed * k, y) for k in numbers}


def score(truth, found, count=10, **of_frames):
    metrics = TrackingMetric(classes=["car"])(truth, found, frames(count, **of_frames))
    return {name: metrics.total(name) for name in FIGURES}


TEN = range(10)
CAR = tracks(("a", along(TEN)))


def test_a_perfect_track():
    got = score(CAR, tracks(("t", along(TEN), 0.7)))
    assert got == pytest.approx(
        {"amota": 1, "amotp": 0, "recall": 1, "motar": 1, "gt": 10, "mota": 1, "motp": 0, "mt": 1, "ml": 0, "faf": 0, "tp": 10,
         "fp": 0, "fn": 0, "ids": 0, "frag": 0, "tid": 0, "lgd": 0}
    )  # fmt: skip


def test_another_name_halfway_is_one_switch_and_no_match():
    got = score(CAR, tracks(("t", along(range(5)), 0.7), ("u", along(range(5, 10)), 0.7)))
    assert (got["ids"], got["tp"], got["fn"], got["fp"], got["frag"]) == (1, 9, 0, 0, 0)
    assert got["mota"] == pytest.approx(0.9)
    assert got["recall"] == pytest.approx(1.0)


def test_lost_and_found_again_by_another_track():
    """Found late by a second, lost for two frames: one fragmentation, one switch; half a second and a whole one."""
    got = score(CAR, tracks(("t", along(range(1, 4)), 0.7), ("u", along(range(6, 10)), 0.7)))
    assert (got["ids"], got["frag"], got["fn"], got["tp"]) == (1, 1, 3, 6)
    assert (got["tid"], got["lgd"]) == (0.5, 1.0)
    assert (got["mt"], got["ml"]) == (0, 0)


def test_a_hole_in_a_track_is_filled_on_the_straight_line():
    way = {k: xy for k, xy in along(TEN).items() if k != 4}
    assert score(CAR, tracks(("t", way, 0.7)))["fn"] == 0
    assert score(tracks(("a", way)), tracks(("t", along(TEN), 0.7)))["fp"] == 0


def test_in_a_longer_hole_the_neighbours_weights_are_exchanged_as_in_the_devkit():
    """Frames 1 and 2 lie between places 0 and 9: on the line they would be 3 and 6."""
    paths = without_holes(tracks(("t", {0: (0.0, 0.0), 3: (9.0, 0.0)})), frames(4), mean_scores=True)
    np.testing.assert_allclose(paths.xy[:, 0], [0.0, 6.0, 3.0, 9.0])


def test_a_false_track_that_is_surer_than_the_true_one_costs_half():
    """Five false boxes at every recall: MOTAR = 1 - 5 / (r * 10) at the recall that is measured, 1."""
    false = along(range(5), y=30.0)
    assert score(CAR, tracks(("t", along(TEN), 0.5), ("f", false, 0.9)))["amota"] == pytest.approx(0.5)
    got = score(CAR, tracks(("t", along(TEN), 0.9), ("f", false, 0.5)))
    assert got["amota"] == pytest.approx(1.0), "a threshold above the false track's score leaves it out"


def test_recalls_that_no_threshold_reaches_count_as_worst():
    """Of two cars one is followed, half a metre off: 18 of the 40 recalls from 0.1 to 1 are at most 0.5."""
    two = tracks(("a", along(TEN)), ("b", along(TEN, y=20.0)))
    got = score(two, tracks(("t", along(TEN, y=0.5), 0.8)))
    assert got["amota"] == pytest.approx(18 / 40)
    assert got["amotp"] == pytest.approx((18 * 0.5 + 22 * 2.0) / 40)
    assert (got["mt"], got["ml"], got["fn"]) == (1, 1, 10)


def test_two_metres_are_too_far():
    assert score(CAR, tracks(("t", along(TEN, y=1.999), 0.8)))["tp"] == 10
    got = score(CAR, tracks(("t", along(TEN, y=2.0), 0.8)))
    assert (got["amota"], got["amotp"], got["fn"], got["ml"], got["tid"]) == (0.0, 2.0, 10, 1, 20.0)


def test_a_label_keeps_its_track_though_another_comes_nearer():
    other = {k: (2.0 * k, 1.5 - 0.3 * k if k < 5 else 0.1) for k in TEN}
    got = score(CAR, tracks(("t", along(TEN, y=0.4), 0.8), ("u", other, 0.8)))
    assert got["ids"] == 0


def test_names_mean_nothing_beyond_their_scene():
    truth = tracks(("a", along(range(10))), ("b", {k + 10: xy for k, xy in along(TEN).items()}))
    found = tracks(("t", {k: (2.0 * (k % 10), 0.0) for k in range(20)}, 0.8))
    got = score(truth, found, scenes=2)
    assert (got["ids"], got["tp"]) == (0, 20)


def test_nothing_found_and_nothing_there():
    nothing = tracks()
    assert score(CAR, nothing)["amota"] == 0.0
    assert score(CAR, nothing)["amotp"] == 2.0
    assert np.isnan(score(nothing, CAR)["amota"])
    assert np.isnan(score(nothing, nothing)["amota"])


def test_a_track_twice_in_a_sample_is_refused():
    with pytest.raises(ValueError, match="the track 't' is twice in one sample"):
        score(CAR, tracks(("t", along(TEN)), ("t", {3: (50.0, 0.0)})))


@given(st.randoms(use_true_random=False))
@settings(max_examples=20)
def test_the_order_of_boxes_and_the_names_of_tracks_do_not_matter(random):
    rng = np.random.default_rng(random.randrange(2**32))
    truth = tracks(*((f"a{i}", along(TEN, y=4.0 * i)) for i in range(4)))
    noise = rng.normal(0, 0.7, (4, 10))
    found = tracks(
        *(
            (f"t{i}", {k: (2.0 * k, 4.0 * i + noise[i, k]) for k in TEN if rng.random() < 0.8}, rng.uniform())
            for i in range(4)
        )
    )
    shuffled = found[rng.permutation(len(found))]
    renamed = TrackBoxes(shuffled.table, np.char.add("x", shuffled.track))
    first, second = score(truth, found), score(truth, renamed)
    np.testing.assert_allclose(list(second.values()), list(first.values()), rtol=1e-12)


def official(root, results):
    """Our official score of a result file over all samples of a tree."""
    tree = NuScenes(root)
    grid = BEVGrid(-8.0, 16.0, 0.0, 12.0, 0.8)  # the official score looks beyond
    truth = TrackTruth([(tree, token) for token in tree.split(SPLIT)], classes=CLASSES, grid=grid)
    return truth.official(read_tracks(results, tokens=truth.tokens, classes=CLASSES))


def assert_same_as_devkit(ours, summary):
    for name in FIGURES:
        theirs = [
            np.nan if value is None else value
            for value in (summary["label_metrics"][name][c] for c in TRACKING_CLASSES)
        ]
        np.testing.assert_allclose(list(ours.of(name).values()), theirs, atol=1e-9, err_msg=name)
        assert ours.total(name) == pytest.approx(summary[name], abs=1e-9), name


def test_golden_devkit_values(tmp_path):
    golden = json.loads(GOLDEN.read_text())
    write_tree(tmp_path, golden["tables"])
    (tmp_path / "tracks.json").write_text(json.dumps(golden["results"]))
    ours = official(tmp_path, tmp_path / "tracks.json")
    assert_same_as_devkit(ours, golden["summary"])
    assert 0.1 < ours.total("amota") < 0.9, "the golden case should be neither empty nor perfect"
    assert ours.total("ids") > 0


@pytest.mark.slow
@needs_devkit
@pytest.mark.parametrize("seed", [0, 2, 5])
def test_same_as_the_devkit(seed, tmp_path):
    rng = np.random.default_rng(seed)
    tables = make_tables(rng, scenes=3, keyframes=4 + 4 * seed, objects=60, absent="trailer")
    write_tree(tmp_path, tables)
    path = tmp_path / "tracks.json"
    path.write_text(json.dumps(make_tracks(tables, rng, unpredicted="bus", false=seed)))
    command = [DEVKIT, ROOT / "tools/devkit/score_tracks.py", "--root", tmp_path, "--split", SPLIT, "--results", path]
    subprocess.run([*command, "--json", tmp_path / "devkit.json"], check=True, env=os.environ | {"PYTHONPATH": ""})
    assert_same_as_devkit(official(tmp_path, path), json.loads((tmp_path / "devkit.json").read_text()))


def test_result_file_keeps_every_number(tmp_path):
    found = tracks(("t", along(range(3)), 0.25), ("u", along(range(2), y=9.0), 0.75))
    tokens = ["s0", "s1", "s2"]
    write_tracks(tmp_path / "tracks.json", found, tokens=tokens, classes=["car", "barrier"])
    back = read_tracks(tmp_path / "tracks.json", tokens=tokens, classes=["car"])
    order = np.lexsort([found.track, found.table.sample])
    assert back.track.tolist() == found.track[order].tolist()
    np.testing.assert_array_equal(back.table.boxes.center, found.table.boxes.center[order])
    with pytest.raises(ValueError, match="lacks 1 of 1 samples"):
        read_tracks(tmp_path / "tracks.json", tokens=["s9"])


def test_classes_that_nuscenes_does_not_track_are_not_written(tmp_path):
    write_tracks(
        tmp_path / "tracks.json", tracks(("t", along(TEN)), label=1), tokens=["s"] * 10, classes=["car", "barrier"]
    )
    assert json.loads((tmp_path / "tracks.json").read_text())["results"] == {"s": []}
