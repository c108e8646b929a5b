"""Checks a command line before Hydra sees it: every flag, group, option and key must be one that somebody reads.

Hydra alone suggests ``+key=value`` for a typo, which then silently adds a key that nobody reads. Here a key may be added only
where a constructor takes it, and whatever is unknown is answered with the nearest that there is.
"""

import re
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

from hydra.core.override_parser.types import Override
from omegaconf import DictConfig, OmegaConf

from fusion_net.common.cli.command_line import as_override
from fusion_net.common.cli.config_files import COMMANDS, CONFIGS, composed_anew, groups_of, is_written
from fusion_net.common.cli.flags import UserError, read_flags
from fusion_net.common.cli.hints import accepts, arguments
from fusion_net.common.cli.override_values import at, check_type, first, keys, nearest, parsed, values


def check_overrides(config_name: str, argv: list[str]) -> list[str]:
    """The command line as Hydra is to have it: flags first, ``~`` and names that look like numbers in quotes. Raises
    UserError for what does not parse, is of the wrong kind, or is read by nobody."""
    flags, texts, own = read_flags(argv)
    overrides = [parsed(text) for text in texts]
    settings = _settings(config_name, own, overrides)
    swept = [text for text in settings.sweeper if not any(o.key_or_group == text.split("=")[0] for o in overrides)]
    is_multirun = "--multirun" in flags or bool(settings.sweeper)
    everything = [*overrides, *map(parsed, swept)]
    for override in everything:
        settings.check(override)
        if override.is_sweep_override() and not is_multirun:
            raise UserError(
                f"{override.input_line} is a sweep, which needs -m; a list is written 'key=[a,b]' and text with a comma"
                " \"key='a,b'\""
            )
    return [*flags, *(settings.rewritten(override) for override in overrides), *settings.folders_of_jobs(everything)]


