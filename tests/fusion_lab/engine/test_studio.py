"""What the studio renders is what the generator would have written."""

import sys

import pytest
from numba.core.dispatcher import Dispatcher

from fusion_lab.engine.state import DOWNPOUR, Weather
from fusion_lab.engine.studio import RENDERED, open_studio
from fusion_net.common.nuscenes_format import MODALITIES
from tests.fixtures.small_lab import generated


def files(nusc):
    """What each record's file, and each file beside it, holds."""
    held = {}
    for record in nusc.tables["sample_data"].values():
        path = nusc.path(record)
        stem = path.name.split(".")[0]
        for each in path.parent.glob(f"{stem}.*"):
            held[f"{path.parent.name}/{each.name}"] = each.read_bytes()
    return held


@pytest.mark.parametrize("weather", [Weather("fog", 2), Weather("night", 1), Weather("rain", 3)])
def test_a_file_of_other_weather_is_to_the_byte_what_the_generator_writes_in_that_weather(studio, tmp_path, weather):
    overrides = (f"condition={weather.name}", f"condition.severity={weather.severity}")
    job = generated(tmp_path / "other", *overrides)
    other = type(studio)(job, studio.conditions)
    rendered = files(studio.under(dict.fromkeys(MODALITIES, weather)))
    assert rendered == files(other)
    assert rendered != files(studio)


def test_the_weather_of_one_sensor_leaves_the_files_of_the_others(studio):
    mixed, clear = studio.under({"lidar": DOWNPOUR}), files(studio)
    changed = {name for name, content in files(mixed).items() if content != clear[name]}
    assert {name.split("/")[0] for name in changed} == {"LIDAR_TOP"}


def test_what_is_prepared_are_the_files_of_one_keyframe(studio):
    sample = studio.scenes[1][0]
    studio.under(dict.fromkeys(MODALITIES, Weather("spray", 2))).prepare(sample, MODALITIES)
    folder = studio.root / RENDERED / "spray_2"
    for record in studio.tables["sample_data"].values():
        assert (folder / record["filename"]).is_file() == (record["sample_token"] == sample)


def test_no_weather_without_rain_or_spray_is_rendered_for_a_radar_and_it_measures_the_same_in_all_of_it(
    studio, tmp_path
):
    other = type(studio)(generated(tmp_path / "other", "condition=glare", "condition.severity=3"), studio.conditions)
    glare = studio.under({"radar": Weather("glare", 3)})
    for record in studio.tables["sample_data"].values():
        if studio.modalities[studio.channel(record)] == "radar":
            assert glare.path(record) == studio.path(record)
            assert glare.path(record).read_bytes() == (other.root / record["filename"]).read_bytes()


def compiled():
    """What is compiled of the generator's loops: functions by module and name, each with its signatures."""
    modules = [module for name, module in sys.modules.items() if name.startswith("data_gen.")]
    loops = {id(each): each for module in modules for each in vars(module).values() if isinstance(each, Dispatcher)}
    return {(each.__module__, each.__name__, str(types)) for each in loops.values() for types in each.signatures}


def test_after_a_rehearsal_no_weather_of_any_scene_has_to_wait_for_a_compiler(studio, tmp_path):
    studio = type(studio)(generated(tmp_path / "clear", "condition=clear"), studio.conditions)
    studio.rehearse()
    before = compiled()
    for name, worst in studio.severities.items():
        for severity in range(1, worst + 1):
            weather = studio.under(dict.fromkeys(MODALITIES, Weather(name, severity)))
            for tokens in studio.scenes:
                weather.prepare(tokens[len(tokens) // 2], MODALITIES)
    assert before
    assert compiled() == before


def test_what_was_rendered_is_kept_and_nothing_half_written_is(studio):
    fog = studio.under(dict.fromkeys(MODALITIES, Weather("fog", 1)))
    record = next(iter(studio.tables["sample_data"].values()))
    path = fog.path(record)
    written = path.stat().st_mtime_ns
    assert fog.path(record) == path
    assert path.stat().st_mtime_ns == written
    assert not [each for each in studio.root.iterdir() if each.name.startswith("tmp")]


def test_a_rig_that_the_generator_does_not_know_is_refused_in_a_line(tmp_path):
    with pytest.raises(ValueError, match=r"nano or .*surround; this detector was trained on 'mine'"):
        open_studio(tmp_path, rig="mine", scenes=1, keyframes=1, seed=1)
