"""The settings of a command, composed from the project's files by other code than the command itself."""

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig

from fusion_net.common.cli.config_files import CONFIGS


def composed(config_name: str, *overrides: str) -> DictConfig:
    """What ``configs/NAME.yaml`` and these overrides say. Works within a command too, where Hydra has composed already."""
    outer = GlobalHydra.instance().hydra
    GlobalHydra.instance().clear()
    try:
        with initialize_config_dir(str(CONFIGS), version_base="1.3"):
            return compose(config_name, overrides=list(overrides))
    finally:
        GlobalHydra.instance().hydra = outer
