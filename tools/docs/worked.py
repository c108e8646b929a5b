"""Runs Python blocks of the docs and writes what they print below them: ``python tools/docs/worked.py``.

A block's output is the block without a language that follows it. A test holds the pages to it.
"""

import contextlib
import io
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"```python\n(?P<code>.*?)```\n\n```\n(?P<printed>.*?)```\n", re.DOTALL)
CANDIDATES = (ROOT / "docs" / "conventions.md", *sorted((ROOT / "docs" / "learn").glob("*.md")))
PAGES = [path for path in CANDIDATES if BLOCK.search(path.read_text(encoding="utf-8"))]


def worked(text: str) -> str:
    """The page with the output of each block below it. A page's blocks share their names, in order."""
    names: dict = {"__name__": "page"}

    def run(found: re.Match) -> str:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(found["code"], "page", "exec"), names)
        return f"```python\n{found['code']}```\n\n```\n{printed.getvalue()}```\n"

    return BLOCK.sub(run, text)


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(worked(page.read_text(encoding="utf-8")), encoding="utf-8")
        print(page.relative_to(ROOT))
