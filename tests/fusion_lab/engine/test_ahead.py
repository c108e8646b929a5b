"""What the lab works ahead on are states that somebody can set next."""

from dataclasses import replace

import pytest

from fusion_lab.engine.ahead import far, near
from fusion_lab.engine.state import Offer, Weather, first_state

OFFER = Offer(("mid",), ("exit",), 5, {"clear": 1, "fog": 3, "night": 2})


@pytest.mark.parametrize(("condition", "severity"), [("clear", 1), ("fog", 1), ("fog", 3), ("night", 2)])
def test_near_and_far_are_all_other_weather_once(condition, severity):
    state = replace(first_state(OFFER), condition=condition, severity=severity)
    found = [*near(state, OFFER), *far(state, OFFER)]
    weather = [each.weather("radar") for each in found if each.frame == state.frame]
    every = {Weather(name, level) for name, levels in OFFER.conditions.items() for level in range(1, levels + 1)}
    assert sorted(weather) == sorted(every - {state.weather("radar")})


def test_the_slider_s_next_severity_comes_first_and_the_last_keyframe_is_followed_by_the_first():
    state = replace(first_state(OFFER), condition="fog", severity=3, frame=4)
    severities = [each.severity for each in near(state, OFFER) if each.frame == 4]
    assert severities == [2, 1]
    assert [each.frame for each in near(state, OFFER)][-1] == 0
