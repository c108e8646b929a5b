"""The reference of commands: make targets, commands of ``configs/``, benchmarks and tools, with what they say of themselves.

Reads files as text; nothing of the project is run.
"""

import ast
import re
from pathlib import Path

import yaml

SCRIPTS = ("benchmarks", "tools/devkit", "tools/docs")
"""Folders of scripts that are no commands of ``configs/``."""


def commands_reference(root: Path) -> str:
    """The reference as Markdown."""
    parts = ["## Make", "", "| | |", "|---|---|"]
    parts += [f"| `make {name}` | {about} |" for name, about in make_targets(root / "Makefile").items()]
    parts += ["", "## Training, data, reports", ""]
    for path in sorted((root / "configs").glob("*.yaml")):
        parts += _command(path)
    for folder in SCRIPTS:
        parts += [f"## `{folder}/`", "", "| | |", "|---|---|"]
        parts += [f"| `{call}` | {about} |" for call, about in scripts(root, folder).items()]
        parts.append("")
    return "\n".join(parts)


def make_targets(makefile: Path) -> dict[str, str]:
    """What each target is for: the comments at the top, the comment above the target, or its first command."""
    text = makefile.read_text(encoding="utf-8")
    variables = dict(re.findall(r"^(\w+) *\??= *(.+)$", text, re.MULTILINE)) | {"RUN": "python"}
    about = dict(re.findall(r"make (\w[\w-]*) {2,}(.+?)(?= {3,}make |$)", text, re.MULTILINE))
    for above, name, first in re.findall(r"(?:^# (.+)\n)?^([a-z-]+):.*\n(?:\t(.+))?", text, re.MULTILINE):
        for _ in range(2):  # a variable may name another
            first = re.sub(r"\$\((\w+)\)", lambda found: variables.get(found[1], found[0]), first)
        about.setdefault(name, above or (f"`{first}`" if first else ""))
    names = re.search(r"^\.PHONY: (.+)$", text, re.MULTILINE)
    return {name: about.get(name, "") for name in (names[1].split() if names else about)}


def _command(path: Path) -> list[str]:
    settings = yaml.safe_load(path.read_text(encoding="utf-8"))
    text = settings["hydra"]["help"]["template"].split("Groups (group=option)")[0].rstrip()
    named = [each for each in settings["defaults"] if isinstance(each, dict)]
    groups = [key for each in named for key in each if not key.startswith("override ")]
    title = re.match(r"# (python (?:-m )?\S+)", path.read_text(encoding="utf-8"))
    call = title[1] if title else f"python {path.stem}.py"
    lines = [f"### `{call}`", "", *(f"    {line}".rstrip() for line in text.splitlines()), ""]
    return [*lines, f"Groups: {', '.join(f'`{group}`' for group in groups)}.", ""] if groups else lines


def scripts(root: Path, folder: str) -> dict[str, str]:
    """How each script of a folder is run, and the first sentence of its docstring."""
    found = {}
    for path in sorted((root / folder).glob("*.py")):
        source = path.read_text(encoding="utf-8")
        about = ast.get_docstring(ast.parse(source))
        if about and "__main__" in source:
            name = f"python -m {folder}.{path.stem}" if folder == "benchmarks" else f"python {folder}/{path.name}"
            found[name] = re.split(r"(?<=[.:;])\s|\n\n", " ".join(about.split("\n\n")[0].split()))[0].rstrip(":;")
    return found
