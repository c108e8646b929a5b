"""One override: how it is read, what it holds, and whether that is of the default's kind."""

import difflib
import math
import re
from collections.abc import Iterator
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import OmegaConf

from fusion_net.common.cli.command_line import as_override
from fusion_net.common.cli.flags import UserError
from fusion_net.common.cli.hints import accepts

LISTS = ("data.root", "audits")
"""Keys that take one name or a list of them."""
CAN_BE_NULL = ("results", "data.root")
"""Keys of a name that may be null."""

FOLDERS = {"runs": "run", "data": "data.root"}
"""The key that a folder below one of these is probably meant for."""


def at(settings: dict[str, Any], key: str) -> Any:
    """The value at a dotted key."""
    value: Any = settings
    for part in key.split("."):
        value = value[part]
    return value


def parsed(text: str) -> Override:
    """An override. A value that Hydra cannot read is plain text, unless it begins with a bracket or quote: ``~/data``,
    ``münchen``, ``runs/seed=1``."""
    name, equals, value = text.partition("=")
    if not equals and not text.startswith("~"):
        folder = text.split("/")[0]
        hint = f", such as {FOLDERS[folder]}={text}" if folder in FOLDERS else ""
        raise UserError(f"'{text}' is not an override; write key=value{hint}")
    text = re.sub(r"(?<=[\[,])~[^,\]'\"]*", lambda found: as_override(found.group()), text)
    parser = OverridesParser.create()
    try:
        try:
            return parser.parse_override(text)
        except HydraException:
            if value[:1] in ("", *"[{('\""):
                raise
            return parser.parse_override(f"{name}={as_override(value)}")
    except (HydraException, RecursionError) as error:
        reason = str(error).splitlines()[0]
        raise UserError(
            f"cannot read the override: {reason}; quote lists for the shell: 'key=[a,b]', and odd text for Hydra too:"
            " \"key='(a)'\""
        ) from error


def first(override: Override) -> str:
    """The override as it is in the first job of a sweep."""
    if not override.is_choice_sweep():
        return str(override.input_line)
    name = str(override.input_line).partition("=")[0]
    return f"{name}={as_override(values(override)[0])}"


def values(override: Override) -> list[Any]:
    """The value, or each of a sweep's; none where a sweep computes them."""
    if not override.is_sweep_override():
        return [override.value()]
    if not override.is_choice_sweep():
        return []
    listed: Any = override.value()
    return [Override._convert_value(value) for value in listed.list]


def check_type(key: str, value: Any, default: Any) -> None:
    """A value must be of its default's kind. Nothing is known where that is null or a reference."""
    if isinstance(default, str) and "${" in default:
        return
    if not isinstance(default, str) and any(
        isinstance(each, float) and not math.isfinite(each) for each in (value if isinstance(value, list) else [value])
    ):
        raise UserError(f"{key}={value} is not a finite number")
    text, old = f"{key}={'null' if value is None else value}", "false" if default is False else "true"
    if isinstance(default, dict) and isinstance(value, dict):
        for inner in map(str, value):
            if inner not in default and not accepts(default.get("_target_"), inner):
                raise UserError(f"unknown key '{inner}' in {key}; {nearest(inner, list(default))}")
            if inner in default:
                check_type(f"{key}.{inner}", value[inner], default[inner])
    elif isinstance(default, bool):
        if not isinstance(value, bool):
            raise UserError(f"{text} is not true or false; the default is {old}")
    elif isinstance(default, int | float):
        kinds, name = (int, "whole number") if isinstance(default, int) else (int | float, "number")
        if not isinstance(value, kinds) or isinstance(value, bool):
            raise UserError(f"{text} is not a {name}; the default is {default}")
    elif isinstance(default, list) and not isinstance(value, list):
        like_default = [value] * max(len(default), 1) if all(isinstance(x, int | float) for x in default) else [value]
        raise UserError(f"{text} is not a list; write '{key}={as_override(like_default)}'")
    elif isinstance(default, str) and (
        (value is None and key not in CAN_BE_NULL) or (isinstance(value, list | dict) and key not in LISTS)
    ):
        raise UserError(f"{text} is not a name{'' if default == '???' else f'; the default is {default}'}")


def nearest(word: str, options: list[str]) -> str:
    """What a user may have meant by a word that is none of these."""
    close = difflib.get_close_matches(word, options, n=2, cutoff=0.5)
    if close:
        return f"did you mean {' or '.join(close)}?"
    return f"there are {', '.join(options[:12])}{', ...' if len(options) > 12 else ''}"


def keys(node: Any, prefix: str = "") -> Iterator[str]:
    """Dotted names of every key of a config, inner ones too."""
    if OmegaConf.is_dict(node):
        for key in node:
            yield f"{prefix}{key}"
            if not OmegaConf.is_missing(node, key) and not OmegaConf.is_interpolation(node, key):
                yield from keys(node[key], f"{prefix}{key}.")
