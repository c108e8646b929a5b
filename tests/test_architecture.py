"""Imports run one way: from a later stage of the pipeline to an earlier one, never back.

Lazy imports (inside functions) and those under ``TYPE_CHECKING`` count: they are dependencies all the same.
"""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("data_gen", "fusion_net")
LARGEST_FOLDER = 14
"""Entries of a folder of code, sub-folders included and ``__init__.py`` not counted."""


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))}


def imports_of(module: str) -> set[str]:
    """Modules of this repository that a module imports anywhere in its text."""
    found = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in MODULES else node.module for name in names}
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


def test_the_network_never_imports_the_generator():
    guilty = {m: names for m, names in IMPORTS.items() if m.startswith("fusion_net")}
    assert not [f"{m} imports {n}" for m, names in guilty.items() for n in names if n.startswith("data_gen")]


def test_the_generator_imports_only_what_both_share():
    shared = ("data_gen", "fusion_net.common")
    guilty = [f"{m} imports {n}" for m, ns in IMPORTS.items() if m.startswith("data_gen") for n in ns if not n.startswith(shared)]
    assert not guilty


def test_model_files_know_neither_hydra_nor_lightning():
    for module in (m for m in MODULES if m.startswith("fusion_net.models.")):
        text = MODULES[module].read_text(encoding="utf-8")
        assert not {"hydra", "lightning", "omegaconf"} & {
            name.split(".")[0]
            for node in ast.walk(ast.parse(text))
            for name in ([a.name for a in node.names] if isinstance(node, ast.Import) else [node.module or ""] if isinstance(node, ast.ImportFrom) else [])
        }, module


def test_the_shared_format_needs_nothing_but_python():
    """The devkit's environment, which has an older numpy and no torch, imports it too."""
    assert not IMPORTS["fusion_net.common.nuscenes_format"]


@pytest.mark.parametrize("folder", sorted({MODULES[m].parent for m in MODULES}), ids=lambda p: str(p.relative_to(ROOT)))
def test_a_folder_is_small_enough_to_be_taken_in_at_once(folder):
    entries = [p for p in folder.iterdir() if p.name not in ("__init__.py", "__pycache__") and (p.is_dir() or p.suffix == ".py")]
    assert len(entries) <= LARGEST_FOLDER, sorted(p.name for p in entries)


def test_every_folder_is_a_package():
    assert not [p for package in PACKAGES for p in (ROOT / package).rglob("*.py") if not (p.parent / "__init__.py").exists()]
