"""The docs as a site: it builds without a warning, asks no other machine for anything, and says what the code says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[3]
DOCS = ROOT / "docs"
sys.path.insert(0, str(ROOT / "tools" / "docs"))
from settings import settings_of, settings_reference  # noqa: E402
from shapes import PAGE, shapes_page  # noqa: E402


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
    assert "| `trainer.max_lr` | `3.0e-3` |" in page
    assert "| `model.encoders.lidar.pillar` | `0.4` | metres |" in page


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
        fixed = re.sub(r"data/nano|runs/deom|there are demo", "\0", message)  # what the user's own names stand in for
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
