"""Parts of a page as HTML. Text is escaped here, so that no caller has to; what is HTML already is of the type Html."""

import base64
import html
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

STYLE = Path(__file__).with_name("style.css")
SERIES = tuple(f"var(--{name})" for name in "abcdefgh")
"""Colours of what has none of its own, such as runs."""
OF_SENSORS = {3: "var(--three)", 2: "var(--two)", 1: "var(--one)", 0: "var(--none)"}
"""By number of sensors: much is dark, little is light."""


class Html(str):
    """Text that is HTML and is not escaped again."""


Cell = str | float | int | None


def escaped(text: Cell) -> Html:
    """Any text as HTML; None is a dash."""
    if isinstance(text, Html):
        return text
    return Html("–" if text is None else html.escape(str(text)))


def page(title: str, body: Iterable[str]) -> str:
    """A whole document that needs nothing beside it."""
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escaped(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{STYLE.read_text(encoding='utf-8')}</style></head><body><main>{''.join(body)}</main></body></html>\n"
    )


def section(title: str, text: str, *parts: str, anchor: str = "") -> Html:
    """A heading, a line of explanation and what it is about. ``anchor``: what links to it name."""
    name = anchor or re.sub(r"\W+", "-", title.lower())
    return Html(f'<h2 id="{escaped(name)}">{escaped(title)}</h2><p>{escaped(text)}</p>{"".join(parts)}')


def contents(titles: Iterable[tuple[str, str]]) -> Html:
    """Links to the sections (anchor, title) of the page."""
    links = (f'<a href="#{escaped(anchor)}">{escaped(title)}</a>' for anchor, title in titles)
    return Html(f'<nav aria-label="Contents">{"".join(links)}</nav>')


def facts(pairs: Iterable[tuple[str, str]]) -> Html:
    """Figures in large type with what they are below."""
    tiles = (f'<div class="fact"><b>{escaped(figure)}</b><span>{escaped(text)}</span></div>' for figure, text in pairs)
    return Html(f'<div class="facts">{"".join(tiles)}</div>')


def cards(parts: Iterable[str], kind: str = "") -> Html:
    """Cards side by side, as many as fit; "large" ones are for pictures with small text."""
    return Html(f'<div class="cards {kind}">{"".join(parts)}</div>')


def card(
    title: str,
    picture: str,
    *,
    note: str = "",
    figures: tuple[Sequence[Cell], Sequence[Sequence[Cell]]] | None = None,
    kind: str = "",
) -> Html:
    """A chart or a picture under its title; ``figures``: head and rows of the table behind it, folded up."""
    below = f'<p class="note">{escaped(note)}</p>' if note else ""
    if figures:
        below += f"<details><summary>Figures of this chart</summary>{table(*figures)}</details>"
    return Html(f'<figure class="card {kind}"><h3>{escaped(title)}</h3>{picture}{below}</figure>')


def table(head: Sequence[Cell], rows: Iterable[Sequence[Cell]], kind: str = "") -> Html:
    """A table that scrolls sideways where it does not fit. A head of empty texts is left out."""
    lines = ["".join(f'<th scope="col">{escaped(cell)}</th>' for cell in head)] if any(head) else []
    lines += ["".join(_cell(cell) for cell in row) for row in rows]
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return Html(f'<div class="scroll"><table class="{kind}">{body}</table></div>')


class Heat(float):
    """A number whose cell is the darker the larger it is, from 0 to 1."""

    def __new__(cls, value: float, text: str | None = None, strength: float | None = None) -> "Heat":
        made = super().__new__(cls, value)
        made.text = f"{value:.2f}" if text is None else text
        made.strength = min(max(value if strength is None else strength, 0.0), 1.0)
        return made

    text: str
    strength: float


def _cell(cell: Cell) -> str:
    if isinstance(cell, Heat):
        return f'<td style="background:rgb(var(--heat) / {0.75 * cell.strength:.2f})">{escaped(cell.text)}</td>'
    return f"<td>{escaped(cell)}</td>"


def image(picture: NDArray[np.uint8], alt: str, *, quality: int = 80) -> Html:
    """An image (H, W, 3) RGB as a JPEG within the page."""
    encoded = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    height, width = picture.shape[:2]
    return Html(f'<img alt="{escaped(alt)}" width="{width}" height="{height}" src="{inline(encoded, "jpeg")}">')


def inline(data: bytes, kind: str) -> str:
    """The address of an image file's bytes within the page."""
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def number(value: float | None, digits: int = 3, *, sign: bool = False) -> str:
    """A figure with so many decimals; a dash for what is not known."""
    return "–" if value is None or value != value else f"{value:{'+' if sign else ''}.{digits}f}"


def between(ends: Sequence[float] | None, digits: int = 3, *, sign: bool = False) -> str:
    """An interval."""
    return "–" if ends is None else f"{number(ends[0], digits, sign=sign)} to {number(ends[1], digits, sign=sign)}"
