"""The command as it was typed, for whoever wants to give it again."""

import re
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from hydra.core.hydra_config import HydraConfig

from fusion_net.common.cli.config_files import COMMANDS

_WORDS: list[str] = []


def note_words(words: Sequence[str]) -> None:
    """Keeps the words of the command line before any is rewritten for Hydra."""
    _WORDS[:] = words


def typed_words() -> list[str]:
    """What was typed after ``python``: ``train.py``, ``name=mine``. In the processes of a launcher, which did not see it typed,
    the words are those that Hydra has."""
    words = _WORDS or sys.argv[1:]
    if not HydraConfig.initialized():
        return [Path(sys.argv[0]).name, *words]
    return [*COMMANDS[str(HydraConfig.get().job.config_name)].removeprefix("python ").split(), *words]


def typed_command() -> str:
    """The same for a shell."""
    return shlex.join(typed_words())


def retyped(command: str) -> str:
    """A recorded command for a shell, without the quotes around plain text that commands once recorded: key='1'."""
    return shlex.join(re.sub(r"=(['\"])([\w.-]+)\1$", r"=\2", word) for word in shlex.split(command))
