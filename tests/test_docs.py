"""What README and docs name is there: files, folders, configuration groups."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_paths_in_code_marks_exist(page):
    text = page.read_text(encoding="utf-8")
    paths = re.findall(r"`((?:data_gen|fusion_net|fusion_lab|configs|tests|tools|benchmarks)/[\w./-]*)`", text)
    assert not [path for path in paths if not re.search("NAME|KIND|mine", path) and not (ROOT / path).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page):
    prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    links = re.findall(r"\]\(([^)#:]+)\)", prose)
    assert not [link for link in links if not (page.parent / link).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_modules_that_are_run_exist(page):
    modules = re.findall(
        r"python -m ((?:data_gen|fusion_net|fusion_lab|benchmarks)[\w.]*\w)", page.read_text(encoding="utf-8")
    )
    for module in modules:
        path = ROOT / module.replace(".", "/")
        assert path.with_suffix(".py").exists() or (path / "__main__.py").exists() or "NAME" in module, module
