"""The guide's experiments are states of the page."""

from dataclasses import replace
from urllib.parse import parse_qsl

from fusion_lab.engine.state import LabState, Offer, first_state, from_query
from fusion_lab.engine.steps import STEPS, state_of

CONDITIONS = {"clear": 1, "dusk_glare_spray": 3}
ALL, MID = (Offer(levels, ("exit",) * 4, 8, CONDITIONS) for levels in (("early", "mid", "late"), ("mid",)))


def test_there_are_six_and_each_is_a_link():
    assert len(STEPS) == 6
    for number in range(1, 7):
        state, note = state_of(number, first_state(ALL), ALL)
        assert not note
        query = dict(parse_qsl(state.query()))
        assert from_query(query, ALL) == (state, [])


def test_a_step_undoes_what_was_wrong_and_keeps_scene_and_keyframe():
    broken = replace(first_state(ALL), scene=3, frame=5, radar="dead", degrees=3.0, depth="uniform")
    state, _ = state_of(1, broken, ALL)
    assert (state.scene, state.frame) == (3, 5)
    assert replace(state, step=0) == replace(first_state(ALL), scene=3, frame=5)


def test_without_the_weights_of_a_level_the_step_says_so():
    state, note = state_of(2, first_state(MID), MID)
    assert state.level == "mid"
    assert "no weights of early fusion" in note


def test_the_steps_that_belong_together_differ_in_the_level_alone():
    states = [state_of(number, LabState(), ALL)[0] for number in range(1, 7)]
    for early, late in ((states[1], states[2]), (states[3], states[4])):
        assert replace(early, level="late", step=0) == replace(late, step=0)
