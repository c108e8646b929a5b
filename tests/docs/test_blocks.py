"""What README and docs ask a reader to type: each command and block is tried in some way, settings exist, Python compiles.

Those that are run: ``test_blocks_run.py``.
"""

import importlib
import re
import sys
import tomllib

import pytest

from fusion_net.common.cli import command as front_door
from fusion_net.common.cli.command import UserError
from fusion_net.common.cli.config_files import COMMANDS
from fusion_net.common.cli.overrides import check_overrides
from tests.fixtures.doc_blocks import PAGES, ROOT, UNFENCED, Command, block_commands, blocks, inline_commands, recipe
from tests.fixtures.doc_names import GIVEN, ONLY_COMPILED
from tests.fixtures.doc_reader import Reader
from tests.fixtures.doc_table import NOT_RUN, RENAMED, RUN_ELSEWHERE, SMALL, SMALLER, YAML, prepared, why_not

TABLE = "tests/fixtures/doc_table.py"
NAMES = "tests/fixtures/doc_names.py"
HYDRA = {f"python {command.removeprefix('python ')}" for command in COMMANDS.values()}
IN_BLOCKS, INLINE = block_commands(), inline_commands()
TARGETS = sorted({" ".join(each.arguments) for each in IN_BLOCKS + INLINE if each.program == "make"})


class ReadyError(Exception):
    """A command has come to the point where its overrides are checked."""


def at_the_front_door(command: Command, arguments: list[str], monkeypatch) -> tuple[str, list[str]]:
    """The name of the settings that a program reads and its overrides, as its own main function makes them."""

    def stop(config_name: str, overrides: list[str]):
        raise ReadyError(config_name, overrides)

    name = command.words[2] if command.words[1] == "-m" else command.words[1].removesuffix(".py")
    if (ROOT / name.replace(".", "/") / "__main__.py").exists():
        name = f"{name}.__main__"
    monkeypatch.setattr(front_door, "check_overrides", stop)
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    with pytest.raises(ReadyError) as ready:
        importlib.import_module(name).main()
    return ready.value.args


def test_every_block_names_its_language():
    known = ("sh", "bash", "python", "yaml", "text")
    wrong = [block.where for block in blocks() if block.language not in known]
    assert not wrong, f"a block begins with ``` and one of {', '.join(known)}"
    for page in PAGES:
        found = UNFENCED.search((ROOT / page).read_text(encoding="utf-8"))
        assert not found, f"{page}: put ```sh above and ``` below {found[0].strip()}"


def test_every_command_is_run_or_has_its_reason():
    lost = [
        f"{each.where}: {each.text}: enter {each.program} in SMALL, or a reason in NOT_RUN, of {TABLE}"
        for each in IN_BLOCKS
        if each.program not in SMALL and why_not(each) is None
    ] + [
        f"{each.where}: {each.text}: enter a reason in NOT_RUN of {TABLE}"
        for each in INLINE
        if each.program not in HYDRA and why_not(each) is None
    ]
    assert not lost, "\n".join(lost)


def test_no_entry_of_the_tables_is_left_over():
    commands = [prepared(each, small=False) for each in IN_BLOCKS + INLINE]
    texts = [each.text for each in commands] + [each.text for each in IN_BLOCKS + INLINE]
    for table in (SMALL, SMALLER, NOT_RUN):
        assert not [entry for entry in table if not any(text.startswith(entry) for text in texts)]
    assert not [page for page in RUN_ELSEWHERE if not any(each.where.startswith(page) for each in IN_BLOCKS)]
    assert not [part for part in RENAMED if not any(part in text for text in texts)]
    first = [block.text for block in blocks("python", "yaml")]
    assert not [entry for entry in (*GIVEN, *ONLY_COMPILED, *YAML) if not any(t.startswith(entry) for t in first)]


def test_the_settings_of_every_command_exist(tmp_path, monkeypatch):
    """Also of the recipes of ``make``, and of those that are run as they are run."""
    reader = Reader(tmp_path)
    reader.write_settings()
    commands = IN_BLOCKS + INLINE + [each for target in TARGETS for each in recipe(target)]
    mistakes = []
    for command in {each.text: prepared(each, small=False) for each in commands if each.program in HYDRA}.values():
        config_name, overrides = at_the_front_door(command, reader.arguments(command), monkeypatch)
        try:
            check_overrides(config_name, overrides)
        except UserError as error:
            mistakes.append(f"{command.where}: {command.text}: {error}")
    assert not mistakes, "\n".join(mistakes)


def test_blocks_of_settings_are_read(tmp_path):
    reader = Reader(tmp_path)
    reader.write_settings()
    for block in blocks("yaml"):
        group, _, name = YAML[block.first_line][0].removesuffix(".yaml").partition("/")
        check_overrides("data_gen", ["--config-dir", str(reader.home / "bev"), f"{group}={name}"])


def test_scripts_have_the_flags_that_they_are_given():
    for each in IN_BLOCKS + INLINE:
        script = next((word for word in each.words[:2] if word.endswith((".py", ".sh"))), None)
        if script and each.program not in HYDRA:
            text = (ROOT / script).read_text(encoding="utf-8")
            flags = [word for word in each.arguments if word.startswith("--")]
            assert not [flag for flag in flags if f'"{flag}"' not in text], each


def test_extras_that_are_installed_exist():
    known = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    for page in PAGES:
        for named in re.findall(r"'\.\[([\w,-]+)\]'", (ROOT / page).read_text(encoding="utf-8")):
            assert set(named.split(",")) <= known.keys(), f"{page}: .[{named}]"


@pytest.mark.parametrize("block", blocks("python"), ids=lambda block: block.where)
def test_python_compiles_and_is_run_or_has_its_reason(block):
    compile(block.text, block.where, "exec")
    assert any(block.text.startswith(entry) for entry in (*GIVEN, *ONLY_COMPILED)), (
        f"{block.where}: enter what it takes for given in GIVEN, or a reason in ONLY_COMPILED, of {NAMES}"
    )


@pytest.mark.parametrize("block", blocks("yaml"), ids=lambda block: block.where)
def test_yaml_has_its_place(block):
    assert block.first_line in YAML, f"{block.where}: enter the file of settings that it is in YAML of {TABLE}"
