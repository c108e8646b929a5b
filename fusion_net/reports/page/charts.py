"""Charts as inline SVG that follows the page's colours: bars from zero with intervals, and lines.

They are drawn ``WIDTH`` units wide, the width of a phone, so that their text is readable there and larger elsewhere.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fusion_net.reports.page.html import Html, escaped

WIDTH = 350
CHARACTER = 7.0
"""Units that a letter is wide, about, and rather too much."""


@dataclass(frozen=True)
class Bar:
    """A bar from zero, with an interval [low, high] where one is known."""

    value: float | None
    color: str
    interval: Sequence[float] | None = None
    text: str = ""  # what is written at its end, the value if empty


@dataclass(frozen=True)
class Line:
    """Points (x, y) in a row; None leaves a gap."""

    name: str
    color: str
    points: Sequence[tuple[float, float | None]]
    dashed: bool = False


def bars(rows: Sequence[tuple[str, Sequence[Bar]]], *, about: str, digits: int = 2, top: float | None = None) -> Html:
    """Rows of one bar or several below each other, lying, from zero. ``about``: the chart in a sentence; ``top``: the end of
    the axis, that of the largest interval if None."""
    values = [
        end for _, group in rows for bar in group for end in (bar.value, *(bar.interval or ())) if end is not None
    ]
    low, high = min([0.0, *values]), max([1e-9, *values] if top is None else [top])
    texts = [_text(bar, digits) for _, group in rows for bar in group]
    left = 8 + CHARACTER * max((len(label) for label, _ in rows), default=0)
    right = 10 + CHARACTER * max(map(len, texts), default=0)
    scale = (WIDTH - left - right) / (high - low)
    zero = left - low * scale
    thick = 15 if all(len(group) == 1 for _, group in rows) else 10
    parts, y = [], 4.0
    for tick in ticks(low, high, 4):
        parts.append(
            f'<line class="grid" x1="{zero + tick * scale:.1f}" x2="{zero + tick * scale:.1f}" y1="0" y2="@"/>'
        )
    for label, group in rows:
        middle = y + thick * len(group) / 2
        parts.append(f'<text x="{left - 5:.1f}" y="{middle + 4:.1f}" text-anchor="end">{escaped(label)}</text>')
        for bar in group:
            parts.append(_bar(bar, zero=zero, scale=scale, y=y, thick=thick, digits=digits))
            y += thick
        y += 6
    for tick in ticks(low, high, 4):
        parts.append(
            f'<text class="soft" x="{zero + tick * scale:.1f}" y="{y + 11:.1f}" text-anchor="middle">{_short(tick)}</text>'
        )
    parts.append(f'<line class="zero" x1="{zero:.1f}" x2="{zero:.1f}" y1="0" y2="@"/>')
    return _svg([part.replace('y2="@"', f'y2="{y:.1f}"') for part in parts], y + 16, about)


def lines(
    series: Sequence[Line],
    *,
    about: str,
    x_label: str,
    y_label: str,
    x_range: tuple[float, float] | None = None,
    top: float | None = None,
    height: int = 210,
) -> Html:
    """Lines over a common x axis; y begins at zero."""
    known = [(x, y) for line in series for x, y in line.points if y is not None and math.isfinite(y)]
    x_low, x_high = x_range or (min((x for x, _ in known), default=0.0), max((x for x, _ in known), default=1.0))
    high = top or 1.05 * max([y for _, y in known] or [1.0]) or 1.0
    left, right, bottom, above = 36.0, 10.0, 32.0, 16.0

    def place(x: float, y: float) -> tuple[float, float]:
        across = (x - x_low) / ((x_high - x_low) or 1.0)
        return left + across * (WIDTH - left - right), height - bottom - min(y / high, 1.03) * (height - bottom - above)

    parts = []
    for tick in ticks(0, high, 4):
        _, y = place(x_low, tick)
        parts.append(f'<line class="grid" x1="{left}" x2="{WIDTH - right}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="soft" x="{left - 4}" y="{y + 4:.1f}" text-anchor="end">{_short(tick)}</text>')
    for tick in ticks(x_low, x_high, 5):
        x, _ = place(tick, 0)
        parts.append(
            f'<text class="soft" x="{x:.1f}" y="{height - bottom + 14}" text-anchor="middle">{_short(tick)}</text>'
        )
    parts.append(f'<text class="soft" x="{WIDTH - right}" y="{height - 4}" text-anchor="end">{escaped(x_label)}</text>')
    parts.append(f'<text class="soft" x="4" y="10">{escaped(y_label)}</text>')
    for line in series:
        dash = ' stroke-dasharray="5 4"' if line.dashed else ""
        for run in _unbroken(line.points):
            where = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(*point) for point in run))
            if len(run) == 1:
                x, y = place(*run[0])
                parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.5" style="fill:{line.color}"/>')
            else:
                parts.append(f'<polyline class="line" style="stroke:{line.color}"{dash} points="{where}"/>')
    _, y = place(x_low, 0)
    parts.append(f'<line class="zero" x1="{left}" x2="{WIDTH - right}" y1="{y:.1f}" y2="{y:.1f}"/>')
    return _svg(parts, height, about)


def key(entries: Sequence[tuple[str, str]]) -> Html:
    """What the colours (text, colour) of charts mean."""
    marks = (f'<span><i style="background:{color}"></i>{escaped(text)}</span>' for text, color in entries)
    return Html(f'<div class="key">{"".join(marks)}</div>')


def ticks(low: float, high: float, count: int) -> list[float]:
    """About ``count`` round numbers from ``low`` to ``high``."""
    span = (high - low) or 1.0
    raw = span / count
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= raw * 0.999)
    return [step * i for i in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def _bar(bar: Bar, *, zero: float, scale: float, y: float, thick: float, digits: int) -> str:
    text, middle = _text(bar, digits), y + thick / 2
    if bar.value is None:
        return f'<text class="soft" x="{zero + 4:.1f}" y="{middle + 4:.1f}">{escaped(text)}</text>'
    x, width = zero + min(bar.value, 0) * scale, abs(bar.value) * scale
    parts = [f'<rect x="{x:.1f}" y="{y + 0.5:.1f}" width="{width:.1f}" height="{thick - 1}" style="fill:{bar.color}"/>']
    end = zero + max(bar.value, 0) * scale
    if bar.interval:
        a, b = (zero + each * scale for each in bar.interval)
        parts.append(f'<path class="whisker" d="M{a:.1f} {middle - 3}v6m0-3H{b:.1f}m0-3v6"/>')
        end = max(end, b)
    parts.append(f'<text x="{end + 5:.1f}" y="{middle + 4:.1f}">{escaped(text)}</text>')
    return "".join(parts)


def _text(bar: Bar, digits: int) -> str:
    return bar.text or ("–" if bar.value is None else f"{bar.value:.{digits}f}")


def _short(tick: float) -> str:
    if abs(tick) >= 1000:
        return f"{tick / 1000:g}k"
    return f"{round(tick, 6):g}"


def _unbroken(points: Sequence[tuple[float, float | None]]) -> list[list[tuple[float, float]]]:
    """The points in runs without a gap."""
    found: list[list[tuple[float, float]]] = [[]]
    for x, y in points:
        if y is None or not math.isfinite(y):
            found.append([])
        else:
            found[-1].append((x, y))
    return [run for run in found if run]


def _svg(parts: Sequence[str], height: float, about: str) -> Html:
    return Html(
        f'<svg viewBox="0 0 {WIDTH} {height:.0f}" role="img" aria-label="{escaped(about)}">{"".join(parts)}</svg>'
    )
