"""Text files are UTF-8 whatever the locale, and what is printed never ends a command."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1]
SOURCES = sorted(
    path for folder in ("fusion_net", "data_gen", "benchmarks", "tools") for path in (PROJECT / folder).rglob("*.py")
)
ASCII = {"PYTHONIOENCODING": "ascii", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def opens_text(call: ast.Call) -> bool:
    """Whether a call opens a text file: ``open`` in no binary mode but ``os.open``, ``read_text`` or ``write_text``."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    if name == "open":
        is_path = isinstance(call.func, ast.Attribute)
        modes = [a.value for a in call.args[0 if is_path else 1 :] if isinstance(a, ast.Constant)]
        owner = getattr(call.func.value, "id", "") if is_path else ""
        return owner not in ("Image", "os") and not any("b" in mode for mode in modes if isinstance(mode, str))
    return name in ("read_text", "write_text")


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PROJECT)))
def test_text_files_are_opened_with_an_encoding(path):
    calls = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
    lines = [c.lineno for c in calls if opens_text(c) and "encoding" not in {k.arg for k in c.keywords}]
    assert not lines


def test_the_statistics_page_is_written_and_its_path_printed_in_an_ascii_locale(tmp_path):
    code = (
        "from pathlib import Path; from tests.fixtures.tiny_tree import write_tree;"
        f"write_tree(Path({str(tmp_path)!r}, 'stra\\xdfe'), scenes=1, keyframes=1)"
    )
    subprocess.run([sys.executable, "-c", code], cwd=PROJECT, check=True)
    root = tmp_path / "straße"
    command = [sys.executable, "-m", "fusion_net.reports.statistics", f"data.root={root}", f"out={tmp_path / 'stra'}"]
    done = subprocess.run(command, cwd=PROJECT, env=os.environ | ASCII, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "1 scenes, 1 keyframes" in done.stdout
    page = (tmp_path / "stra/statistics.html").read_text(encoding="utf-8")
    assert "4.8 ± 7.6" in page
    assert "/straße" in page
