"""Writes the files of ``examples/recipes`` into the pages of ``docs/recipes`` that show them: ``python tools/docs/recipes.py``.

A block shows a file where the paragraph before it names the file and ends with a colon. A test holds the pages to the files.
"""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs" / "recipes").glob("*.md"))
BLOCK = re.compile(
    r"(?P<before>[^\n]*`(?P<path>examples/recipes/[\w./]+)`[^`\n]*:\n\n```\w+\n)(?P<shown>.*?)```\n", re.DOTALL
)


def shown_files(text: str) -> dict[str, str]:
    """What a page shows of each file that it names so."""
    return {found["path"]: found["shown"] for found in BLOCK.finditer(text)}


def filled(text: str) -> str:
    """The page with every such block as the file has it."""
    return BLOCK.sub(lambda found: f"{found['before']}{(ROOT / found['path']).read_text(encoding='utf-8')}```\n", text)


if __name__ == "__main__":
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        page.write_text(filled(text), encoding="utf-8")
        print(page.relative_to(ROOT), *shown_files(text))
