"""Where everything is on the page."""

from collections.abc import Callable

from nicegui import ui

from fusion_lab.engine.steps import STEPS
from fusion_lab.page.controls import Controls
from fusion_lab.page.picture import PictureFrame
from fusion_lab.views.overlay import FOUND, LABEL
from fusion_lab.views.screen import VIEWS

SECONDS_A_KEYFRAME = 0.6
"""While playing, if the answers come as fast."""
LEGEND = (
    f'<div class="legend"><span><i style="border-top-style:dashed;border-color:{LABEL}"></i>labels (dashed)</span>'
    f'<span><i style="border-color:{FOUND}"></i>detections</span>'
    '<span><i class="dot" style="background:#96969f"></i>LiDAR</span>'
    '<span><i class="dot" style="background:#5abeff"></i>radar</span>'
    "<span>arrows and lines: half a second of the velocity</span></div>"
)
GROUPS = {
    "Scene": ("level", "scene", "condition", "severity"),
    "Sensors": ("camera", "lidar", "radar", "beams"),
    "Calibration": ("turned", "degrees", "centimetres"),
    "Clock": ("late", "milliseconds"),
    "Network": ("depth", "threshold"),
}
"""The controls beside the pictures, by what they are about."""


class Layout:
    """Builds the elements into the client that is open; those that change are attributes, ``pictures`` by name and
    ``own_fields`` (the controls of each view) by view."""

    def __init__(
        self,
        controls: Controls,
        *,
        step: Callable[[int], None],
        play: Callable[[], None],
        pick: Callable[[float, float], None],
        repair: Callable[[], None],
    ) -> None:
        self._controls = controls
        self.pictures: dict[str, PictureFrame] = {}
        self.own_fields: dict[str, ui.element] = {}
        with ui.element("header").classes("top"):
            ui.html("<h1>Failure lab</h1>", sanitize=False)
            ui.label("Break a sensor: the trained network answers, on this machine.").classes("caption")
        with ui.element("div").classes("lab"):
            with ui.element("div").classes("main"):
                self.notice = ui.label().classes("notice").props('role="status" data-testid=notice')
                self.notice.set_visibility(False)
                self._build_guide(step)
                self._build_score()
                with ui.element("div").classes("scene") as self.scene:
                    self._build_camera(play)
                    with _card("From above", "ground"):
                        ui.label("From above, ahead is up; circles every 10 m").classes("caption")
                        self._picture("ground")
                    self._build_views(pick)
            with ui.element("div").classes("side"):
                for title, fields in GROUPS.items():
                    with _card(title):
                        ui.html(f"<h2>{title}</h2>", sanitize=False)
                        for field in fields:
                            controls.one(field)
                ui.button("Nothing wrong", on_click=repair).props("outline no-caps data-testid=repair")

    def _build_guide(self, step: Callable[[int], None]) -> None:
        with _card("Guide"):
            with ui.element("div").classes("steps"):
                for number, each in enumerate(STEPS, start=1):
                    button = ui.button(f"{number}. {each.title}", on_click=lambda number=number: step(number))
                    button.props(f"dense outline no-caps data-testid=step{number}")
            self.step = ui.html(sanitize=False).classes("panel").props("data-testid=step")

    def _build_score(self) -> None:
        with _card("Score"):
            with ui.element("div").classes("score").props('aria-live="polite" data-testid=score'):
                self.scene_score = ui.html(sanitize=False).classes("inside")
                self.score = ui.html(sanitize=False).classes("inside").props("data-testid=keyframe-score")
            self.status = ui.label().classes("status").props('role="status" data-testid=status')

    def _build_camera(self, play: Callable[[], None]) -> None:
        with _card("Camera", "camera"):
            self.title = ui.label().classes("caption")
            self._picture("camera")
            with ui.element("div").classes("play"):
                self._play = ui.button(icon="play_arrow", on_click=self._play_or_pause)
                self._play.props('dense round flat aria-label="Play" data-testid=play')
                self._controls.one("frame")
            self._timer = ui.timer(SECONDS_A_KEYFRAME, play, active=False)
            ui.html(LEGEND, sanitize=False)

    def _build_views(self, pick: Callable[[float, float], None]) -> None:
        with _card("Views", "view"):
            self._controls.one("view")
            for name, view in VIEWS.items():
                with ui.element("div").classes("wide") as self.own_fields[name]:
                    for field in view.fields:
                        self._controls.one(field, owner=name)
            self._picture("view", pick)
            self.panel = ui.html(sanitize=False).classes("panel").props("data-testid=panel")

    def _picture(self, name: str, pick: Callable[[float, float], None] | None = None) -> None:
        self.pictures[name] = PictureFrame(pick).props(f"data-testid={name}-picture")

    def _play_or_pause(self) -> None:
        self._timer.active = not self._timer.active
        icon, name = ("pause", "Pause") if self._timer.active else ("play_arrow", "Play")
        self._play.props(f'icon={icon} aria-label="{name}"')


def _card(title: str, area: str = "") -> ui.element:
    return ui.element("section").classes(f"card {area}").props(f'aria-label="{title}"')
