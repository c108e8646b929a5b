"""The sensor's motion from the returns that stand still, in traffic most of which moves."""

import sys
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def fit(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "tools/devkit")
    import ego_motion_fit

    yield ego_motion_fit.ego_motion_fit
    sys.modules.pop("ego_motion_fit")


@pytest.mark.parametrize("turn", [0.0, 2.0, 20.0])
@pytest.mark.parametrize("seed", range(5))
def test_the_road_is_found_although_more_than_half_of_the_returns_move(fit, seed, turn):
    rng = np.random.default_rng(seed)
    azimuth, speed = rng.uniform(-1, 1, 1000), np.zeros(1000)
    for start, of_a_vehicle in ((400, 3.0), (600, 5.0), (800, 9.0)):  # ego at 10 m/s
        speed[start : start + 200] = of_a_vehicle
    rows = 10 * np.stack([np.cos(azimuth), -np.sin(azimuth)], axis=1)
    approach = (10 - speed) * np.cos(azimuth + np.radians(turn)) + 0.1 * rng.normal(size=1000)
    along, aside, sigma = fit(rows, approach)
    assert np.hypot(along, aside) == pytest.approx(1, abs=0.02)
    assert np.degrees(np.arctan2(aside, along)) == pytest.approx(turn, abs=0.2 + 4 * sigma)


def test_with_no_returns_nothing_is_off(fit):
    assert fit(np.zeros((2, 2)), np.zeros(2)) == (1.0, 0.0, 0.0)
