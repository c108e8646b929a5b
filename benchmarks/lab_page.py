"""How long a person waits on the lab's page: ``python -m benchmarks.lab_page [PAUSE]``, with the shipped weights.

A fixed series of controls is used in a headless Chromium, the weather twice as often as anything else. Counted is the time
from the key or the click that sets the control, as the browser has it, to the frame in which the new pictures are shown. PAUSE
seconds (0 by default) lie between an answer and the next change: in them the lab works ahead. Needs the extras lab and
lab-test, and a chromium.
"""

import json
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from tests.fixtures.lab_server import CHROMIUM, DRAWN, serving

TARGET_MS = 500.0
WEATHER = ("fog", "night", "rain", "glare", "spray", "dusk", "clear", "dusk, glare, spray")
CLOCK = """
for (const kind of ["keydown", "click"]) addEventListener(kind, () => { window.touched = performance.now() }, true)
"""
SHOWN = f"""async (query) => {{
  const status = document.querySelector("[data-testid=status]")
  const drawn = () => status.dataset.shown === query && {DRAWN}
  while (!drawn()) await new Promise(requestAnimationFrame)
  await new Promise(requestAnimationFrame)
  return performance.now() - window.touched
}}"""
"""Milliseconds from the last key or click until a state's pictures are decoded and drawn."""


def main() -> None:
    """Prints a table and, last, the figures as JSON."""
    pause = float(sys.argv[1]) if len(sys.argv) > 1 else 0.0
    took: dict[str, list[float]] = {"weather": [], "other": []}
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder)) as address, sync_playwright() as playwright:
        page = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]).new_page()
        page.set_viewport_size({"width": 1440, "height": 1000})
        page.set_default_timeout(120_000)
        page.add_init_script(CLOCK)
        page.goto(address)
        page.locator('[data-testid=status][data-settled="true"]').wait_for()
        for kind, change in series():
            before = page.url
            change(page)
            page.wait_for_function("before => location.href !== before", arg=before)
            took[kind].append(page.evaluate(SHOWN, page.url.partition("?")[2]))
            page.wait_for_timeout(1e3 * pause)
    report(took, pause)


def series():
    """What is done, and whether it is the weather: at each of three keyframes every condition, its severities, and between
    them a sensor's health, calibration, clock, beams, threshold, depth and the level of fusion."""
    others = [
        choose("camera", 2), choose("camera", 0), choose("lidar", 1), choose("lidar", 0), press("degrees", "ArrowRight"),
        press("degrees", "PageUp"), press("milliseconds", "PageUp"), press("milliseconds", "Home"), choose("beams", 2),
        choose("beams", 0), press("threshold", "ArrowLeft"), press("threshold", "ArrowRight"), choose("depth", 1),
        choose("depth", 0), level("late"), level("early"), level("mid"), choose("radar", 1), choose("radar", 0),
        choose("scene", 1), choose("scene", 2), choose("scene", 0),
    ]  # fmt: skip
    waiting = iter(others)
    for _ in range(3):
        yield "other", press("frame", "ArrowLeft")
        for name in WEATHER:
            yield "weather", choose("condition", name)
            if name not in ("clear", "night", "dusk"):
                yield "weather", another_severity
            if change := next(waiting, None):
                yield "other", change


def choose(control: str, option: str | int):
    """Sets a list to an option, by its words or its place."""

    def change(page: Page) -> None:
        page.get_by_test_id(control).click()
        options = page.get_by_role("option")
        chosen = options.nth(option) if isinstance(option, int) else page.get_by_role("option", name=option, exact=True)
        chosen.click()

    return change


def press(control: str, key: str):
    """Presses a key on a slider."""
    return lambda page: page.get_by_test_id(control).press(key)


def another_severity(page: Page) -> None:
    """The next worse severity, or from the worst the one before."""
    slider = page.get_by_test_id("severity")
    slider.press("ArrowLeft" if slider.input_value() == slider.get_attribute("max") else "ArrowRight")


def level(name: str):
    """Chooses where the sensors are fused."""
    return lambda page: page.get_by_test_id("level").get_by_text(name).click()


def report(took: dict[str, list[float]], pause: float) -> None:
    """Prints the table and the JSON."""
    rows = {"all": took["weather"] + took["other"]} | took
    print(f"{pause:g} s between an answer and the next change; load of the machine {os.getloadavg()[0]:.1f}")
    print(f"{'changes':10} {'count':>6} {'median ms':>10} {'95 % ms':>8} {'longest ms':>11}")
    figures: dict[str, float] = {"pause_s": pause}
    for name, values in rows.items():
        middle, most, longest = np.quantile(values, (0.5, 0.95, 1.0)).tolist()
        print(f"{name:10} {len(values):6} {middle:10.0f} {most:8.0f} {longest:11.0f}")
        figures |= {f"{name}_median_ms": round(middle, 1), f"{name}_p95_ms": round(most, 1)}
    print(f"target: {TARGET_MS:.0f} ms")
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
