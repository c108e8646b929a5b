"""The configuration reference: every key of ``configs/`` with its default and its comment, as Markdown.

Reads the files as text, so that the page says what they say; nothing of the project is imported.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import yaml

NOT_SETTINGS = ("defaults", "hydra")
PREFIX = {"detector": "model"}
"""Folders whose files are read under another name than the folder's."""


def settings_reference(configs: Path) -> str:
    """The reference: the commands first, in the order of their names, then the groups."""
    groups = sorted(path for path in configs.iterdir() if path.is_dir())
    parts = ["## Commands\n", *(_section(path, configs) for path in sorted(configs.glob("*.yaml")))]
    for group in groups:
        parts += [f"## Group `{group.name}`\n", *(_section(path, configs) for path in sorted(group.glob("*.yaml")))]
    return "\n".join(parts)


def settings_of(path: Path, prefix: str = "") -> list[tuple[str, str, str]]:
    """Key, default and comment of every setting of a file, in its order; of a block of keys only if it has a comment."""
    text = path.read_text(encoding="utf-8")
    tree = yaml.compose(text)
    return list(_walk(tree, text, text.splitlines(), prefix)) if isinstance(tree, yaml.MappingNode) else []


def _walk(node: yaml.MappingNode, text: str, lines: list[str], prefix: str) -> Iterator[tuple[str, str, str]]:
    for key, value in node.value:
        if not prefix and key.value in NOT_SETTINGS:
            continue
        name = f"{prefix}{key.value}"
        is_block = isinstance(value, yaml.MappingNode) and not value.flow_style
        is_short = isinstance(value, yaml.ScalarNode) or value.flow_style
        end = value.end_mark if is_short else key.end_mark
        comment = _comment(lines[end.line][end.column :] if end.line < len(lines) else "")
        if is_block:
            if comment:
                yield name, "", comment
            yield from _walk(value, text, lines, f"{name}.")
        else:
            source = text[value.start_mark.index : value.end_mark.index]
            if not isinstance(value, yaml.ScalarNode):  # with comments between its lines
                source = "\n".join(re.sub(r"(^|\s)#.*", "", line) for line in source.splitlines())
            yield name, " ".join(source.split()), comment


def _comment(line: str) -> str:
    found = re.search(r"(?:^|\s)#\s?(.*)", line)
    return found[1].strip() if found else ""


def _section(path: Path, configs: Path) -> str:
    group = path.parent.relative_to(configs).as_posix()
    first = path.read_text(encoding="utf-8").splitlines()
    package = re.match(r"# @package (\S+)", first[0])
    about = []
    for line in first[bool(package) :]:
        if not line.startswith("#"):
            break
        about.append(line.removeprefix("#").strip())
    prefix = "" if group == "." else f"{PREFIX.get(group, group)}."
    if package:
        prefix = "" if package[1] == "_global_" else f"{package[1]}."
    title = f"### `{path.stem}`" if group == "." else f"### `{group}={path.stem}`"
    rows = [f"| `{_cell(key)}` | {_code(value)} | {_cell(note)} |" for key, value, note in settings_of(path, prefix)]
    table = ["| key | default | |", "|---|---|---|", *rows] if rows else []
    return "\n".join([title, "", *(f"    {line}" for line in about), "", *table, ""])


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;")


def _code(text: str) -> str:
    return f"`{text}`" if text else ""
