"""Imports run one way: from a later stage of the pipeline to an earlier one, never back.

Lazy imports (inside functions) and those under ``TYPE_CHECKING`` count: they are dependencies all the same.
"""

import ast
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("data_gen", "fusion_net", "fusion_lab")
LARGEST_FOLDER = 14
"""Entries of a folder of code, sub-folders included and ``__init__.py`` not counted."""


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))}


def imported_names(module: str) -> set[str]:
    """Dotted names of everything that a module imports anywhere in its text, modules and what is taken from them."""
    found = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def imports_of(module: str) -> set[str]:
    """Modules of this repository that a module imports."""
    names = imported_names(module)
    found = {name if name in MODULES else name.rpartition(".")[0] for name in names}
    return {name for name in found if name in MODULES and name != module}


IMPORTS = {module: imports_of(module) for module in MODULES}


def folder_of(module: str) -> str:
    return module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]


def assert_no_circle(graph: dict[str, set[str]]) -> None:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"imports run in a circle: {' <- '.join(error.args[1])}")


def test_no_module_imports_in_a_circle():
    assert_no_circle(IMPORTS)


def test_no_folder_imports_in_a_circle():
    folders: dict[str, set[str]] = {folder_of(module): set() for module in MODULES}
    for module, imported in IMPORTS.items():
        folders[folder_of(module)] |= {folder_of(name) for name in imported} - {folder_of(module)}
    assert_no_circle(folders)


def crossings(importer: str, imported: str) -> list[str]:
    """Imports from one package into another, as sentences."""
    pairs = [(m, n) for m, names in IMPORTS.items() for n in sorted(names)]
    return [f"{m} imports {n}" for m, n in pairs if m.startswith(importer) and n.startswith(imported)]


def test_the_network_never_imports_the_generator():
    assert not crossings("fusion_net", "data_gen")


def test_the_generator_imports_only_what_both_share():
    assert set(crossings("data_gen", "fusion_net")) == set(crossings("data_gen", "fusion_net.common"))


def test_the_lab_is_above_both_and_nothing_imports_it():
    assert crossings("fusion_lab", "fusion_net")
    assert crossings("fusion_lab", "data_gen")
    assert not crossings("fusion_net", "fusion_lab")
    assert not crossings("data_gen", "fusion_lab")


def test_only_the_page_of_the_lab_knows_the_browser():
    """All else of it is tested without the extra."""
    users = {module for module in MODULES if any(name.split(".")[0] == "nicegui" for name in imported_names(module))}
    assert {module.rpartition(".")[0] for module in users} == {"fusion_lab.page"}


def test_only_recordings_know_rerun():
    """All else of the command is tested without the extra, and says that it is missing."""
    users = {module for module in MODULES if any(name.split(".")[0] == "rerun" for name in imported_names(module))}
    assert {module.rpartition(".")[0] for module in users} == {"fusion_net.viz.rerun_log"}
    assert not {"fusion_net.viz.rerun_log.__main__", "fusion_net.viz.rerun_log.write"} & users


def test_model_files_know_neither_hydra_nor_lightning():
    for module in (m for m in MODULES if m.startswith("fusion_net.models.")):
        packages = {name.partition(".")[0] for name in imported_names(module)}
        assert not packages & {"hydra", "lightning", "omegaconf"}, module


def test_the_shared_format_needs_nothing_but_python():
    """The environment of the nuScenes devkit, which has an older numpy and no torch, imports it too."""
    packages = {name.partition(".")[0] for name in imported_names("fusion_net.common.nuscenes_format")}
    assert packages <= sys.stdlib_module_names


@pytest.mark.parametrize("folder", sorted({path.parent for path in MODULES.values()}), ids=lambda p: p.name)
def test_a_folder_is_small_enough_to_be_taken_in_at_once(folder):
    entries = [p.name for p in folder.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()]
    assert len(set(entries) - {"__init__.py"}) <= LARGEST_FOLDER, sorted(entries)


def test_every_folder_is_a_package():
    assert not [path for path in MODULES.values() if not (path.parent / "__init__.py").exists()]


TESTS = sorted((ROOT / "tests").rglob("test_*.py"))


@pytest.mark.parametrize("path", TESTS, ids=lambda p: p.stem)
def test_a_test_file_stands_where_its_subject_does_and_needs_no_other_test_file(path):
    """What several of them use lies in tests/fixtures."""
    assert (ROOT / path.parent.relative_to(ROOT / "tests")).is_dir()
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    imported = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    imported += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    assert not [
        name for name in imported if name.rpartition(".")[2].startswith("test_") or name.startswith("benchmarks")
    ]
