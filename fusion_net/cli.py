"""The front door of every command: checks overrides before Hydra sees them, and turns a user's mistake into one line.

Hydra alone suggests ``+key=value`` for a typo, which then silently adds a key that nobody reads. Here an unknown key, group
or option is answered with the nearest valid one, and exceptions that are the user's to mend (ValueError, FileNotFoundError,
OSError, a constructor's refusal) end the command with their message and exit code 1 instead of a traceback. In a sweep each
job that fails says so in one line, and the others go on.
"""

import difflib
import os
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from beartype.roar import BeartypeCallHintViolation
from hydra import compose, initialize_config_dir
from hydra import main as hydra_main
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, InstantiationException, MissingConfigException
from hydra.types import RunMode
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from fusion_net.terminal import print_any_text

CONFIGS = Path(__file__).resolve().parents[1] / "configs"


class UserError(ValueError):
    """A mistake that the user can mend; its message says what, where and how."""


MISTAKES = (ValueError, OSError, HydraException, OmegaConfBaseException, BeartypeCallHintViolation)
"""What a user can mend; anything else is a bug and keeps its traceback."""
LISTS = ("data.root",)
"""Keys that take one name or a list of them."""


class JobError(Exception):
    """A job of a sweep failed and has said why."""


def command(config_name: str) -> Callable[[Callable[[DictConfig], Any]], Callable[[], None]]:
    """Makes a function of the composed config a command that parses ``sys.argv``."""

    def decorate(function: Callable[[DictConfig], Any]) -> Callable[[], None]:
        def guarded(cfg: DictConfig) -> Any:
            return _guard(function, cfg)

        guarded.__module__, guarded.__name__ = function.__module__, function.__name__

        def run() -> None:
            print_any_text()
            os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then raises its own errors instead of printing them
            # and it takes overrides on one side of a flag only: -m goes to the front
            sys.argv[1:] = sorted(sys.argv[1:], key=lambda arg: arg not in ("-m", "--multirun"))
            try:
                check_overrides(config_name, sys.argv[1:])
            except UserError as error:
                _stop(str(error), code=2)
            try:
                hydra_main(version_base="1.3", config_path=str(CONFIGS), config_name=config_name)(guarded)()
            except JobError:
                _stop("not every job of the sweep succeeded; the same command does those that are left", code=1)
            except MISTAKES as error:
                _stop(one_line(error), code=1)
            except KeyboardInterrupt:
                _stop("interrupted; the same command goes on with what is left", code=130)

        return run

    return decorate


def _guard(function: Callable[[DictConfig], Any], cfg: DictConfig) -> Any:
    try:
        return function(cfg)
    except KeyboardInterrupt as interruption:
        advice = str(interruption) or "what was written is kept, and the same command goes on from there"
        _stop(f"interrupted; {advice}", code=130)
    except MISTAKES as error:
        job = HydraConfig.get()
        if job.mode != RunMode.MULTIRUN:
            _stop(one_line(error), code=1)
        print(f"error: {' '.join(job.overrides.task)}: {one_line(error)}", file=sys.stderr, flush=True)
        raise JobError from None


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
            if key == "sweep" and not override.is_add():
                raise UserError(f"a sweep is added to the settings: write +sweep={value}")
            chosen.append(str(override.input_line))
        elif key in groups and not override.is_sweep_override() and value is not None:
            raise UserError(f"{key}={value} is not a file name; there are {', '.join(groups[key])}")
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        try:
            composed = compose(config_name, overrides=chosen)
            known = set(_keys(composed))
        except HydraException as error:
            raise UserError(str(error).splitlines()[0]) from error
    for override in overrides:
        key = override.key_or_group
        if override.is_add() or key in groups or key.startswith(("hydra.", "hydra/")):
            continue
        if key not in known:
            raise UserError(f"unknown override '{key}'; {_nearest(key, sorted(known | set(groups)))}")
        if not override.is_delete() and not override.is_sweep_override():
            _check_type(key, override.value(), _raw(composed, key))


def _check_type(key: str, value: Any, default: Any) -> None:
    """A value must be of its default's kind. Nothing is known where that is null or a reference."""
    if isinstance(default, str) and ("${" in default or default == "???"):
        return
    text, old = f"{key}={'null' if value is None else value}", "false" if default is False else "true"
    if isinstance(default, dict) and isinstance(value, dict):
        for inner in map(str, value):
            if inner not in default:
                raise UserError(f"unknown key '{inner}' in {key}; {_nearest(inner, list(default))}")
    elif isinstance(default, bool):
        if not isinstance(value, bool):
            raise UserError(f"{text} is not true or false; the default is {old}")
    elif isinstance(default, int | float):
        kinds, name = (int, "whole number") if isinstance(default, int) else (int | float, "number")
        if not isinstance(value, kinds) or isinstance(value, bool):
            raise UserError(f"{text} is not a {name}; the default is {default}")
    elif isinstance(default, list) and not isinstance(value, list):
        raise UserError(f"{text} is not a list; write '{key}=[{value}]'")
    elif isinstance(default, str) and (value is None or (isinstance(value, list | dict) and key not in LISTS)):
        raise UserError(f"{text} is not a name; the default is {default}")


def _raw(cfg: DictConfig, key: str) -> Any:
    """The value at a dotted key with references left as they are written."""
    value: Any = OmegaConf.to_container(cfg, resolve=False)
    for part in key.split("."):
        value = value[part]
    return value


def build(node: Any, where: str, **arguments: Any) -> Any:
    """The object that a config node with ``_target_`` describes. A wrong name or type raises UserError naming the key."""
    try:
        return instantiate(node, _convert_="all", **arguments)
    except InstantiationException as error:
        found = re.search(r"full_key: (\S+)", str(error))
        key, reason = found.group(1) if found else where, one_line(error.__cause__ or error)
        raise UserError(reason if reason.startswith((f"{key}:", f"{key}.")) else f"{key}: {reason}") from error


def one_line(error: BaseException) -> str:
    """The message of an exception in one line, without Hydra's and beartype's wrapping."""
    if isinstance(error, InstantiationException) and error.__cause__ is not None:
        return one_line(error.__cause__)
    if isinstance(error, MissingMandatoryValue):
        key = str(error.full_key or "a value")  # type: ignore[attr-defined]
        return f"{key} is needed; write {key}=VALUE"
    if isinstance(error, MissingConfigException) and "hydra/launcher" in str(error):
        return f"{str(error).splitlines()[0]}; launchers are installed with: python -m pip install -e '.[launchers]'"
    inner = re.search(r"Original Traceback.*^\w+: (.*)", str(error), re.DOTALL | re.MULTILINE)  # of a loader's process
    text = re.sub(r"\x1b\[[0-9;]*m", "", " ".join((inner.group(1) if inner else str(error)).split()))
    violated = re.search(r"parameter (\w+)=(.*?) violates type hint (.*?), as", text)
    if violated:
        name, value = violated.group(1), violated.group(2).strip("'")
        hint = re.sub(r"<class '(\w+)'>", r"\1", violated.group(3))
        if "Literal[" in hint:
            choices = re.findall("'(.*?)'", hint)
            return f"there is no {name}={value}; {_nearest(value, choices)}"
        is_whole = hint == "float" and re.fullmatch("-?[0-9]+", value)
        return f"{name}={violated.group(2)} is not of type {hint}" + (f"; write {value}.0" if is_whole else "")
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
