"""Takes the pictures of ``docs/lab.md``: the page as it looks 1440 and 390 pixels wide, with the shipped weights.

``python tools/docs/lab_pictures.py``; needs the extras lab and lab-test, and a chromium.
"""

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tests.fixtures.lab_server import CHROMIUM, serving  # noqa: E402

STEP = "?level=mid&condition=dusk_glare_spray&severity=3&camera=blinded&lidar=rained+out&scene=2&step=6"
"""The sixth experiment of the guide, on a highway."""
PICTURES = {"lab": (1440, 1120, f"{STEP}&view=depth"), "lab_phone": (390, 1700, STEP)}
"""Of each picture its width, the most of its height, and the link to what it shows."""


def take(page: Page, address: str, name: str) -> None:
    """One picture, when the network has answered and the scene's score is there."""
    width, height, query = PICTURES[name]
    page.set_viewport_size({"width": width, "height": height})
    page.goto(f"{address}/{query}")
    page.locator('[data-testid=status][data-settled="true"]').wait_for(timeout=60_000)
    page.locator('[data-testid=score] >> text="..."').wait_for(state="detached", timeout=120_000)
    page.wait_for_load_state("networkidle")
    page.screenshot(path=ROOT / "docs" / "pictures" / f"{name}.jpg", type="jpeg", quality=82)


def main() -> None:
    """Takes all of them."""
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder)) as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for name in PICTURES:
            take(browser.new_page(), address, name)
        browser.close()


if __name__ == "__main__":
    main()
