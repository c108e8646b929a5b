"""Commands to print, written so that a shell and Hydra read them as they are meant; folder names for the jobs of a sweep."""

import hashlib
import re
import shlex
import sys
from collections.abc import Sequence
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Quote, QuotedString
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import OmegaConf

PLAIN = re.compile(r"[A-Za-z_./][\w./+-]*", re.ASCII)
"""Text that needs no quotes, unless it reads as a number, a boolean or null."""
LONGEST = 100
"""Characters of a folder's name."""


def command_line(program: str, **overrides: Any) -> str:
    """``python PROGRAM key=value ...`` for a shell. A double underscore in a key stands for a dot: ``data__root=folder``."""
    words = [f"{key.replace('__', '.')}={as_override(value)}" for key, value in overrides.items()]
    return f"python {program} {shlex.join(words)}".rstrip()


def name_folder() -> None:
    """Lets the first word of the command line be the folder without its key: ``FOLDER`` becomes ``folder=FOLDER``."""
    if sys.argv[1:] and "=" not in sys.argv[1] and not sys.argv[1].startswith("-"):
        sys.argv[1] = f"folder={as_override(sys.argv[1].rstrip('/'))}"


def as_override(value: Any) -> str:
    """A value as Hydra's overrides write it: text in quotes where it would be read as anything else."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, list | tuple) or OmegaConf.is_list(value):
        return f"[{','.join(map(as_override, value))}]"
    if isinstance(value, int | float):
        return str(value)
    text = str(value)
    if PLAIN.fullmatch(text) and _read(text) == text:
        return text
    # OmegaConf would look up ${...}: a backslash forbids it, and those before it count double
    return QuotedString(re.sub(r"(\\*)\$\{", r"\1\1\\${", text), Quote.single).with_quotes()


def _read(text: str) -> Any:
    try:
        return OverridesParser.create().parse_override(f"key={text}").value()
    except HydraException:
        return None


def job_folder(overrides: Sequence[str]) -> str:
    """A folder's name for a job of a sweep, from its overrides: ``seed=1``, ``fuser=average`` give ``fuser-average_seed-1``.

    At most 100 characters, none of which a shell or Hydra reads as anything else. Where that takes away what tells two
    jobs apart, the name ends in a hash of all overrides. The same overrides give the same name in any order.
    """
    ordered = sorted(overrides)
    exact = "_".join(override.replace("=", "-", 1) for override in ordered)
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", exact).lstrip("-.")
    if name == exact and len(name) <= LONGEST:
        return name or "default"
    digest = hashlib.sha256("\0".join(ordered).encode(errors="surrogateescape")).hexdigest()[:10]
    return f"{name[: LONGEST - len(digest) - 1]}-{digest}"


def job_overrides() -> list[str]:
    """The overrides of this command, or of this job of a sweep, that its result depends on; [] outside of a command."""
    if not HydraConfig.initialized():
        return []
    job = HydraConfig.get()
    left_out = set(job.job.config.override_dirname.exclude_keys)
    return [text for text in job.overrides.task if text.split("=", 1)[0].lstrip("+~") not in left_out]


def job_number() -> int | None:
    """This job's place in its sweep, from 0; None outside of a sweep."""
    is_job = HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN
    return int(HydraConfig.get().job.num) if is_job else None


OmegaConf.register_new_resolver("job_folder", lambda: job_folder(job_overrides()), replace=True)
