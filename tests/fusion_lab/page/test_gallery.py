"""The pictures of open pages: an address never answers with another picture than its own."""

import pytest

pytest.importorskip("nicegui", reason="the extra is not installed: python -m pip install -e '.[lab]'")

from fusion_lab.page.gallery import KEPT, ROUTE, Gallery


def got(gallery, address):
    page, key = address.removeprefix(f"{ROUTE}/").split("/")
    answer = gallery.get(page, key)
    return answer.body if answer.status_code == 200 else None


def test_an_address_keeps_its_picture_while_newer_ones_come_and_is_the_same_for_the_same_picture():
    gallery = Gallery()
    old = gallery.put("tab", "camera", b"old")
    new = gallery.put("tab", "camera", b"new")
    assert (got(gallery, old), got(gallery, new)) == (b"old", b"new")
    assert gallery.put("tab", "camera", b"new") == new


def test_old_pictures_and_those_of_a_closed_page_are_forgotten():
    gallery = Gallery()
    first, other = gallery.put("tab", "camera", b"first"), gallery.put("other tab", "camera", b"first")
    for number in range(KEPT):
        newest = gallery.put("tab", "ground", bytes([number]))
    assert got(gallery, first) is None
    assert got(gallery, newest) is not None
    assert got(gallery, other) == b"first"
    gallery.drop("other tab")
    assert got(gallery, other) is None
