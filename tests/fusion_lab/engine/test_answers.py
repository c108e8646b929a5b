"""From a state to what the network answers."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from fusion_lab.engine.answers import Lab
from fusion_lab.engine.detectors import offered
from fusion_lab.engine.state import first_state
from fusion_net.common.nuscenes_format import MODALITIES
from tests.fixtures.training_setup import SMALL
from tests.fixtures.untrained_run import write_run


@pytest.fixture
def state(lab):
    return replace(first_state(lab.offer), threshold=0.05, frame=1)


def test_the_offer_is_what_there_is(lab):
    assert lab.offer.levels == ("mid",)
    assert len(lab.offer.layouts) == 2
    assert lab.offer.frames == 2
    assert next(iter(lab.offer.conditions)) == "clear"
    assert lab.offer.beams == (32, 16, 8, 4)


@pytest.mark.parametrize("modality", MODALITIES)
def test_a_dead_sensor_is_absent_and_the_labels_stay(lab, state, modality):
    plain, broken = lab.answer(state), lab.answer(replace(state, **{modality: "dead"}))
    assert plain.sample.present.all()
    assert broken.sample.present.tolist() == [name != modality for name in MODALITIES]
    assert modality not in broken.seen.maps
    np.testing.assert_array_equal(broken.sample.boxes.center, plain.sample.boxes.center)
    assert broken.plain == plain.score


def test_weather_changes_every_sensor_and_not_the_labels(lab, state):
    plain, fog = lab.answer(state), lab.answer(replace(state, condition="fog", severity=3))
    assert (fog.sample.images != plain.sample.images).any()
    assert len(fog.sample.lidar_points) != len(plain.sample.lidar_points)
    assert fog.score.objects == plain.score.objects


def test_fewer_beams_are_fewer_points(lab, state):
    counts = [len(lab.answer(replace(state, beams=beams)).sample.lidar_points) for beams in lab.offer.beams]
    assert sorted(counts, reverse=True) == counts
    assert counts[-1] < counts[0] / 4


def test_the_exact_depth_is_another_answer(lab, state):
    learned, exact = lab.answer(state), lab.answer(replace(state, depth="oracle"))
    assert (learned.found.score[:5] != exact.found.score[:5]).any()


def test_the_threshold_decides_what_is_shown_and_not_what_is_found(lab, state):
    low, high = lab.answer(state), lab.answer(replace(state, threshold=0.95))
    assert len(low.found) == len(high.found)
    assert len(high.shown) < len(low.shown)
    assert high.score.mAP == low.score.mAP


def test_what_one_state_set_is_gone_in_the_next(lab, state):
    before = lab.answer(state)
    lab._found.clear()
    lab.answer(replace(state, depth="uniform", camera="blinded", degrees=3.0))
    after = lab.answer(state)
    np.testing.assert_array_equal(after.found.score, before.found.score)


def test_the_comparison_is_left_out_only_where_the_network_would_have_to_run_for_it(lab, state):
    lab._found.clear()
    broken = replace(state, radar="dead")
    assert lab.answer(broken, compared=False).plain is None
    assert lab.answer(broken).plain is not None
    assert lab.answer(replace(state, lidar="dead"), compared=False).plain is not None


def test_the_score_of_the_scene_has_no_change_where_nothing_is_wrong(lab, state):
    for frame in range(lab.offer.frames):
        lab.look(replace(state, frame=frame))
    now, before = lab.scene_score(state)
    assert now == before


def test_without_exact_depth_the_oracle_is_refused_with_the_reason(lab, studio, tmp_path, state):
    shutil.copytree(studio.root, tmp_path / "bare")
    for path in (tmp_path / "bare").rglob("*.depth.png"):
        path.unlink()
    job = replace(studio.job, data=replace(studio.job.data, root=str(tmp_path / "bare")))
    trained = next(iter(lab._detectors.values())).trained
    bare = Lab(type(studio)(job, studio.conditions), {"mid": trained})
    assert bare.no_depth(state) == {"oracle": "this data set has no exact depth"}
    assert lab.no_depth(state) == {}
    with pytest.raises(ValueError, match="oracle needs dense depth"):
        bare.answer(replace(state, depth="oracle"))


def test_without_any_weights_a_line_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setattr("fusion_lab.engine.detectors.SHIPPED", tmp_path)
    with pytest.raises(FileNotFoundError, match=r"train.py name=mine.*fusion_lab run=runs/mine"):
        offered([], "best")


def test_runs_of_one_level_go_by_their_folders_and_those_of_other_sensors_are_refused(monkeypatch, tmp_path):
    monkeypatch.setattr("fusion_lab.engine.detectors.SHIPPED", tmp_path)
    one, two = (write_run(tmp_path / name, *SMALL) for name in ("one", "two"))
    other = write_run(tmp_path / "other", *SMALL, "data=surround")
    assert list(offered([str(one), str(two)], "best")) == ["mid", "two"]
    with pytest.raises(ValueError, match="name runs of one data set"):
        offered([str(one), str(other)], "best")
