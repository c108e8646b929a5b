"""The commands and the Python of README and docs, given one after the other in one working folder as a reader gives them.

Small, as ``tests/fixtures/doc_table.py`` says, each command once, in the order of its table: data, runs, evaluations, reports.
Each is a fork of one Python that has imported the project, since imports take longer than most of these commands.
"""

import os
import shutil

import pytest

from tests.fixtures.doc_blocks import ROOT, Block, Command, block_commands, blocks
from tests.fixtures.doc_names import GIVEN
from tests.fixtures.doc_reader import Reader
from tests.fixtures.doc_table import SMALL, prepared, why_not
from tests.fixtures.warm_python import WarmPython

pytestmark = pytest.mark.slow
IMPORTS = (
    "lightning.pytorch", "matplotlib.pyplot", "data_gen.generate", "data_gen.pictures.rig_preview", "fusion_net.fit",
    "fusion_net.evaluate", "fusion_net.reports.tracks.__main__", "fusion_net.viz.animation.__main__",
)  # fmt: skip


def commands() -> list[Command]:
    """Every command that is run, as it is run, once."""
    given = [each for each in block_commands() if why_not(each) is None and each.program.startswith("python")]
    small = {each.text: each for each in (prepared(command, small=True) for command in given)}
    return sorted(small.values(), key=lambda command: list(SMALL).index(command.program))


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    """In a folder with the results that are committed, but for those of the sweep that is run, small, here: they are of other
    scenes, which the report refuses to compare."""
    reader = Reader(tmp_path_factory.mktemp("reader") / "work")
    reader.write_settings()
    others = shutil.ignore_patterns("dropout")
    shutil.copytree(ROOT / "docs" / "results", reader.folder / "docs" / "results", ignore=others)
    return reader


@pytest.fixture(scope="module")
def python(reader):
    environment = os.environ | {"HOME": str(reader.home), "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    python = WarmPython(imports=IMPORTS, environment=environment)
    yield python
    python.close()


@pytest.mark.parametrize("command", commands(), ids=lambda command: command.text)
def test_a_command_ends_well(command: Command, reader, python):
    program = list(command.words[1:3]) if command.words[1] == "-m" else [str(ROOT / command.words[1])]
    code, _, error = python.run([*program, *reader.arguments(command)], reader.folder)
    assert code == 0, f"{command.where}: {command.text}\n{error}"


@pytest.mark.parametrize(
    "block", [each for each in blocks("python") if any(each.text.startswith(start) for start in GIVEN)],
    ids=lambda block: block.where,
)  # fmt: skip
def test_a_block_of_python_runs(block: Block, reader, monkeypatch):
    monkeypatch.chdir(reader.folder)
    names = next(given for start, given in GIVEN.items() if block.text.startswith(start))()
    exec(compile(block.text, block.where, "exec"), names)
