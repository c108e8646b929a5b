"""The docs as a site: it builds without a warning, asks no other machine for anything, and says what the code says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from omegaconf import OmegaConf

from fusion_net.common.cli.composed import composed
from fusion_net.common.cli.config_files import COMMANDS

ROOT = Path(__file__).resolve().parents[3]
DOCS = ROOT / "docs"
sys.path.insert(0, str(ROOT / "tools" / "docs"))
from commands import commands_reference, make_targets  # noqa: E402
from settings import settings_of, settings_reference  # noqa: E402
from shapes import PAGE, shapes_page  # noqa: E402
from worked import PAGES as WORKED  # noqa: E402
from worked import worked  # noqa: E402


def pages_of(entry) -> list[str]:
    """The pages of a part of the navigation."""
    if isinstance(entry, str):
        return [entry]
    parts = entry if isinstance(entry, list) else entry.values()
    return [page for part in parts for page in pages_of(part)]


def test_every_page_has_its_place_in_the_navigation():
    nav = pages_of(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"])
    assert len(nav) == len(set(nav))
    assert set(nav) == {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}


def test_settings_have_their_defaults_and_comments(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "defaults: [a]\nrate: 1.0e-3 # of learning\nname: 'a # b'\npart: # two\n  - x\n  - y\n"
        "head:\n  sizes: {car: 2.0,\n    bus: 3.0} # m\nloss: # weighed\n  focal: ${rate}\n"
    )
    assert settings_of(path, "") == [
        ("rate", "1.0e-3", "of learning"),
        ("name", "'a # b'", ""),
        ("part", "- x - y", "two"),
        ("head.sizes", "{car: 2.0, bus: 3.0}", "m"),
        ("loss", "", "weighed"),
        ("loss.focal", "${rate}", ""),
    ]


def test_the_reference_has_every_command_and_group():
    page = settings_reference(ROOT / "configs")
    for path in (ROOT / "configs").rglob("*.yaml"):
        group = path.parent.relative_to(ROOT / "configs").as_posix()
        assert (f"### `{path.stem}`" if group == "." else f"### `{group}={path.stem}`") in page
    assert "| `trainer.max_lr` | `6.0e-3` |" in page
    assert (
        "| `model.encoders.lidar.pillar` | `null` | metres: the cell, a half or a quarter of it; null: half |" in page
    )


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_the_reference_has_every_key_of_a_command(command):
    """What ``--cfg job`` would print, but for what a chosen file of a group names."""
    page = settings_reference(ROOT / "configs")
    section = page.partition(f"### `{command}`\n")[2].partition("\n### ")[0]
    own = OmegaConf.load(ROOT / "configs" / f"{command}.yaml")
    for key in set(own) - {"defaults", "hydra"}:
        assert re.search(rf"^\| `{key}[`.]", section, re.MULTILINE), key


def test_the_reference_has_every_key_of_the_network():
    """Of all groups together, as ``python train.py`` composes them: nothing is set that the page does not name."""
    page = settings_reference(ROOT / "configs")
    named = set(re.findall(r"^\| `([\w.]+)`", page, re.MULTILINE))
    cfg = OmegaConf.to_container(composed("train"), resolve=False)
    missing = [key for key in leaves(cfg) if not any(part in named for part in prefixes(key)) and "_target_" not in key]
    assert not missing


def leaves(node, prefix=""):
    for key, value in node.items():
        yield from leaves(value, f"{prefix}{key}.") if isinstance(value, dict) and value else [f"{prefix}{key}"]


def prefixes(key):
    parts = key.split(".")
    return [".".join(parts[: i + 1]) for i in range(len(parts))]


def test_the_commands_have_their_help_and_every_target_of_make_is_there():
    page = commands_reference(ROOT)
    for name, call in COMMANDS.items():
        title = call if call.startswith("python") else f"python {call}"
        assert f"### `{title}`\n\n    " in page, name
    targets = make_targets(ROOT / "Makefile")
    assert {"demo", "try", "test", "check", "docs", "lint", "devkit"} <= set(targets)
    assert all(targets.values())
    assert all(f"| `make {name}` |" in page for name in targets)
    assert "`python -m benchmarks.splat`" in page
    assert "`python tools/devkit/check.py`" in page


@pytest.mark.parametrize("page", WORKED, ids=lambda page: page.stem)
def test_the_worked_numbers_are_what_the_code_prints(page):
    text = page.read_text(encoding="utf-8")
    assert text == worked(text), "write it again: python tools/docs/worked.py"


def test_the_page_of_shapes_is_what_the_network_does():
    assert PAGE.read_text(encoding="utf-8") == shapes_page(), "write it again: python tools/docs/shapes.py"


def test_the_messages_of_the_faq_exist():
    code = "".join(
        path.read_text(encoding="utf-8")
        for package in ("fusion_net", "fusion_lab", "data_gen")
        for path in (ROOT / package).rglob("*.py")
    )
    code = re.sub(r'"\s*\n\s*f?"', "", code)  # a message over two lines
    messages = re.findall(r'^\*\*"(.+?)"\*\*', (DOCS / "faq.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert len(messages) > 10
    for message in messages:
        fixed = re.sub(r"data/nano|runs/deom|runs/demo", "\0", message)  # what the user's own names stand in for
        assert all(part.strip() in code for part in fixed.split("\0")), message


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_needs_no_other_host(tmp_path):
    pytest.importorskip("mkdocs", reason="the extra is missing: pip install -c constraints.txt -e '.[docs]'")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(
        command, cwd=ROOT, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    pages = list((tmp_path / "site").rglob("*.html"))
    assert len(pages) > 25
    for page in pages:
        html = page.read_text(encoding="utf-8")
        fetched = re.findall(r'<(?:script|img|iframe)[^>]+src="([^"]+)"|<link[^>]+href="([^"]+)"', html)
        assert not [url for pair in fetched for url in pair if re.match(r"(https?:)?//", url)], page.name
