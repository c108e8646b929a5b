"""A state is its link, and what it does to the sensors is what eval's faults do."""

from dataclasses import fields, replace
from urllib.parse import parse_qsl

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion_lab.engine.state import (
    CHOICES,
    DOWNPOUR,
    LOW_SUN,
    RANGES,
    LabState,
    Offer,
    Weather,
    first_state,
    from_query,
)
from fusion_net.common.faults import FaultPlan
from fusion_net.common.geometry import from_yaw

OFFER = Offer(("early", "mid", "late"), ("exit", "merge", "exit"), 5, {"clear": 1, "fog": 3, "night": 2})
CHANNELS = {"CAM_FRONT": "camera", "LIDAR_TOP": "lidar", "RADAR_FRONT": "radar"}


@st.composite
def states(draw):
    values = {}
    for each in fields(LabState):
        choices = OFFER.choices(each.name)
        if choices is not None:
            values[each.name] = draw(st.sampled_from(choices))
        else:
            low, high, step = RANGES[each.name]
            number = RANGES[each.name].nearest(low + step * draw(st.integers(0, round((high - low) / step))))
            values[each.name] = int(number) if isinstance(each.default, int) else number
    return replace(LabState(**values), severity=min(values["severity"], OFFER.conditions[values["condition"]]))


def read(query):
    return from_query(dict(parse_qsl(query)), OFFER)


@given(states())
def test_a_link_reproduces_the_state(state):
    again, notes = read(state.query())
    assert again == replace(state, level=state.level)
    assert not notes


def test_no_link_is_a_page_with_nothing_wrong():
    state, notes = read("")
    assert state == first_state(OFFER)
    assert state.level == "mid"
    assert not notes
    assert not state.faults(32)


@pytest.mark.parametrize(
    ("query", "field", "value", "said"),
    [
        ("condition=foggy", "condition", "fog", "fog"),
        ("condition=%00", "condition", "clear", "there are clear, fog, night"),
        ("scene=99", "scene", 0, "scene=99"),
        ("degrees=400", "degrees", 5.0, "out of range"),
        ("degrees=nan", "degrees", 0.0, "no number"),
        ("degrees=1e999", "degrees", 5.0, "out of range"),
        ("degrees=two", "degrees", 0.0, "no number"),
        ("level=latest", "level", "late", "late"),
        ("camra=dead", "camera", "alive", "camera"),
        ("condition=night&severity=3", "severity", 2, ""),
    ],
)
def test_of_a_wrong_link_the_rest_is_shown_and_it_is_said(query, field, value, said):
    state, notes = read(query)
    assert getattr(state, field) == value
    assert said in " ".join(notes)


def test_every_field_that_is_set_has_its_values():
    assert {each.name for each in fields(LabState)} == {
        *CHOICES,
        *RANGES,
        "level",
        "scene",
        "frame",
        "condition",
        "beams",
    }


def on(state, channel, beams=32):
    return FaultPlan(state.faults(beams)).on(channel, CHANNELS, scene="s", sample="k")


@pytest.mark.parametrize(("modality", "channel"), [(m, c) for c, m in CHANNELS.items()])
def test_the_health_of_a_sensor_is_its_own(modality, channel):
    dead, stale = (replace(LabState(), **{modality: health}) for health in ("dead", "stale"))
    assert on(dead, channel).dead
    assert on(stale, channel).late_firings == 1
    for other in CHANNELS.keys() - {channel}:
        assert not on(dead, other)
        assert not on(stale, other)


def test_a_turned_and_moved_sensor_truly_sits_there():
    state = replace(LabState(), turned="lidar", degrees=2.0, centimetres=-20.0)
    moved = on(state, "LIDAR_TOP").true_mount(np.eye(4))
    np.testing.assert_allclose(moved, from_yaw(np.radians(2.0), (0.0, -0.2, 0.0)))
    assert not on(state, "CAM_FRONT")


def test_a_clock_is_ahead_by_milliseconds():
    assert on(replace(LabState(), late="radar", milliseconds=120.0), "RADAR_FRONT").clock_error(0.0) == pytest.approx(
        0.12
    )


def test_a_lidar_that_has_no_more_beams_than_are_kept_loses_none():
    assert on(replace(LabState(), beams=8), "LIDAR_TOP")
    assert not on(replace(LabState(), beams=16), "LIDAR_TOP", beams=16)


def test_a_blinded_camera_and_a_drowned_lidar_leave_the_others_in_the_weather_that_is_set():
    state = replace(LabState(), condition="night", severity=1, camera="blinded", lidar="rained out")
    assert [state.weather(name) for name in ("camera", "lidar", "radar")] == [LOW_SUN, DOWNPOUR, Weather("night", 1)]


@given(states())
def test_states_that_look_alike_to_the_detector_have_the_same_faults_and_weather(state):
    seen = state.seen_as(32)
    assert seen.faults(32) == state.faults(32)
    for name in CHANNELS.values():
        weather = state.weather(name)
        assert seen.weather(name).name == weather.name
        assert weather.name == "clear" or seen.weather(name) == weather


def test_what_only_the_page_reads_does_not_ask_the_network_again():
    state = LabState(level="mid", condition="fog")
    for change in (
        {"view": "paint"},
        {"offset": 1.0},
        {"threshold": 0.5},
        {"turned": "radar"},
        {"u": 0.1},
        {"step": 3},
    ):
        assert replace(state, **change).seen_as(32) == state.seen_as(32)
