"""The flags of a command line, which Hydra takes but explains in many lines or not at all."""

import sys
from pathlib import Path
from typing import NoReturn

from hydra._internal.utils import get_args_parser  # its only list of flags


class UserError(ValueError):
    """A mistake that the user can mend; its message says what, where and how."""


def read_flags(argv: list[str]) -> tuple[list[str], list[str], Path | None]:
    """Flags (before overrides, where Hydra wants them), overrides, and the folder of ``--config-dir``. UserError for others."""
    parser = get_args_parser()
    parser.allow_abbrev = False
    parser.error = _refuse  # type: ignore[method-assign]
    found, unknown = parser.parse_known_intermixed_args(argv)
    flags = {name.replace("_", "-"): value for name, value in vars(found).items() if name != "overrides" and value}
    if unknown:
        given = unknown[0].lstrip("-")
        raise UserError(f"unknown flag {unknown[0]}; {f'write {given}' if '=' in given else 'settings are key=value'}")
    for name in ("config-path", "config-name", "experimental-rerun"):
        if name in flags:
            raise UserError(
                f"--{name} is not for this command; keep settings of your own in a folder: --config-dir DIR"
            )
    folder = found.config_dir
    if folder is not None and not Path(folder).is_dir():
        raise UserError(f"--config-dir {folder} is not a folder")
    words = [
        word for name, value in flags.items() for word in ([f"--{name}"] if value is True else [f"--{name}", value])
    ]
    return words, found.overrides or [], None if folder is None else Path(folder)


def _refuse(message: str) -> NoReturn:
    raise UserError(f"{message}; python {Path(sys.argv[0]).name} --help shows how")
