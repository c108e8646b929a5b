from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

from data_gen.scene.conditions import Condition, ConditionMix, Preset
from fusion_net.common.random import stream

CONFIGS = str(Path(__file__).parents[3] / "configs")


@cache
def load(name: str, *overrides: str) -> ConditionMix:
    with initialize_config_dir(CONFIGS, version_base=None):
        config = compose(overrides=[f"+condition={name}", *overrides])
    return instantiate(config.condition, _convert_="all")


def test_extinction_leaves_five_per_cent_contrast_at_the_optical_range():
    assert np.exp(-Condition(visibility=80.0).extinction * 80.0) == pytest.approx(0.05)


def test_day_is_day_and_night_is_night():
    day, night = load("clear"), load("night")
    days, nights = ([mix.sample(stream(1, k), heading=0.0) for k in range(50)] for mix in (day, night))
    assert not any(c.is_night for c in days)
    assert all(c.is_night and c.sun_elevation < 0 for c in nights)
    assert {c.name for c in days + nights} == {"clear", "night"}
    assert min(c.visibility for c in days + nights) >= 12_000


def test_scenes_differ_in_every_drawn_quantity_and_spread_over_the_range():
    mix = load("clear")
    draws = [mix.sample(stream(7, k), heading=0.0) for k in range(300)]
    for name, low, high in (("sun_azimuth", -180, 180), ("sun_elevation", 25, 70), ("illuminance", 2e4, 1e5)):
        values = np.array([getattr(c, name) for c in draws])
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.08 * (high - low) < values.max() <= high
    # Evenly in the logarithm: half of the scenes lie under the geometric mean.
    assert np.mean([c.illuminance < np.sqrt(2e4 * 1e5) for c in draws]) == pytest.approx(0.5, abs=0.08)


def test_mixture_keeps_its_shares_and_is_deterministic():
    mix = load("day_night", "condition.weights.night=0.7")  # in proportion: 0.7 to 0.7
    names = [mix.sample(stream(3, k), heading=0.0).name for k in range(400)]
    assert np.mean([n == "night" for n in names]) == pytest.approx(0.5, abs=0.07)
    assert mix.sample(stream(3, 5), heading=0.0) == mix.sample(stream(3, 5), heading=0.0)
    only = load("day_night", "condition.weights.clear=0")
    assert {only.sample(stream(3, k), heading=0.0).name for k in range(20)} == {"night"}


@pytest.mark.parametrize("name", ["fog", "rain", "spray", "glare", "dusk", "dusk_glare_spray"])
def test_severity_chooses_the_level_and_null_any(name):
    worst = load(name, "condition.severity=3")
    assert {worst.sample(stream(2, k), heading=0.0).severity for k in range(20)} == {3}
    assert {load(name).sample(stream(2, k), heading=0.0).severity for k in range(60)} == {1, 2, 3}
    order = {"fog": "visibility", "rain": "rain_rate", "spray": "water_film"}.get(name, "sun_elevation")
    mean = [
        np.mean(
            [getattr(load(name, f"condition.severity={s}").sample(stream(4, k), heading=0.0), order) for k in range(20)]
        )
        for s in (1, 2, 3)
    ]
    assert mean == sorted(mean, reverse=order in ("visibility", "sun_elevation"))


def test_glare_comes_from_where_the_ego_drives_to():
    for heading in (-3.0, 0.4, 2.9):
        for k in range(20):
            drawn = load("glare", "condition.severity=3").sample(stream(5, k), heading=heading)
            off = (drawn.sun_azimuth - np.degrees(heading) + 180) % 360 - 180
            assert abs(off) <= 15
            assert -180 <= drawn.sun_azimuth < 180


def test_a_mixture_takes_one_severity_for_all_that_have_it():
    mix = load("mixed", "condition.severity=2")
    drawn = [mix.sample(stream(6, k), heading=0.0) for k in range(300)]
    assert {c.severity for c in drawn} == {1, 2}
    assert {c.name for c in drawn if c.severity == 1} == {"clear", "night"}
    assert {c.name for c in drawn} == set(mix.presets)


def test_drops_and_mist_add_up_to_the_extinction():
    rain = Condition(rain_rate=25.0, visibility=600.0)
    assert rain.rain_extinction == pytest.approx(2.8e-3, rel=0.01)
    assert rain.rain_extinction + rain.mist_extinction == pytest.approx(rain.extinction)
    assert Condition(rain_rate=50.0).mist_extinction == 0.0  # drops alone would see less far than that


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda p: ConditionMix(presets={"clear": [p]}, weights={"claer": 1.0}), "'claer'.*presets are clear"),
        (lambda p: ConditionMix(presets={"clear": [p]}, weights={"clear": 0.0}), "all zero"),
        (lambda p: ConditionMix(presets={"fog": [p, p]}, weights={"fog": 1.0}, severity=3), "severity=3: .* 1 to 2"),
        (lambda p: ConditionMix(presets={"clear": [p]}, weights={"clear": 1.0}, severity=0), "1 is the only severity"),
        (lambda p: Preset(illuminance=[2.0, 1.0], sun_elevation=[0.0, 1.0]), r"illuminance=\[2.0, 1.0\]"),
        (lambda p: Preset(illuminance=[0.0, 1.0], sun_elevation=[0.0, 1.0]), "above 0"),
        (lambda p: Condition(rain_rate=-1.0), "rain_rate=-1.0"),
    ],
)
def test_a_mistake_is_named(make, says):
    preset = Preset(illuminance=[1.0, 2.0], sun_elevation=[0.0, 1.0])
    with pytest.raises(ValueError, match=says):
        make(preset)
