"""The pages of recipes show the files that lie in ``examples/recipes``, and their commands work as they stand."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fixtures.real_tree import write_real_tree

ROOT = Path(__file__).resolve().parents[3]
RECIPES = ROOT / "examples" / "recipes"
DEVKIT = ROOT / ".venv-devkit"
sys.path.insert(0, str(ROOT / "tools" / "docs"))
from recipes import PAGES, filled, shown_files  # noqa: E402

PARTS = (
    "configs",
    "data_gen",
    "fusion_net",
    "fusion_lab",
    "examples",
    "tests",
    "tools",
    "checkpoints",
    "train.py",
    "eval.py",
)
"""What a scratch clone has, so that a recipe may change files."""


def commands(page: Path) -> str:
    """The page's shell blocks as one script."""
    return "".join(re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_shows_the_files_as_they_are(page):
    text = page.read_text(encoding="utf-8")
    assert text == filled(text), "write it again: python tools/docs/recipes.py"


def test_every_file_is_shown_on_a_page():
    shown = {path for page in PAGES for path in shown_files(page.read_text(encoding="utf-8"))}
    files = {
        path.relative_to(ROOT).as_posix() for path in RECIPES.rglob("*.*") if path.is_file() and path.suffix != ".pyc"
    }
    assert shown == files


def test_the_index_links_every_recipe():
    index = next(page for page in PAGES if page.stem == "index").read_text(encoding="utf-8")
    assert {f"({page.name})" for page in PAGES if page.stem != "index"} <= set(re.findall(r"\(\w+\.md\)", index))


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """A copy of the project in which recipes run one after the other."""
    folder = tmp_path_factory.mktemp("clone")
    for name in PARTS:
        source = ROOT / name
        copy = shutil.copytree if source.is_dir() else shutil.copy
        copy(
            source,
            folder / name,
            **({"ignore": shutil.ignore_patterns("__pycache__", "golden")} if source.is_dir() else {}),
        )
    if DEVKIT.exists():
        (folder / DEVKIT.name).symlink_to(DEVKIT)
    write_real_tree(folder / "nuscenes")
    return folder


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=lambda page: page.stem)
def test_the_commands_of_a_recipe_work(page, clone):
    script = commands(page)
    if ".venv-devkit" in script and not DEVKIT.exists():
        pytest.skip("no .venv-devkit; make it with tools/devkit/setup.sh")
    if "launcher=" in script:
        pytest.importorskip("hydra_plugins.hydra_joblib_launcher", reason="pip install -e '.[launchers]'")
    script = script.replace("/data/nuscenes", str(clone / "nuscenes"))
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    done = subprocess.run(
        ["bash", "-euxc", script], cwd=clone, env=environment, capture_output=True, text=True, check=False
    )
    print(done.stdout)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "Traceback" not in done.stderr
