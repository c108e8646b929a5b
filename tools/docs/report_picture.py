"""Takes the picture of ``docs/report.md``: four parts of a report side by side.

``python tools/docs/report_picture.py runs/demo/eval/report.html``; needs the extra lab-test, and a chromium.
"""

import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tests.fixtures.lab_server import CHROMIUM  # noqa: E402

WIDTH, SCALE = 2480, 0.685
"""Of the page, so that each column is as wide as a report is on a screen, and pixels of the picture to one of it."""
COLUMNS = (("drop-table", "budget"), ("worth", "samples"))
"""Which sections stand in which column, by their headings."""
ARRANGE = """columns => {
  const part = id => {
    const nodes = [document.getElementById(id)];
    for (let node; (node = nodes.at(-1).nextElementSibling) && node.tagName !== "H2"; ) nodes.push(node);
    return id === "samples" ? [nodes.find(node => node.matches("figure.shown"))] : nodes;
  };
  const parts = columns.map(ids => ids.flatMap(part));
  document.body.replaceChildren(...parts.map(nodes => {
    const column = document.createElement("main");
    column.replaceChildren(...nodes);
    column.style.padding = "0";
    return column;
  }));
  document.body.style = "display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 2rem; padding: 0 0.6rem";
}"""
"""What of a report is shown: its sections from a heading to the next, of the samples the first."""


def main() -> None:
    """Takes it."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH, "height": 100}, device_scale_factor=SCALE)
        page.goto(Path(sys.argv[1]).resolve().as_uri())
        page.evaluate(ARRANGE, COLUMNS)
        page.screenshot(path=ROOT / "docs" / "pictures" / "report.jpg", type="jpeg", quality=82, full_page=True)
        browser.close()


if __name__ == "__main__":
    main()
