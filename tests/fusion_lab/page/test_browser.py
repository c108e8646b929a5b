"""The lab in a real browser: it starts, every control changes what it should, nothing is asked of any other machine."""

import re
import time
from urllib.parse import urlparse

import pytest

from tests.fixtures.lab_server import CHROMIUM, DRAWN, serving
from tests.fixtures.untrained_run import write_run

pytest.importorskip("nicegui", reason="the extra is not installed: python -m pip install -e '.[lab]'")
sync_api = pytest.importorskip(
    "playwright.sync_api", reason="Playwright is not installed: python -m pip install -e '.[lab-test]'"
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium here: apt-get install chromium"),
]
ANSWER = 30_000
"""Milliseconds until an answer."""


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    run = write_run(folder / "run")
    with serving(folder, f"run={run}", "data.num_scenes=2", "data.keyframes=3") as address:
        yield address
    log = (folder / "log").read_text()
    assert "Traceback" not in log
    assert "deleted" not in log  # nothing was sent to a tab that is closed


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
    page.wait_for_function(DRAWN, timeout=ANSWER)


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
        pictures[f"{name} boxes"] = picture.locator("svg > g").count(), picture.locator("svg").inner_html()
    return texts | pictures


def choose(page, control, choice):
    """A choice by its words, or by its place."""
    page.get_by_test_id(control).click()
    options = page.get_by_role("option")
    (options.nth(choice) if isinstance(choice, int) else page.get_by_role("option", name=choice, exact=True)).click()


def press(page, control, key="ArrowRight", times=1):
    for _ in range(times):
        page.get_by_test_id(control).press(key)


def changes(page, act, expected):
    """What has changed when ``act`` has had its effect: all of ``expected``, or the time is up."""
    before = shown(page)
    act()
    until = time.monotonic() + ANSWER / 1000
    while True:
        page.wait_for_timeout(200)
        settle(page)
        after = shown(page)
        changed = {name for name in before if before[name] != after[name]}
        if expected <= changed or time.monotonic() > until:
            return changed


def does(page, act, *expected):
    """Whether ``act`` changes what is expected."""
    return set(expected) <= changes(page, act, set(expected))


def test_weather_light_and_time_change_what_every_sensor_sees(address, context):
    page = opened(context, address, "?threshold=0.05")
    assert does(page, lambda: choose(page, "condition", "fog"), "camera", "ground")
    assert does(page, lambda: press(page, "severity"), "camera", "ground")
    assert does(page, lambda: press(page, "frame", "ArrowLeft"), "camera", "ground")
    assert does(page, lambda: choose(page, "scene", 1), "camera", "ground")


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
def test_a_broken_sensor_changes_its_own_picture_and_if_dead_the_detections(
    address, context, control, choice, sees, not_seen
):
    page = opened(context, address, "?threshold=0.05")
    expected = {sees, "ground boxes"} if choice == "dead" else {sees}  # to less an untrained network may be blind
    changed = changes(page, lambda: choose(page, control, choice), expected)
    assert expected <= changed
    assert not_seen not in changed


def test_calibration_and_clock_displace_what_a_sensor_measured(address, context):
    page = opened(context, address, "?threshold=0.05&turned=lidar&late=lidar")
    for control in ("degrees", "centimetres", "milliseconds"):
        assert does(page, lambda control=control: press(page, control, times=4), "ground")
    page = opened(context, address, "?threshold=0.05")
    changed = changes(page, lambda: press(page, "degrees", times=9), {"camera boxes", "ground boxes"})
    assert {"camera boxes", "ground boxes"} <= changed
    assert not {"camera", "ground"} & changed


def test_depth_and_threshold_change_the_detections_alone(address, context):
    page = opened(context, address, "?threshold=0.05")
    for choice in ("uniform: unknown", "LiDAR returns", "oracle: exact"):
        changed = changes(page, lambda choice=choice: choose(page, "depth", choice), {"ground boxes"})
        assert "ground boxes" in changed
        assert not {"camera", "ground"} & changed
    assert does(page, lambda: press(page, "threshold", times=6), "ground boxes")


VIEWS = {
    "Paint a point": ("another paint", lambda page: press(page, "paint-offset", times=9)),
    "One pixel's depth": ("Click on the image", lambda page: press(page, "depth-confidence", times=9)),
    "Three sensors, one grid": ("cells", None),
    "The merge point": ("handed over", lambda page: page.get_by_test_id("merge-merge").get_by_text("late").click()),
    "Why no distance": ("pixels", lambda page: press(page, "scale-metres", times=3)),
}
"""Of each view a word that it says, and how its own control is used."""


@pytest.mark.parametrize("view", VIEWS)
def test_a_view_opens_says_something_and_follows_its_own_control(address, context, view):
    page, (words, act) = opened(context, address), VIEWS[view]
    assert does(page, lambda: page.get_by_test_id("view").get_by_text(view, exact=True).click(), "panel")
    assert words in page.get_by_test_id("panel").inner_text()
    assert act is None or does(page, lambda: act(page), "panel")


