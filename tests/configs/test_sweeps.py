"""The sweeps and recipes that are there: every key is one that somebody reads, every job scores itself."""

from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.plugins import Plugins
from hydra.plugins.launcher import Launcher
from hydra.utils import get_class

from fusion_net.common.cli.config_files import CONFIGS
from fusion_net.common.cli.overrides import check_overrides

SWEEPS = sorted(path.stem for path in (CONFIGS / "sweep").glob("*.yaml"))
LAUNCHERS = {
    "joblib": "hydra_joblib_launcher",
    "submitit_slurm": "hydra_submitit_launcher",
    "ray": "hydra_ray_launcher",
}


def composed(*overrides):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        return compose("train", overrides=list(overrides), return_hydra_config=True)


@pytest.mark.parametrize("name", SWEEPS)
def test_a_sweep_is_read_and_its_jobs_score_themselves_in_folders_of_their_own(name):
    check_overrides("train", ["-m", f"+sweep={name}"])
    cfg = composed(f"+sweep={name}")
    assert cfg.evaluate
    assert cfg.skip_finished
    assert "seed" in cfg.hydra.sweeper.params
    text = (CONFIGS / "sweep" / f"{name}.yaml").read_text()
    assert f"name: sweeps/{name}/${{job_folder:}}" in text
    assert f"python train.py -m +sweep={name}" in text.splitlines()[1]


def test_sweeps_take_the_short_recipe_unless_told_otherwise():
    short = composed("trainer=short").trainer
    assert composed("+sweep=dropout").trainer == short
    assert short.max_minutes is None  # every run takes the same steps
    assert composed("+sweep=dropout", "trainer=cpu").trainer.fusion_steps > short.fusion_steps


@pytest.mark.parametrize("name", sorted({*SWEEPS} - {"seeds"}))
def test_sweeps_train_the_network_of_the_committed_results(name):
    cfg = composed(f"+sweep={name}")
    assert (cfg.model.bev_channels, cfg.grid.cell) == (32, 0.8)


@pytest.mark.parametrize("path", sorted((CONFIGS / "experiment").glob("*.yaml")), ids=lambda path: path.stem)
def test_an_experiment_takes_another_recipe_when_it_is_told_to(path):
    chosen = composed(f"experiment={path.stem}", "trainer=smoke").trainer
    assert chosen == composed("trainer=smoke").trainer


@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_a_sweep_composes_with_each_launcher_that_is_documented(launcher):
    pytest.importorskip(f"hydra_plugins.{LAUNCHERS[launcher]}")
    cfg = composed("+sweep=dropout", f"hydra/launcher={launcher}")
    target = cfg.hydra.launcher._target_
    assert target.startswith(f"hydra_plugins.{LAUNCHERS[launcher]}")
    if launcher != "ray":  # whose package is imported with Ray itself
        assert get_class(target) in Plugins.instance().discover(Launcher)
    assert launcher.partition("_")[0] in Path(CONFIGS.parent / "docs/ablations.md").read_text()
