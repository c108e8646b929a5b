"""The lab in a real browser: it starts, every control changes what it should, nothing is asked of any other machine."""

import re
import time

import pytest

from tests.fixtures.lab_page import ANSWER, IN_A_BROWSER, changes, choose, does, opened, press, settle, shown

pytestmark = IN_A_BROWSER


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
