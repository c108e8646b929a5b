"""The page for those who hear it, who have no mouse, or whose screen is small."""

import pytest

from tests.fixtures.lab_page import IN_A_BROWSER, does, opened, settle

pytestmark = IN_A_BROWSER
NAMED = {"slider", "combobox", "radio", "button", "image"}
VALUED = {"slider", "combobox"}


@pytest.mark.parametrize("width", [390, 1440])
def test_nothing_is_wider_than_the_screen(address, context, width):
    page = context.new_page()
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(f"{address}/?view=depth")
    settle(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


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