class Settings:
    """What a command composes with the groups that are chosen, from the project's folder and from one of the user's own."""

    def __init__(self, config_name: str, own: Path | None, overrides: list[Override]) -> None:
        self.command = config_name
        self.folders = [CONFIGS] if own is None or own.resolve() == CONFIGS else [CONFIGS, own]
        self.groups = groups_of(self.folders)
        plain = _plain(config_name)
        self.base, self.used = set(keys(plain)), set(plain.hydra.runtime.choices)
        chosen = [o for o in overrides if o.key_or_group in self.groups]
        for override in chosen:
            self._check_group(override)
        self.cfg = self._compose([first(override) for override in chosen]) if chosen else deepcopy(plain)
        self.sweeper = [f"{key}={value}" for key, value in (self.cfg.hydra.sweeper.get("params") or {}).items()]
        self.hydra = {f"hydra.{key}" for key in keys(self.cfg.hydra)}
        self._left_out = list(self.cfg.hydra.job.config.override_dirname.exclude_keys)
        OmegaConf.set_struct(self.cfg, False)
        del self.cfg["hydra"]
        self.known = set(keys(self.cfg))
        self.values: Any = OmegaConf.to_container(self.cfg, resolve=False)
        self._check_files(plain, chosen)

    def _check_files(self, plain: DictConfig, chosen: list[Override]) -> None:
        """Raises UserError for what a chosen file sets and nobody reads, or that is of another kind than the default."""
        if not chosen:
            return
        defaults: Any = OmegaConf.to_container(plain, resolve=False)
        try:
            for key in sorted(self.known):
                if not self._is_read(key):
                    raise UserError(self._unknown("key", key))
                value = at(self.values, key)
                if self._target(key) is None and not isinstance(value, dict) and "${" not in str(value):
                    check_type(key, value, at(defaults, key))
        except UserError as error:
            raise UserError(f"{' '.join(str(each.input_line) for each in chosen)}: {error}") from None

    def _compose(self, overrides: list[str]) -> DictConfig:
        more = [f"hydra.searchpath={as_override([f'file://{each.resolve()}' for each in self.folders[1:]])}"]
        return composed_anew(self.command, *more, *overrides)

    def _check_group(self, override: Override) -> None:
        key, options = override.key_or_group, self.groups[override.key_or_group]
        if override.package is not None:
            raise UserError(f"{override.input_line}: settings of '{key}' have their own place; write {key}=NAME")
        if (override.is_delete() or None in values(override)) and key in self.base:
            raise UserError(f"{override.input_line}: '{key}' is needed; choose from {', '.join(options)}")
        if override.is_delete():
            return
        for value in values(override):
            if value is None:
                continue
            if not isinstance(value, str):
                raise UserError(f"{override.input_line} is not a file name; {nearest(str(value), options)}")
            if value not in options:
                raise UserError(f"there is no {key}={value}; {nearest(value, options)}{self._of_the_folder(key)}")
        if key == "sweep" and not override.is_add():
            raise UserError(f"a sweep is added to the settings: write +{override.input_line}")
        if key in self.used and override.is_add():
            raise UserError(f"{override.input_line}: there is one already; write {str(override.input_line)[1:]}")
        if key not in self.used and not override.is_add():
            raise UserError(f"{COMMANDS[self.command]} has no group {key}; {nearest(key, sorted(self.used))}")

    def _of_the_folder(self, group: str) -> str:
        """A hint where the user's folder has nothing of this group."""
        missing = [folder for folder in self.folders[1:] if not (folder / group).is_dir()]
        return "".join(f" ({folder} has no folder {group}/)" for folder in missing)

    def check(self, override: Override) -> None:
        """Raises UserError for a key that nobody reads, or a value of another kind than the default's."""
        key, text = override.key_or_group, str(override.input_line)
        if key in self.groups or key.startswith("hydra/"):
            return
        if key == "hydra.searchpath":
            raise UserError(f"{text}: a folder of your own settings is named by --config-dir DIR")
        if key.startswith("hydra."):
            if key not in self.hydra and not any(key.startswith(f"{each}.") for each in self.hydra):
                raise UserError(f"unknown override '{key}'; {nearest(key, sorted(self.hydra))}")
            return
        if key not in self.known:
            if not self._is_read(key):
                raise UserError(self._unknown("override", key))
            if not override.is_add() and not override.is_force_add():
                raise UserError(f"'{key}' is not in the settings, but can be added: write +{text}")
        elif override.is_add():
            raise UserError(f"'{key}' is in the settings already; write {text[1:]}")
        elif override.is_delete():
            constructor, name = self._target(key) or ("", "")
            known = (arguments(constructor) if constructor else None) or {}
            if name not in known or known[name].default is known[name].empty:
                raise UserError(f"{text}: '{key}' is needed and cannot be taken away; write {key}=VALUE")
        else:
            for value in values(override):
                check_type(key, value, at(self.values, key))

    def folders_of_jobs(self, overrides: list[Override]) -> list[str]:
        """What gives each job of a sweep a folder of its own. UserError when ``name`` is the same for all."""
        swept = [o.key_or_group for o in overrides if o.is_sweep_override()]
        if not swept or "name" not in self.known:
            return []
        names = [o.value() for o in overrides if o.key_or_group == "name"] or [at(self.values, "name")]
        if "name" not in swept and "${" not in str(names[-1]):
            raise UserError(f"all jobs of this sweep would be runs/{names[-1]}; add 'name={names[-1]}_${{{swept[0]}}}'")
        left_out = [key for key in self._left_out if key not in swept]
        return [f"hydra.job.config.override_dirname.exclude_keys={as_override(left_out)}"]

    def rewritten(self, override: Override) -> str:
        """The override, with quotes around what is to be text but would be read as a number: name=2026_01."""
        key, text = override.key_or_group, str(override.input_line)
        if override.is_sweep_override() or override.is_delete() or key not in self.known:
            return text
        default = at(self.values, key)
        is_name = isinstance(default, str) and not re.fullmatch(r"\$\{.*\}", default)
        is_text = is_name and isinstance(override.value(), int | float)
        name, _, value = text.partition("=")
        return f"{name}={as_override(value.strip())}" if is_text else text

    def _is_read(self, key: str) -> bool:
        """Whether the command composes the key without any file of the user's, or a constructor takes it."""
        target = self._target(key)
        if target is None:
            return key in self.base
        constructor, name = target
        return accepts(constructor, name)

    def _target(self, key: str) -> tuple[str, str] | None:
        """The constructor that gets what is at a dotted key, and the argument that it is or is part of."""
        node: Any = self.values
        found = None
        for part in key.split("."):
            if not isinstance(node, dict):
                break
            if isinstance(node.get("_target_"), str):
                found = node["_target_"], part
            node = node.get(part)
        return found

    def _unknown(self, kind: str, key: str) -> str:
        for name, command in COMMANDS.items() if is_written(key) else ():
            if name != self.command and key in set(keys(_kept(name).cfg)):
                return f"{COMMANDS[self.command]} does not read '{key}'; it is a setting of {command}"
        options = (self.known | self.used) - {key}
        target = self._target(key)
        if target is not None:
            parent = key.rsplit(".", 1)[0]
            options |= {f"{parent}.{name}" for name in arguments(target[0]) or () if name not in ("args", "kwargs")}
        return f"unknown {kind} '{key}'; {nearest(key, sorted(options))}"


def _settings(config_name: str, own: Path | None, overrides: list[Override]) -> Settings:
    """Kept where all of it is the project's own, which does not change while a process runs."""
    if own is not None:
        return Settings(config_name, own, overrides)
    groups = groups_of([CONFIGS])
    return _kept(config_name, *(str(each.input_line) for each in overrides if each.key_or_group in groups))


@cache
def _kept(config_name: str, *chosen: str) -> Settings:
    return Settings(config_name, None, [parsed(text) for text in chosen])


@cache
def _plain(config_name: str) -> DictConfig:
    return composed_anew(config_name)
