"""Settings in a folder of one's own: found, checked, and named in answers as those of the project are."""

import re

import pytest

from fusion_net.common.cli.command import CONFIGS, UserError, check_overrides


@pytest.fixture
def own(tmp_path):
    """A folder of a user's own settings: an experiment, a fault and a sweep."""
    files = {
        "experiment/mine.yaml": "# @package _global_\nname: mine\nfuser: average\ntrainer: {max_lr: 1}\n",
        "fault/tilted.yaml": (CONFIGS / "fault/lidar_rotation.yaml").read_text().replace("lidar_rotation", "tilted"),
        "sweep/rates.yaml": "# @package _global_\nname: sweeps/rates/${job_folder:}\nskip_finished: true\n"
        "hydra: {mode: MULTIRUN, sweeper: {params: {trainer.max_lr: '0.001,0.002'}}}\n",
    }
    for name, text in files.items():
        path = tmp_path / "my configs" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "my configs"


@pytest.mark.parametrize(
    "arguments", [["experiment=mine"], ["fault=tilted", "fault.severity=2"], ["+sweep=rates"], ["experiment=nano"]]
)
def test_settings_may_lie_in_a_folder_of_ones_own(own, arguments):
    given = check_overrides("train", [*arguments, "--config-dir", str(own)])
    assert given[: 2 + len(arguments)] == ["--config-dir", str(own), *arguments]


@pytest.mark.parametrize(
    ("argument", "answer"),
    [
        ("experiment=mien", "did you mean mine"),
        ("experiment=surond", "did you mean surround"),
        ("trainer=mine", "has no folder trainer/"),
    ],
)
def test_the_nearest_is_looked_for_in_both_folders(own, argument, answer):
    with pytest.raises(UserError, match=answer):
        check_overrides("train", [argument, "--config-dir", str(own)])


@pytest.mark.parametrize(
    ("file", "text", "answer"),
    [
        ("experiment/bad.yaml", "trainer: {max_stepz: 3}", "unknown key 'trainer.max_stepz'; did you mean"),
        ("experiment/bad.yaml", "trainer: {batch_size: many}", "trainer.batch_size=many is not a whole number"),
        ("experiment/bad.yaml", "grid: {cel: 3}", "unknown key 'grid.cel'; did you mean grid.cell"),
        ("experiment/bad.yaml", "a: [", "experiment/bad.yaml"),
        ("experiment/nano.yaml", "name: mine", "has the name of a file of the project"),
        ("sweep/bad.yaml", "hydra: {mode: MULTIRUN, sweeper: {params: {sede: '1,2'}}}", "did you mean seed"),
    ],
)
def test_a_mistake_in_a_file_of_ones_own_is_named(own, file, text, answer):
    (own / file).write_text(f"# @package _global_\n{text}\n")
    chosen = "+sweep=bad" if file.startswith("sweep") else "experiment=bad"
    with pytest.raises(UserError, match=re.escape(answer)):
        check_overrides("train", [chosen, "--config-dir", str(own)])
