"""Tracks of three sensors become one list whose names last."""

import numpy as np
import pytest

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.tracks.track_fusion import FusedTracks, TrackFusion
from fusion_net.evaluation.tracks.tracks import Tracks
from fusion_net.models.late.estimates import Estimates
from tests.fixtures.tracking import follow, seen

SIGMA = {"camera": 0.8, "lidar": 0.2, "radar": 0.5}


FUSION = TrackFusion(gate=0.99, keep_gate=0.9999, score="noisy_or", prior=0.5)


def fuse(by_sensor, **tracker):
    """The fused lists of a scene. ``by_sensor``: places (N, 2) of each frame, or None where the sensor sees nothing."""
    lived = {
        name: follow(
            [Estimates.empty() if xy is None else seen(xy, (0, 0), sigma=SIGMA[name], sensors=[name]) for xy in frames],
            **tracker,
        )
        for name, frames in by_sensor.items()
    }
    state, next_number, states = FusedTracks.empty(), 0, []
    for k in range(len(next(iter(lived.values())))):
        now = {name: tracks[k] for name, tracks in lived.items()}
        state = FUSION(state, now, next_number=next_number)
        next_number = max(next_number, int(state.tracks.number.max(initial=-1)) + 1)
        states.append(state)
    return states


def numbers(states):
    return [sorted(state.tracks.number.tolist()) for state in states]


def test_three_sensors_that_see_one_car_give_one_track():
    states = fuse({name: [[(10.0, 0.0)]] * 4 for name in MODALITIES})
    assert numbers(states) == [[0]] * 4
    assert (states[-1].members >= 0).all()


def test_it_lies_where_the_surest_sensor_says_and_claims_no_more_certainty():
    states = fuse({"camera": [[(11.0, 0.0)]], "lidar": [[(10.0, 0.0)]]})
    tracks = states[0].tracks
    assert tracks.boxes.center[0, 0] == pytest.approx(10.0, abs=0.1)
    assert tracks.motion.cov[0, 0, 0] >= SIGMA["lidar"] ** 2 - 1e-9


def test_scores_add_up_as_of_independent_detectors():
    states = fuse({name: [[(10.0, 0.0)]] for name in ("camera", "lidar")})
    assert states[0].tracks.boxes.score[0] == pytest.approx(1 - 0.2 * 0.2)
    assert np.isnan(states[0].tracks.probability[0]).tolist() == [False, False, True]


def test_a_track_that_only_one_sensor_has_is_not_lost():
    states = fuse({"camera": [None] * 3, "lidar": [[(10.0, 0.0)]] * 3, "radar": [[(40.0, 5.0)]] * 3})
    assert numbers(states) == [[0, 1]] * 3


def test_the_name_outlives_the_sensor_that_gave_it():
    """LiDAR alone, then with radar, then radar alone: one object, one name."""
    car = [[(10.0, 0.0)]]
    states = fuse({"lidar": car * 4 + [None] * 6, "radar": [None] * 2 + car * 8}, max_misses=1)
    assert numbers(states) == [[0]] * 10
    assert states[-1].members[0].tolist() == [-1, -1, 0]


def test_a_sensor_that_comes_back_under_another_number_joins_its_object():
    car = [[(10.0, 0.0)]]
    states = fuse({"lidar": car * 3 + [None] * 3 + car * 3, "radar": car * 9}, max_misses=1)
    assert numbers(states) == [[0]] * 9
    assert states[-1].members[0].tolist() == [-1, 1, 0]


def test_members_that_part_are_two_objects_and_one_keeps_the_name():
    stays = [[(10.0, 0.0)]] * 10
    leaves = [[(10.0, 1.2 * k)] for k in range(10)]
    states = fuse({"lidar": stays, "radar": leaves})
    assert numbers(states)[0] == [0]
    assert numbers(states)[-1] == [0, 1]
    lidar = states[-1].tracks.number[states[-1].members[:, MODALITIES.index("lidar")] >= 0]
    assert lidar.tolist() == [0]


def test_two_that_turn_out_to_be_one_keep_the_older_name():
    comes = [[(10.0, max(0.0, 4.0 - k))] for k in range(9)]
    states = fuse({"radar": [[(10.0, 0.0)]] * 9, "camera": [None, None, *comes[2:]]})
    assert numbers(states)[0] == [0]
    assert numbers(states)[-1] == [0]


@pytest.mark.parametrize("sensors", [{}, {"lidar": Tracks.empty()}, dict.fromkeys(MODALITIES, Tracks.empty())])
def test_no_tracks_of_one_or_all_sensors_are_no_tracks(sensors):
    fused = FUSION(FusedTracks.empty(), sensors, next_number=3)
    assert len(fused.tracks) == 0


def test_every_name_is_given_once():
    rng = np.random.default_rng(1)
    frames = {name: [rng.uniform(0, 20, (6, 2)) for _ in range(12)] for name in MODALITIES}
    for state in fuse(frames):
        assert len(set(state.tracks.number.tolist())) == len(state.tracks)
        for column in state.members.T:
            used = column[column >= 0]
            assert len(set(used.tolist())) == len(used)


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match=r"keep_gate=0\.9 must be at least gate=0\.99"):
        TrackFusion(gate=0.99, keep_gate=0.9, score="max", prior=0.5)
