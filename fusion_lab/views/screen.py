"""All that a page shows of a state, made away from the event loop: files of pictures, SVG over them, parts of the page."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from html import escape
from math import isfinite

from fusion_lab.engine.answers import Answer, Lab
from fusion_lab.engine.scoring import Score
from fusion_lab.engine.state import LabState
from fusion_lab.views import merge_point, paint, pixel_depth, scale, shared_grid
from fusion_lab.views.content import Content
from fusion_lab.views.overlay import on_camera, on_ground
from fusion_lab.views.pictures import camera_picture, ground_picture, jpeg
from fusion_net.common.drawing import Image


@dataclass(frozen=True)
class View:
    """One of the views below the scene: its title, the fields of the state that it alone reads, what it makes of an answer."""

    title: str
    fields: tuple[str, ...]
    content: Callable[[Answer], Content]


VIEWS = {
    "paint": View("Paint a point", ("offset", "u", "v"), paint.content),
    "depth": View("One pixel's depth", ("confidence", "u", "v"), pixel_depth.content),
    "grid": View("Three sensors, one grid", ("layer",), shared_grid.content),
    "merge": View("The merge point", ("merge",), merge_point.content),
    "scale": View("Why no distance", ("metres",), scale.content),
}


@dataclass(frozen=True)
class Picture:
    """A file of a picture, its width and height in pixels, what lies over it, what it is in words."""

    file: bytes
    size: tuple[int, int]
    overlay: str
    alt: str


@dataclass(frozen=True)
class Screen:
    """What is shown. ``panel``: HTML of the view that is open; ``forbidden``: choices of ``depth`` with the reason."""

    state: LabState
    camera: Picture
    ground: Picture
    view: Picture | None
    panel: str
    score: str
    ms: float
    forbidden: dict[str, str] = field(default_factory=dict)
    is_compared: bool = True  # the score has its change against nothing being wrong


def draw(lab: Lab, state: LabState, *, compared: bool = True) -> Screen:
    """The screen of a state; ``compared`` as in :meth:`Lab.answer`."""
    began = time.perf_counter()
    answer = lab.answer(state, compared=compared)
    boxes = f"{len(answer.sample.boxes)} labelled objects and {len(answer.shown)} detections"
    view = VIEWS[state.view].content(answer) if state.view in VIEWS else Content("")
    forbidden = lab.no_depth(state)
    return Screen(
        state=state,
        camera=picture(camera_picture(answer), on_camera(answer), f"Camera images with {boxes}"),
        ground=picture(ground_picture(answer), on_ground(answer), f"The ground from above with {boxes}"),
        view=None if view.picture is None else picture(view.picture, view.overlay, view.alt),
        panel=view.panel,
        score=score_card(answer.score, answer.plain or answer.score),
        ms=1e3 * (time.perf_counter() - began),
        forbidden=forbidden,
        is_compared=answer.plain is not None,
    )


def picture(image: Image, overlay: str, alt: str) -> Picture:
    """An RGB image as the page takes it."""
    return Picture(jpeg(image), (image.shape[1], image.shape[0]), overlay, alt)


def score_card(now: Score, plain: Score) -> str:
    """The score of the keyframe and its change against nothing being wrong, as HTML."""
    return "".join(
        (
            figure("mAP of the keyframe", now.mAP, plain.mAP, "{:.2f}", good=1),
            figure(f"of {now.objects} objects found", now.found, plain.found, "{:.0f}", good=1),
            figure("of these of the right class", now.right_class, plain.right_class, "{:.0f}", good=1),
            figure("false detections", now.false, plain.false, "{:.0f}", good=-1),
            figure("place off by, m", now.place, plain.place, "{:.2f}", good=-1),
            figure("velocity off by, m/s", now.velocity, plain.velocity, "{:.1f}", good=-1),
        )
    )


def figure(name: str, now: float, plain: float, form: str, *, good: int) -> str:
    """A figure and its change; ``good`` 1: more is better."""
    value, change = form.format(now) if isfinite(now) else "none", ""
    if isfinite(now) and isfinite(plain) and form.format(abs(now - plain)) != form.format(0):
        kind = "better" if (now - plain) * good > 0 else "worse"
        sign = "+" if now > plain else "\N{MINUS SIGN}"
        change = f' <em class="{kind}">{sign}{form.format(abs(now - plain))}</em>'
    return f'<div class="figure"><b>{value}{change}</b><span>{escape(name)}</span></div>'
