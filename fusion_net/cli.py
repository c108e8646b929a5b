"""The front door of every command: checks overrides before Hydra sees them, and turns a user's mistake into one line.

Hydra alone suggests ``+key=value`` for a typo, which then silently adds a key that nobody reads. Here an unknown key, group
or option is answered with the nearest valid one, and exceptions that are the user's to mend (ValueError, FileNotFoundError,
OSError, a constructor's refusal) end the command with their message and exit code 1 instead of a traceback.
"""

import difflib
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from hydra import main as hydra_main
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, InstantiationException
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

CONFIGS = Path(__file__).resolve().parents[1] / "configs"


class UserError(ValueError):
    """A mistake that the user can mend; its message says what, where and how."""


def command(config_name: str) -> Callable[[Callable[[DictConfig], Any]], Callable[[], None]]:
    """Makes a function of the composed config a command that parses ``sys.argv``."""

    def decorate(function: Callable[[DictConfig], Any]) -> Callable[[], None]:
        def guarded(cfg: DictConfig) -> Any:
            with_line = _Guard(is_sweep="--multirun" in sys.argv or "-m" in sys.argv)
            return with_line(function, cfg)

        guarded.__module__, guarded.__name__ = function.__module__, function.__name__

        def run() -> None:
            try:
                check_overrides(config_name, sys.argv[1:])
            except UserError as error:
                _stop(str(error), code=2)
            hydra_main(version_base="1.3", config_path=str(CONFIGS), config_name=config_name)(guarded)()

        return run

    return decorate


class _Guard:
    def __init__(self, *, is_sweep: bool) -> None:
        self.is_sweep = is_sweep

    def __call__(self, function: Callable[[DictConfig], Any], cfg: DictConfig) -> Any:
        try:
            return function(cfg)
        except KeyboardInterrupt:
            _stop("interrupted; what was written is kept, and the same command goes on from there", code=130)
        except (ValueError, OSError, HydraException, OmegaConfBaseException) as error:
            if self.is_sweep:
                raise
            _stop(one_line(error), code=1)


def check_overrides(config_name: str, argv: list[str]) -> None:
    """Raises UserError for an override that does not parse, or names an unknown key, group or option."""
    texts = [arg for arg in argv if "=" in arg and not arg.startswith("-")]
    try:
        overrides = OverridesParser.create().parse_overrides(texts)
    except HydraException as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"cannot read the override: {reason}; quote lists for the shell: 'key=[a,b]'") from error
    stray = [arg for arg in argv if "=" not in arg and not arg.startswith("-")]
    if stray and not any(
        arg in ("--config-name", "--config-path", "--info", "-i", "--cfg", "-c", "-cn") for arg in argv
    ):
        raise UserError(f"'{stray[0]}' is not an override; write key=value")
    groups = {
        path.name: sorted(file.stem for file in path.glob("*.yaml")) for path in CONFIGS.iterdir() if path.is_dir()
    }
    chosen = []
    for override in overrides:
        key, value = override.key_or_group, override.value()
        if key in groups and isinstance(value, str) and not override.is_sweep_override():
            if value not in groups[key]:
                raise UserError(f"there is no {key}={value}; {_nearest(value, groups[key])}")
            chosen.append(override.input_line)
        elif key in groups and not override.is_sweep_override() and value is not None:
            raise UserError(f"{key}={value} is not a file name; there are {', '.join(groups[key])}")
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        try:
            known = set(_keys(compose(config_name, overrides=chosen)))
        except HydraException as error:
            raise UserError(str(error).splitlines()[0]) from error
    for override in overrides:
        key = override.key_or_group
        if override.is_add() or key in groups or key in known or key.startswith("hydra."):
            continue
        raise UserError(f"unknown override '{key}'; {_nearest(key, sorted(known | set(groups)))}")


def build(node: Any, where: str, **arguments: Any) -> Any:
    """The object that a config node with ``_target_`` describes. A wrong name or type raises UserError naming the key."""
    try:
        return instantiate(node, _convert_="all", **arguments)
    except InstantiationException as error:
        key = re.search(r"full_key: (\S+)", str(error))
        raise UserError(f"{key.group(1) if key else where}: {one_line(error.__cause__ or error)}") from error


def one_line(error: BaseException) -> str:
    """The message of an exception in one line, without Hydra's and beartype's wrapping."""
    if isinstance(error, InstantiationException) and error.__cause__ is not None:
        return one_line(error.__cause__)
    text = re.sub(r"\x1b\[[0-9;]*m", "", " ".join(str(error).split()))
    violated = re.search(r"parameter (\w+)=(.*?) violates type hint (.*?), as", text)
    if violated:
        hint = re.sub(r"<class '(\w+)'>", r"\1", violated.group(3))
        return f"{violated.group(1)}={violated.group(2)} is not of type {hint}"
    return text or type(error).__name__


def _nearest(word: str, options: list[str]) -> str:
    close = difflib.get_close_matches(word, options, n=2, cutoff=0.5)
    if close:
        return f"did you mean {' or '.join(close)}?"
    return f"there are {', '.join(options[:12])}{', ...' if len(options) > 12 else ''}"


def _keys(node: Any, prefix: str = "") -> Iterator[str]:
    """Dotted names of every key of a config, inner ones too."""
    if OmegaConf.is_dict(node):
        for key in node:
            yield f"{prefix}{key}"
            if not OmegaConf.is_missing(node, key) and not OmegaConf.is_interpolation(node, key):
                yield from _keys(node[key], f"{prefix}{key}.")


def _stop(message: str, *, code: int) -> None:
    print(f"error: {message}", file=sys.stderr)
    raise SystemExit(code)
