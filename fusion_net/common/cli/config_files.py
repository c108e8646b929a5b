"""The files of settings: which commands they belong to, what groups they make, and what Hydra composes of them."""

import re
from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra.errors import HydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from fusion_net.common.cli.flags import UserError

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
COMMANDS = {
    "train": "train.py",
    "eval": "eval.py",
    "data_gen": "python -m data_gen",
    "asset_sheet": "python -m data_gen.pictures.asset_sheet",
    "contact_sheet": "python -m data_gen.pictures.contact_sheet",
    "rig_preview": "python -m data_gen.pictures.rig_preview",
    "ablation": "python -m fusion_net.reports.ablation",
    "claims": "python -m fusion_net.reports.claims",
    "compare": "python -m fusion_net.reports.compare",
    "levels": "python -m fusion_net.reports.levels",
    "tracks": "python -m fusion_net.reports.tracks",
    "statistics": "python -m fusion_net.reports.statistics",
    "lidar_check": "python -m fusion_net.viz.lidar_check",
    "animation": "python -m fusion_net.viz.animation",
    "painting": "python -m fusion_net.viz.painting",
    "rerun_log": "python -m fusion_net.viz.rerun_log",
    "lab": "python -m fusion_lab",
}
"""The command of each file in ``configs/``."""


def composed_anew(config_name: str, *overrides: str) -> DictConfig:
    """What Hydra makes of the files, its own settings included. UserError where one cannot be read."""
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        try:
            return compose(config_name, overrides=list(overrides), return_hydra_config=True)
        except HydraException as error:
            raise UserError(str(error).splitlines()[0]) from error
        except (YAMLError, UnicodeDecodeError, OmegaConfBaseException) as error:
            raise UserError(f"a file of settings cannot be read: {error}") from error


def is_written(key: str) -> bool:
    """Whether any file of the project sets a key of this last name: composing the settings of every command takes seconds,
    which a misspelt one can be spared."""
    is_set = re.compile(rf"\b{re.escape(key.rpartition('.')[2])}:")
    return any(is_set.search(path.read_text(encoding="utf-8")) for path in CONFIGS.glob("**/*.yaml"))


def groups_of(folders: list[Path]) -> dict[str, list[str]]:
    """The options of every group of settings. UserError for a file that another of the same name would hide."""
    groups: dict[str, set[str]] = {}
    for folder in folders:
        for path in folder.glob("**/*.yaml"):
            name = path.relative_to(folder)
            if folder != CONFIGS and (CONFIGS / name).exists():
                raise UserError(f"{path} has the name of a file of the project, which would be read instead; rename it")
            if len(name.parts) > 1:
                groups.setdefault(name.parts[0], set()).add(Path(*name.parts[1:]).with_suffix("").as_posix())
    return {group: sorted(options) for group, options in groups.items()}
