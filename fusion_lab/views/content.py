"""What a view shows."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from fusion_net.common.drawing import Image


@dataclass(frozen=True)
class Content:
    """``picture`` with ``overlay`` (SVG) on it, if there is one, ``alt`` in words, and ``panel`` (HTML) beside it."""

    panel: str
    picture: Image | None = None
    overlay: str = ""
    alt: str = ""


def table(rows: Sequence[Sequence[object]], head: Sequence[str] = (), caption: str = "") -> str:
    """An HTML table; the first column names its row."""
    top = f"<thead><tr>{''.join(f'<th scope=col>{escape(each)}</th>' for each in head)}</tr></thead>" if head else ""
    body = "".join(
        f"<tr><th scope=row>{escape(str(name))}</th>{''.join(f'<td>{escape(str(cell))}</td>' for cell in cells)}</tr>"
        for name, *cells in rows
    )
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{title}{top}<tbody>{body}</tbody></table>"


def svg(width: float, height: float, inside: str, title: str) -> str:
    """An SVG picture that grows with the page; ``title`` is what a screen reader says."""
    size = f'viewBox="0 0 {width:g} {height:g}" style="max-width:{1.2 * width:.0f}px"'
    name = escape(title, quote=True)
    return f'<svg {size} role="img" aria-label="{name}" xmlns="http://www.w3.org/2000/svg">{inside}</svg>'


def text(x: float, y: float, words: str, more: str = "") -> str:
    """A line of text in an SVG picture."""
    return f'<text x="{x:.1f}" y="{y:.1f}" {more}>{escape(words)}</text>'


MISSING = "<p>The camera is dead: there is no image whose pixels could be looked at.</p>"
