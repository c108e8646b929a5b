"""The lab in a real browser: it starts, every control changes what it should, nothing is asked of any other machine."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlparse

import pytest

from tests.fixtures.untrained_run import write_run

ROOT = Path(__file__).resolve().parents[3]
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytest.importorskip("nicegui", reason="the extra is not installed: python -m pip install -e '.[lab]'")
sync_api = pytest.importorskip(
    "playwright.sync_api", reason="Playwright is not installed: python -m pip install -e '.[lab-test]'"
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium here: apt-get install chromium"),
]
START, ANSWER = 240, 30_000
"""Seconds until the lab listens, scenes and compiled kernels included; milliseconds until an answer."""


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    run = write_run(folder / "run")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "fusion_lab",
        f"run={run}",
        f"port={port}",
        "show=false",
        f"data.root={folder / 'scenes'}",
    ]
    with (folder / "log").open("w") as log:
        lab = subprocess.Popen(
            [*command, "data.num_scenes=2", "data.keyframes=3"], cwd=ROOT, stdout=subprocess.PIPE, stderr=log, text=True,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        for line in lab.stdout:
            if found := re.search(r"http://\S+", line):
                break
        else:
            pytest.fail((folder / "log").read_text())
        yield found.group()
        lab.send_signal(signal.SIGINT)
        lab.wait(timeout=30)
    assert "Traceback" not in (folder / "log").read_text()


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        yield playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])


@pytest.fixture
def context(browser):
    """Tabs that may talk to this machine alone."""
    context, asked = browser.new_context(viewport={"width": 1440, "height": 1000}), []
    context.on("request", lambda request: asked.append(request.url))
    context.on("page", lambda page: page.on("websocket", lambda ws: asked.append(ws.url)))
    wrong = []
    context.on("weberror", lambda error: wrong.append(str(error.error)))
    context.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    yield context
    context.close()
    assert {urlparse(url).hostname for url in asked if urlparse(url).scheme not in ("data", "blob")} == {"127.0.0.1"}
    assert not wrong


def settle(page):
    """Waits until what is shown is what is set."""
    page.locator('[data-testid=status][data-settled="true"]').wait_for(timeout=ANSWER)


def opened(context, address, query=""):
    page = context.new_page()
    page.goto(f"{address}/{query}")
    settle(page)
    return page


def shown(page):
    """What is on the page, by what it is."""
    texts = {name: page.get_by_test_id(name).inner_html() for name in ("score", "panel")}
    pictures = {}
    for name in ("camera", "ground"):
        picture = page.get_by_test_id(f"{name}-picture")
        pictures[name] = picture.locator("img").get_attribute("src")
        pictures[f"{name} boxes"] = picture.locator("svg g g").count(), picture.locator("svg").inner_html()
    return texts | pictures


def choose(page, control, choice):
    page.get_by_test_id(control).click()
    page.get_by_role("option", name=choice, exact=True).click()
    settle_after(page)


def press(page, control, key="ArrowRight", times=1):
    for _ in range(times):
        page.get_by_test_id(control).press(key)
    settle_after(page)


def settle_after(page):
    page.wait_for_timeout(300)  # sliders send what they are at every 50 ms
    settle(page)


def changes(page, act):
    before = shown(page)
    act()
    after = shown(page)
    return {name for name in before if before[name] != after[name]}


BOTH = {"camera", "ground"}


def test_weather_light_and_time_change_what_every_sensor_sees(address, context):
    page = opened(context, address, "?threshold=0.05")
    assert changes(page, lambda: choose(page, "condition", "fog")) >= BOTH
    assert changes(page, lambda: press(page, "severity")) >= BOTH
    assert changes(page, lambda: press(page, "frame", "ArrowLeft")) >= BOTH
    assert changes(page, lambda: choose(page, "scene", "scene 2")) >= BOTH


@pytest.mark.parametrize(
    ("control", "choice", "sees", "not_seen"),
    [
        ("camera", "dead", "camera", "ground"),
        ("camera", "blinded by the low sun", "camera", "ground"),
        ("camera", "stale: an old frame", "camera", "ground"),
        ("lidar", "dead", "ground", "camera"),
        ("lidar", "rained out", "ground", "camera"),
        ("radar", "dead", "ground", "camera"),
        ("radar", "stale: an old frame", "ground", "camera"),
        ("beams", "8", "ground", "camera"),
    ],
)
def test_a_broken_sensor_changes_its_own_picture_and_the_detections(address, context, control, choice, sees, not_seen):
    page = opened(context, address, "?threshold=0.05")
    changed = changes(page, lambda: choose(page, control, choice))
    assert {sees, "ground boxes"} <= changed
    assert not_seen not in changed


def test_calibration_and_clock_displace_what_a_sensor_measured(address, context):
    page = opened(context, address, "?threshold=0.05&turned=lidar&late=lidar")
    for control in ("degrees", "centimetres", "milliseconds"):
        assert {"ground", "ground boxes"} <= changes(page, lambda control=control: press(page, control, times=4))
    page.get_by_test_id("repair").click()
    settle_after(page)
    choose(page, "turned", "camera")
    changed = changes(page, lambda: press(page, "degrees", times=9))
    assert {"camera boxes", "ground boxes"} <= changed
    assert not BOTH & changed


def test_depth_and_threshold_change_the_detections_alone(address, context):
    page = opened(context, address, "?threshold=0.05")
    for choice in ("uniform: unknown", "LiDAR returns", "oracle: exact"):
        changed = changes(page, lambda choice=choice: choose(page, "depth", choice))
        assert "ground boxes" in changed
        assert not BOTH & changed
    assert "ground boxes" in changes(page, lambda: press(page, "threshold", times=6))


VIEWS = {
    "Paint a point": ("paint-offset", "re-painted|another paint"),
    "One pixel's depth": ("depth-confidence", "Click on the image"),
    "Three sensors, one grid": (None, "cells"),
    "The merge point": (None, "handed over"),
    "Why no distance": ("scale-metres", "pixels"),
}


@pytest.mark.parametrize("view", VIEWS)
def test_a_view_opens_says_something_and_follows_its_own_control(address, context, view):
    page = opened(context, address)
    page.get_by_role("radio", name=view, exact=True).click()
    settle_after(page)
    control, words = VIEWS[view]
    assert re.search(words, page.get_by_test_id("panel").inner_text())
    if control:
        assert "panel" in changes(page, lambda: press(page, control, times=3))
    else:
        group = page.get_by_test_id("grid-layer" if "grid" in view else "merge-merge")
        assert (
            "panel" in changes(page, lambda: (group.get_by_role("radio").last.click(), settle_after(page)))
            or "grid" in view
        )


def test_a_click_chooses_the_pixel_whose_depth_is_shown(address, context):
    page = opened(context, address, "?view=depth")
    picture = page.get_by_test_id("view-picture").locator("img")
    assert "panel" in changes(page, lambda: (picture.click(position={"x": 40, "y": 60}), settle_after(page)))
    assert "u=0." in page.url


def test_an_experiment_of_the_guide_is_set_explained_and_linked(address, context):
    page = opened(context, address)
    page.get_by_test_id("step6").click()
    settle_after(page)
    assert "A wet highway at dusk" in page.get_by_test_id("step").inner_text()
    assert "condition=dusk_glare_spray" in page.url
    other = opened(context, address, page.url[len(address) + 1 :])
    for name in ("camera", "ground", "ground boxes", "score"):
        left, right = (shown(each)[name] for each in (page, other))
        assert re.sub("/pictures/[^/]*", "", str(left)) == re.sub("/pictures/[^/]*", "", str(right)), name
    page.get_by_test_id("step2").click()
    settle_after(page)
    assert "no weights of early fusion" in page.get_by_test_id("notice").inner_text()


def test_two_tabs_know_nothing_of_each_other_and_one_may_be_closed(address, context):
    one, two = opened(context, address), opened(context, address)
    before = shown(two)
    choose(one, "condition", "night")
    assert shown(two) == before
    one.close()
    assert "camera" in changes(two, lambda: choose(two, "camera", "dead"))


def test_a_control_that_is_dragged_a_hundred_times_ends_where_it_was_left(address, context):
    page = opened(context, address, "?turned=lidar")
    box = page.get_by_test_id("degrees").bounding_box()
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] / 2, middle)
    page.mouse.down()
    for step in range(100):
        page.mouse.move(box["x"] + box["width"] * (0.5 + 0.4 * (step % 20) / 20), middle)
    page.mouse.move(box["x"] + box["width"] * 0.9, middle)
    page.mouse.up()
    settle_after(page)
    assert "degrees=4" in page.url
    assert "+4" in page.get_by_text(re.compile(r"^[+]4[.]\d°$")).inner_text()


def test_playing_goes_through_the_keyframes_and_stops(address, context):
    page = opened(context, address, "?frame=0")
    page.get_by_test_id("play").click()
    page.get_by_text("keyframe 2 of 3").wait_for(timeout=ANSWER)
    page.get_by_role("button", name="Pause").click()
    settle_after(page)
    still = shown(page)
    page.wait_for_timeout(1500)
    assert shown(page) == still


def test_a_link_that_asks_for_what_is_not_there_gets_a_calm_word(address, context):
    page = opened(context, address, "?condition=sandstorm&camra=dead&degrees=many")
    said = page.get_by_test_id("notice").inner_text()
    assert "sandstorm" in said
    assert "camera" in said
    assert "degrees=many" in said


@pytest.mark.parametrize("width", [390, 1440])
def test_nothing_is_wider_than_the_screen_and_every_control_has_a_name(address, context, width):
    page = context.new_page()
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(f"{address}/?view=depth")
    settle(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for role in ("slider", "combobox", "button", "img"):
        for element in page.get_by_role(role).all():
            named = (
                element.get_attribute("aria-label") or element.get_attribute("aria-labelledby") or element.inner_text()
            )
            assert named or page.locator(f"label[for='{element.get_attribute('id')}']").count(), element.evaluate(
                "e => e.outerHTML"
            )