def test_a_click_chooses_the_pixel_whose_depth_is_shown(address, context):
    page = opened(context, address, "?view=depth")
    picture = page.get_by_test_id("view-picture").locator("img")
    assert does(page, lambda: picture.click(position={"x": 40, "y": 60}), "panel")
    assert "u=0." in page.url


def test_an_experiment_of_the_guide_is_set_explained_and_linked(address, context):
    page = opened(context, address)
    assert does(page, lambda: page.get_by_test_id("step6").click(), "camera", "ground")
    assert "A wet highway at dusk" in page.get_by_test_id("step").inner_text()
    assert "condition=dusk_glare_spray" in page.url
    other = opened(context, address, f"?{page.url.partition(chr(63))[2]}")
    for name in ("camera", "ground", "ground boxes"):
        left, right = (shown(each)[name] for each in (page, other))
        assert re.sub("/pictures/[^/]*", "", str(left)) == re.sub("/pictures/[^/]*", "", str(right)), name
    page.get_by_test_id("step2").click()
    page.wait_for_url(re.compile("level=early"), timeout=ANSWER)  # whose weights are shipped


def test_two_tabs_know_nothing_of_each_other_and_one_may_be_closed(address, context):
    one, two = opened(context, address), opened(context, address)
    before = {name: shown(two)[name] for name in ("camera", "ground", "ground boxes")}
    assert does(one, lambda: choose(one, "condition", "night"), "camera")
    assert {name: shown(two)[name] for name in before} == before
    one.close()
    assert does(two, lambda: choose(two, "camera", "dead"), "camera")


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
    page.wait_for_url(re.compile(r"degrees=4[.]2\b|degrees=4[.]1"), timeout=ANSWER)
    began = time.monotonic()
    settle(page)
    assert time.monotonic() - began < ANSWER / 1000 / 3  # no queue of a hundred answers
    assert re.search(r"[+]4[.][12]°", page.locator("main").inner_text())


def test_playing_goes_through_the_keyframes_and_stops(address, context):
    page = opened(context, address, "?frame=0")
    page.get_by_test_id("play").click()
    page.get_by_text("keyframe 2 of 3").wait_for(timeout=ANSWER)
    page.get_by_role("button", name="Pause").click()
    page.wait_for_timeout(1500)
    settle(page)
    still = shown(page)["camera"]
    page.wait_for_timeout(1500)
    assert shown(page)["camera"] == still


def test_a_link_that_asks_for_what_is_not_there_gets_a_calm_word(address, context):
    page = opened(context, address, "?condition=sandstorm&camra=dead&degrees=many")
    said = page.get_by_test_id("notice").inner_text()
    assert "sandstorm" in said
    assert "camera" in said
    assert "degrees=many" in said


@pytest.mark.parametrize("width", [390, 1440])
def test_nothing_is_wider_than_the_screen(address, context, width):
    page = context.new_page()
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(f"{address}/?view=depth")
    settle(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


NAMED = {"slider", "combobox", "radio", "button", "image"}
VALUED = {"slider", "combobox"}


def accessible(page):
    """What a screen reader is given: role, name and value of each node, and its properties."""
    nodes = page.context.new_cdp_session(page).send("Accessibility.getFullAXTree")["nodes"]
    for node in nodes:
        if not node.get("ignored"):
            found = {name: node.get(name, {}).get("value") for name in ("role", "name", "value")}
            yield found | {each["name"]: each["value"].get("value") for each in node["properties"]}


@pytest.mark.parametrize("view", ["paint", "depth", "grid", "merge", "scale"])
def test_a_screen_reader_is_told_the_name_of_every_control_and_picture_and_the_value(address, context, view):
    page = opened(context, address, f"?view={view}&condition=fog")
    controls = [node for node in accessible(page) if node["role"] in NAMED]
    assert not [node for node in controls if not node["name"]]
    assert not [node for node in controls if node["role"] in VALUED and node["value"] is None]
    names = {node["name"] for node in controls if node.get("focusable")}
    assert {"Severity", "Turned to the left", "Camera", "Weather and light", "mid", "Play", "Nothing wrong"} <= names
    assert page.get_by_test_id("severity").get_attribute("aria-valuetext") == "1 of 3"


def test_the_keyboard_alone_reaches_every_control_and_sets_it(address, context):
    page = opened(context, address, "?condition=fog&view=depth")
    controls = {node["name"] for node in accessible(page) if node["role"] in ("slider", "combobox", "button")}
    for _ in range(2 * len(controls)):
        page.keyboard.press("Tab")
        controls -= {page.evaluate("document.activeElement.ariaLabel")}
        controls -= {node["name"] for node in accessible(page) if node.get("focused")}
    assert not controls
    page.get_by_test_id("degrees").focus()
    assert does(page, lambda: [page.keyboard.press("PageUp") for _ in range(3)], "camera boxes")
    assert page.get_by_test_id("degrees").get_attribute("aria-valuetext").endswith("°")
