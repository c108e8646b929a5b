"""The front door of every command: the command line is checked before Hydra sees it, and a user's mistake becomes one line.

Exceptions that are the user's to mend (ValueError, FileNotFoundError, OSError, a constructor's refusal) end the command with
their message and exit code 1 instead of a traceback. In a sweep each job that fails says so in one line, and the others go on.
"""

import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from beartype.roar import BeartypeCallHintViolation
from hydra import main as hydra_main
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException, InstantiationException, MissingConfigException
from hydra.types import RunMode
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigTypeError, MissingMandatoryValue, OmegaConfBaseException

from fusion_net.common.cli.config_files import CONFIGS
from fusion_net.common.cli.flags import UserError
from fusion_net.common.cli.hints import with_floats
from fusion_net.common.cli.override_values import nearest
from fusion_net.common.cli.overrides import check_overrides
from fusion_net.common.cli.processes import is_first, leave_interrupts_to_the_first
from fusion_net.common.cli.terminal import print_any_text
from fusion_net.common.cli.typed import note_words
from fusion_net.common.settings import WHERE_MODULES_ARE

MISTAKES = (ValueError, OSError, HydraException, OmegaConfBaseException, BeartypeCallHintViolation)
"""What a user can mend; anything else is a bug and keeps its traceback."""


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
            note_words(sys.argv[1:])
            os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra then raises its own errors instead of printing them
            if not is_first():
                leave_interrupts_to_the_first()
            try:
                sys.argv[1:] = check_overrides(config_name, sys.argv[1:])
            except UserError as error:
                _stop(str(error), code=2)
            except KeyboardInterrupt:
                _interrupted("nothing was begun")
            try:
                hydra_main(version_base="1.3", config_path=str(CONFIGS), config_name=config_name)(guarded)()
            except JobError:
                _stop(
                    "not every job of the sweep succeeded: mend what is named above; the same command does what is left",
                    code=1,
                )
            except MISTAKES as error:
                _stop(one_line(error), code=1)
            except KeyboardInterrupt:
                _interrupted("the same command goes on with what is left")

        return run

    return decorate


def _guard(function: Callable[[DictConfig], Any], cfg: DictConfig) -> Any:
    try:
        settings = OmegaConf.create(_with_home(OmegaConf.to_container(cfg, resolve=False)), flags={"struct": True})
        return function(settings)
    except KeyboardInterrupt as interruption:
        advice = str(interruption) or "what was written is kept, and the same command goes on from there"
        _interrupted(advice)
    except MISTAKES as error:
        job = HydraConfig.get()
        if job.mode != RunMode.MULTIRUN:
            _stop(one_line(error), code=1)
        print(f"error: {' '.join(job.overrides.task)}: {one_line(error)}", file=sys.stderr, flush=True)
        raise JobError from None


def build(node: Any, where: str = "", **arguments: Any) -> Any:
    """The object that a config node with ``_target_`` describes. A wrong name or type raises UserError that begins with its
    key: that of the node, ``where``, and those below. A data set has no ``where``: it refuses files, and names them."""
    try:
        settings = OmegaConf.to_container(node, resolve=True) if OmegaConf.is_config(node) else node
        return instantiate(with_floats(settings), _convert_="all", **arguments)
    except InstantiationException as error:
        found = re.search(r"full_key: (\S+)", str(error)) if where else None
        key, reason = f"{where}.{found.group(1)}" if found else where, one_line(error.__cause__ or error)
        if reason.startswith("Error loading"):
            reason = f"{reason.split(' Are you sure')[0]}; {WHERE_MODULES_ARE}"
        if not key or reason.startswith((f"{key}:", f"{key}.")):
            raise UserError(reason) from error
        inner = settings
        for part in found.group(1).split(".") if found else ():
            inner = inner.get(part) if isinstance(inner, dict) else None
        is_of_it = isinstance(inner, dict) and reason.partition("=")[0] in inner
        raise UserError(f"{key}{'.' if is_of_it else ': '}{reason}") from error


def one_line(error: BaseException) -> str:
    """The message of an exception in one line, without Hydra's and beartype's wrapping."""
    if isinstance(error, InstantiationException) and error.__cause__ is not None:
        return one_line(error.__cause__)
    if isinstance(error, FileExistsError | NotADirectoryError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}; a file is where a folder is needed: move it away"
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, MissingMandatoryValue):
        key = str(error.full_key or "a value")  # type: ignore[attr-defined]
        return f"{key} is needed; write {key}=VALUE, as --help shows"
    if isinstance(error.__cause__, ConfigTypeError):  # "Cannot merge DictConfig with ListConfig"
        asked = str(error).removeprefix("Error merging override ")
        return (
            f"{asked}: the setting is a mapping, {{name: value, ...}}, or one value, not a list, or the other way round"
        )
    if isinstance(error, MissingConfigException) and "hydra/launcher" in str(error):
        extra = "ray" if "launcher/ray" in str(error) else "launchers"
        return f"{str(error).splitlines()[0]}; launchers are installed with: python -m pip install -e '.[{extra}]'"
    inner = re.search(r"Original Traceback.*^\w+: (.*)", str(error), re.DOTALL | re.MULTILINE)  # of a loader's process
    text = re.sub(r"\x1b\[[0-9;]*m", "", " ".join((inner.group(1) if inner else str(error)).split()))
    violated = re.search(r"parameter (\w+)=(.*?) violates type hint (.*?), as", text)
    if violated:
        name, value = violated.group(1), violated.group(2).strip("'")
        hint = re.sub(r"<class '(\w+)'>", r"\1", violated.group(3))
        if "Literal[" in hint:
            choices = re.findall("'(.*?)'", hint)
            return f"there is no {name}={value}; {nearest(value, choices)}"
        return f"{name}={violated.group(2)} is not of type {hint}"
    return text or type(error).__name__


def _with_home(node: Any) -> Any:
    """Settings in which ``~`` at the front of a text is the home folder."""
    if isinstance(node, dict):
        return {key: _with_home(value) for key, value in node.items()}
    if isinstance(node, list):
        return [_with_home(value) for value in node]
    return str(Path(node).expanduser()) if isinstance(node, str) and node.startswith("~") else node


def _interrupted(advice: str) -> None:
    """Ends the command. Of several processes the first one says so; that the others ended is no failure of theirs, for which
    Lightning would kill the first."""
    if not is_first():
        raise SystemExit(0)
    _stop(f"interrupted; {advice}", code=130)


def _stop(message: str, *, code: int) -> None:
    line = re.sub(r"(\S{80})\S{80,}", r"\1...", " ".join(message.split()))
    print(f"error: {line}", file=sys.stderr)
    raise SystemExit(code)
