"""What becomes of the identities of boxes along ways that are known."""

import numpy as np
import pytest

from fusion_net.models.late.estimates import Estimates
from tests.fixtures.tracking import follow, seen, tracker


def numbers(tracks):
    """Identities by place."""
    return {
        tuple(center[:2].round(1)): number for center, number in zip(tracks.boxes.center, tracks.number, strict=True)
    }


def way(start, velocity, count=8, seconds=0.5):
    return np.asarray(start, float) + seconds * np.arange(count)[:, None] * np.asarray(velocity, float)


def test_a_car_keeps_its_number():
    lived = follow([seen(xy, (12.0, 0.0)) for xy in way((0, 0), (12, 0))])
    assert [tracks.number.tolist() for tracks in lived] == [[0]] * 8
    assert lived[-1].hits.tolist() == [8]
    np.testing.assert_allclose(lived[-1].boxes.velocity, [[12.0, 0.0]], atol=1e-6)


def test_velocity_is_learned_from_places_alone():
    lived = follow([seen(xy) for xy in way((0, 0), (12, -3), count=12)])
    assert [tracks.number.tolist() for tracks in lived] == [[0]] * 12
    np.testing.assert_allclose(lived[-1].boxes.velocity, [[12.0, -3.0]], atol=0.5)


@pytest.mark.parametrize("missed", [1, 2])
def test_a_track_survives_frames_in_which_it_is_not_seen(missed):
    frames = [seen(xy, (12.0, 0.0)) for xy in way((0, 0), (12, 0))]
    frames[4 : 4 + missed] = [Estimates.empty()] * missed
    lived = follow(frames)
    assert lived[-1].number.tolist() == [0]
    assert lived[4 + missed - 1].misses.tolist() == [missed]
    assert lived[4 + missed - 1].boxes.center[0, 0] == pytest.approx(
        6.0 * (4 + missed - 1), abs=1e-6
    )  # it moves on unseen


def test_it_ends_after_too_many_and_its_score_sinks_until_then():
    frames = [seen([(0, 0)], (0.0, 0.0)), *[Estimates.empty()] * 3, seen([(0, 0)], (0.0, 0.0))]
    lived = follow(frames, max_misses=2, decay=0.5)
    assert [tracks.number.tolist() for tracks in lived] == [[0], [0], [0], [], [1]]
    np.testing.assert_allclose([tracks.boxes.score[0] for tracks in lived[:3]], [0.8, 0.4, 0.2])


def test_two_crossing_cars_keep_their_numbers():
    """Both are at the crossing within a tenth of a second: a metre apart between keyframes."""
    ahead, left = way((-20, 0), (10, 0)), way((1.0, -20), (0, 10))
    lived = follow([seen([a, b], [(10.0, 0.0), (0.0, 10.0)]) for a, b in zip(ahead, left, strict=True)])
    first, last = numbers(lived[0]), numbers(lived[-1])
    assert first[(-20.0, 0.0)] == last[tuple(ahead[-1])]
    assert first[(1.0, -20.0)] == last[tuple(left[-1])]


def test_cars_that_pass_in_opposite_lanes_keep_their_numbers_without_any_velocity():
    east, west = way((-30, 0), (9, 0), 14), way((30, 3.5), (-9, 0), 14)
    lived = follow([seen([a, b]) for a, b in zip(east, west, strict=True)])
    assert numbers(lived[-1])[tuple(east[-1].round(1))] == numbers(lived[0])[(-30.0, 0.0)]
    assert len(lived[-1]) == 2


def test_a_car_is_not_continued_by_a_pedestrian():
    lived = follow([seen([(0, 0)], (0, 0), label=0), seen([(0, 0)], (0, 0), label=1)])
    assert sorted(lived[-1].number.tolist()) == [0, 1]


def test_what_is_far_beyond_the_gate_is_another_object():
    lived = follow([seen([(0, 0)], (0, 0)), seen([(15, 0)], (0, 0))])
    assert sorted(lived[-1].number.tolist()) == [0, 1]


def test_faint_boxes_continue_tracks_but_begin_none():
    lived = follow(
        [seen([(0, 0), (20, 0)], (0, 0), score=[0.8, 0.05]), seen([(0, 0)], (0, 0), score=0.05)], birth_score=0.1
    )
    assert [tracks.number.tolist() for tracks in lived] == [[0], [0]]
    assert lived[1].hits.tolist() == [2]


def test_tracks_are_shown_from_their_second_sight_on_if_one_asks_for_it():
    frames = [seen([(0, 0)], (0, 0)), seen([(0, 0)], (0, 0)), Estimates.empty(), seen([(0, 0)], (0, 0))]
    own = tracker(min_hits=2, shown_misses=0)
    assert [len(own.shown(tracks)) for tracks in follow(frames)] == [0, 1, 0, 1]
    own = tracker(min_hits=1, shown_misses=1)
    assert [len(own.shown(tracks)) for tracks in follow(frames)] == [1, 1, 1, 1]


def test_nothing_seen_is_no_tracks():
    assert [len(tracks) for tracks in follow([Estimates.empty()] * 3)] == [0, 0, 0]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"gate": 1.0}, "gate=1.0 is a probability"),
        ({"min_hits": 0}, "min_hits=0 must be at least 1"),
        ({"max_misses": -1}, "max_misses=-1 must be at least 0"),
        ({"decay": 1.5}, "decay=1.5 must be from 0 to 1"),
        ({"acceleration": {"car": 1.0}}, "acceleration of 'pedestrian' is not given; write a number above 0"),
        ({"speed": {"car": 1.0, "pedestrian": 0.0}}, "speed of 'pedestrian' is 0.0; write a number above 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(changes, said):
    with pytest.raises(ValueError, match=said):
        tracker(**changes)
