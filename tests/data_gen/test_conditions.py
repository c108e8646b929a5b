from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from data_gen.conditions import Condition, ConditionMix, Preset
from data_gen.random import stream

CONFIGS = str(Path(__file__).parents[2] / "configs")


def load(name: str, *overrides: str) -> ConditionMix:
    with initialize_config_dir(CONFIGS, version_base=None):
        config = compose(overrides=[f"+condition={name}", *overrides])
    return instantiate(config.condition, _convert_="all")


def test_extinction_leaves_five_per_cent_contrast_at_the_optical_range():
    assert np.exp(-Condition(visibility=80.0).extinction * 80.0) == pytest.approx(0.05)


def test_day_is_day_and_night_is_night():
    day, night = load("clear"), load("night")
    days, nights = ([mix.draw(stream(1, k)) for k in range(50)] for mix in (day, night))
    assert not any(c.is_night for c in days)
    assert all(c.is_night and c.sun_elevation < 0 for c in nights)
    assert {c.name for c in days + nights} == {"clear", "night"}
    assert min(c.visibility for c in days + nights) >= 12_000


def test_scenes_differ_in_every_drawn_quantity_and_spread_over_the_range():
    mix = load("clear")
    draws = [mix.draw(stream(7, k)) for k in range(300)]
    for name, low, high in (("sun_azimuth", -180, 180), ("sun_elevation", 25, 70), ("illuminance", 2e4, 1e5)):
        values = np.array([getattr(c, name) for c in draws])
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.08 * (high - low) < values.max() <= high
    # Evenly in the logarithm: half of the scenes lie under the geometric mean.
    assert np.mean([c.illuminance < np.sqrt(2e4 * 1e5) for c in draws]) == pytest.approx(0.5, abs=0.08)


def test_mixture_keeps_its_shares_and_is_deterministic():
    mix = load("day_night", "condition.weights.night=0.7")  # in proportion: 0.7 to 0.7
    names = [mix.draw(stream(3, k)).name for k in range(400)]
    assert np.mean([n == "night" for n in names]) == pytest.approx(0.5, abs=0.07)
    assert mix.draw(stream(3, 5)) == mix.draw(stream(3, 5))
    only = load("day_night", "condition.weights.clear=0")
    assert {only.draw(stream(3, k)).name for k in range(20)} == {"night"}


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda p: ConditionMix(presets={"clear": p}, weights={"claer": 1.0}), "'claer'.*presets are clear"),
        (lambda p: ConditionMix(presets={"clear": p}, weights={"clear": 0.0}), "all zero"),
        (lambda p: Preset(illuminance=[2.0, 1.0], sun_elevation=[0.0, 1.0]), r"illuminance=\[2.0, 1.0\]"),
        (lambda p: Preset(illuminance=[0.0, 1.0], sun_elevation=[0.0, 1.0]), "above 0"),
        (lambda p: Condition(rain_rate=-1.0), "rain_rate=-1.0"),
    ],
)
def test_a_mistake_is_named(make, says):
    preset = Preset(illuminance=[1.0, 2.0], sun_elevation=[0.0, 1.0])
    with pytest.raises(ValueError, match=says):
        make(preset)
