"""Charts that do not lie: bars begin at zero, whiskers lie where the figures say, axes have round numbers."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.reports.page.charts import WIDTH, Bar, Line, bars, lines, ticks
from fusion_net.reports.page.html import Heat, Html, card, page, table
from tests.fixtures.html_page import Page

finite = st.floats(-1000, 1000).filter(lambda value: value == 0 or abs(value) > 1e-6)


def rects(svg):
    return [
        tuple(float(value) for value in found)
        for found in re.findall(r'<rect x="([-\d.]+)" y="([-\d.]+)" width="([-\d.]+)"', svg)
    ]


def zero_of(svg):
    return float(re.search(r'<line class="zero" x1="([-\d.]+)"', svg).group(1))


@given(st.lists(finite, min_size=1, max_size=6))
def test_bars_begin_at_zero_and_are_as_long_as_their_values(values):
    svg = bars([(f"row {i}", [Bar(value, "red")]) for i, value in enumerate(values)], about="values")
    zero, found = zero_of(svg), rects(svg)
    longest = max(abs(value) for value in values)
    for value, (x, _, width) in zip(values, found, strict=True):
        assert (x if value >= 0 else x + width) == pytest.approx(zero, abs=0.11)
        assert 0 <= x <= x + width <= WIDTH + 0.1
        if longest:
            scale = max(width for _, _, width in found) / longest
            assert width == pytest.approx(abs(value) * scale, abs=0.11)


def test_a_whisker_spans_its_interval_on_the_bars_own_scale():
    svg = bars([("a", [Bar(0.5, "red", (0.25, 1.0))])], about="one bar")
    zero, (_, _, width) = zero_of(svg), rects(svg)[0]
    low, high = map(float, re.search(r'd="M([\d.]+) [\d.]+v6m0-3H([\d.]+)m', svg).groups())
    assert low == pytest.approx(zero + width / 2, abs=0.1)
    assert high == pytest.approx(zero + 2 * width, abs=0.1)


def test_what_is_not_known_is_a_dash_and_no_bar():
    svg = bars([("a", [Bar(None, "red")])], about="nothing")
    assert "–" in svg
    assert not rects(svg)


@given(finite, finite)
def test_ticks_are_round_few_and_inside(one, other):
    low, high = sorted((one, other))
    if high - low < 1e-6:
        return
    found = ticks(low, high, 4)
    assert len(found) <= 6
    assert all(low - 1e-9 * abs(low) - 1e-9 <= tick <= high + 1e-9 * abs(high) + 1e-9 for tick in found)


def test_a_line_has_a_gap_where_nothing_is_known():
    svg = lines([Line("a", "red", [(0, 1.0), (1, 2.0), (2, None), (3, 1.0)])], about="a", x_label="x", y_label="y")
    assert svg.count("<polyline") == 1
    assert svg.count("<circle") == 1


def test_a_chart_of_nothing_is_still_a_chart():
    Page(lines([], about="none", x_label="x", y_label="y") + bars([], about="none"))


def test_text_is_escaped_and_html_is_not():
    whole = page(
        "<x>", [card("a < b", Html("<b>bold</b>"), figures=(["<h>"], [["<c>", None, Heat(0.5)]])), table([""], [["&"]])]
    )
    found = Page(whole)
    assert "x" not in found.tags
    assert "c" not in found.tags
    assert len(found.tags["b"]) == 1
    assert "a < b" in found.text
    assert "–" in found.text
    assert len(found.tags["th"]) == 1  # a head of empty texts is left out
