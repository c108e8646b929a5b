"""One open page: its state, its elements, and what it shows. Two tabs are two pages and know nothing of each other."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from html import escape
from typing import Any

from nicegui import ui
from nicegui.client import Client
from nicegui.events import MouseEventArguments

from fusion_lab.engine.state import RANGES, LabState, Offer
from fusion_lab.engine.steps import STEPS, state_of
from fusion_lab.page.controls import Controls
from fusion_lab.page.gallery import Gallery
from fusion_lab.views.overlay import FOUND, LABEL
from fusion_lab.views.screen import VIEWS, Picture, Screen

SECONDS_A_KEYFRAME = 0.6
"""While playing, if the answers come as fast."""
LEGEND = (
    f'<div class="legend"><span><i style="border-top-style:dashed;border-color:{LABEL}"></i>labels (dashed)</span>'
    f'<span><i style="border-color:{FOUND}"></i>detections</span>'
    '<span><i class="dot" style="background:#96969f"></i>LiDAR</span>'
    '<span><i class="dot" style="background:#5abeff"></i>radar, half a second of its velocity</span></div>'
)


class Page:
    """Builds itself into the client that is open. ``submit`` is called when a screen of ``state`` is wanted."""

    def __init__(
        self, client: Client, gallery: Gallery, offer: Offer, state: LabState, *, submit: Callable[["Page"], None]
    ) -> None:
        self.client, self.offer, self.state = client, offer, state
        self._gallery, self._submit, self._loop = gallery, submit, asyncio.get_running_loop()
        self._controls = Controls(offer, self.change)
        self._is_waiting = False
        self._build()
        self._follow()
        self._ask()

    def say(self, words: str) -> None:
        """Shows a sentence above everything; "" takes it away."""
        self._notice.set_text(words)
        self._notice.set_visibility(bool(words))

    def change(self, **fields: Any) -> None:
        """A user has set these fields of the state."""
        state = replace(self.state, **fields)
        severities = self.offer.conditions[state.condition]
        self._go(replace(state, severity=min(int(state.severity), severities), frame=int(state.frame)))

    def deliver(self, screen: Screen | Exception) -> None:
        """Takes a screen from another thread."""
        self._loop.call_soon_threadsafe(self._show, screen)

    def _go(self, state: LabState) -> None:
        if state != self.state:
            self.state = state
            self._follow()
            self._ask()

    def _ask(self) -> None:
        self._is_waiting = True
        self._status.props('data-settled="false"')
        self._submit(self)

    def _show(self, screen: Screen | Exception) -> None:
        """Shows what came back. When something else has been set since, the next screen follows."""
        if isinstance(screen, Exception):
            self._is_waiting = False
            self.say(f"This setting cannot be shown: {' '.join(str(screen).split())}")
            return
        self._set_picture(self._camera, "camera", screen.camera)
        self._set_picture(self._ground, "ground", screen.ground)
        self._set_picture(self._view, "view", screen.view)
        self._panel.set_content(screen.panel)
        self._score.set_content(screen.score)
        self._title.set_text(f"{screen.title}, keyframe {screen.state.frame + 1} of {self.offer.frames}")
        self._controls.forbid_depth(screen.forbidden)
        if screen.state == self.state:
            self._is_waiting = False
            self._status.set_text(f"The network answered in {screen.ms:.0f} ms.")
            self._status.props('data-settled="true"')

    def _set_picture(self, image: ui.interactive_image, name: str, picture: Picture | None) -> None:
        image.set_visibility(picture is not None)
        if picture is not None:
            image.set_source(self._gallery.put(self.client.id, name, picture.file))
            image.set_content(picture.overlay)
            image.props(f'role="img" aria-label="{escape(picture.alt, quote=True)}"')

    def _follow(self) -> None:
        """Brings controls, guide and address to the state."""
        self._controls.follow(self.state)
        for name, box in self._own.items():
            box.set_visibility(self.state.view == name)
        self._step.set_visibility(self.state.step > 0)
        if self.state.step:
            step = STEPS[self.state.step - 1]
            self._step.set_content(
                f"<h2>{self.state.step}. {escape(step.title)}</h2><p>{escape(step.text)}</p>"
                f"<p><strong>Look:</strong> {escape(step.look)}</p>"
            )
        if self.client.has_socket_connection:
            query = self.state.query()
            self.client.run_javascript(f'history.replaceState(history.state, "", "/{"?" * bool(query)}{query}")')

    def _take_step(self, number: int) -> None:
        state, note = state_of(number, self.state, self.offer)
        self.say(note)
        self._go(state)

    def _repair(self) -> None:
        self.say("")
        self._go(replace(self.state.undisturbed, beams=self.offer.beams[0], view=self.state.view))

    def _next(self) -> None:
        """The next keyframe, unless the network is still at the last one."""
        if not self._is_waiting:
            self.change(frame=(self.state.frame + 1) % self.offer.frames)

    def _play_or_pause(self) -> None:
        self._timer.active = not self._timer.active
        name = "Pause" if self._timer.active else "Play"
        self._play.props(f'icon={"pause" if self._timer.active else "play_arrow"} aria-label="{name}"')

    def _pick(self, event: MouseEventArguments) -> None:
        """A click on the view's picture chooses a pixel."""
        if "u" in VIEWS[self.state.view].fields:
            size = self._picked_size
            self.change(u=RANGES["u"].nearest(event.image_x / size[0]), v=RANGES["v"].nearest(event.image_y / size[1]))

    def _build(self) -> None:
        with ui.element("header").classes("top"):
            ui.html("<h1>Failure lab</h1>", sanitize=False)
            ui.label("Break a sensor: the trained network answers, on this machine.").classes("caption")
        with ui.element("main").classes("lab"):
            with ui.element("div").classes("main"):
                self._notice = ui.label().classes("notice").props('role="status" data-testid=notice')
                self.say("")
                self._build_guide()
                self._build_scene()
                self._build_views()
            with ui.element("div").classes("side"):
                self._build_controls()

    def _build_guide(self) -> None:
        with ui.element("section").classes("card").props('aria-label="Guide"'):
            with ui.element("div").classes("steps"):
                ui.label("Six experiments:").classes("caption")
                for number, step in enumerate(STEPS, start=1):
                    button = ui.button(str(number), on_click=lambda number=number: self._take_step(number))
                    button.props(
                        f'dense outline aria-label="Experiment {number}: {step.title}" data-testid=step{number}'
                    )
                    button.tooltip(step.title)
            self._step = ui.html(sanitize=False).classes("panel").props("data-testid=step")

    def _build_scene(self) -> None:
        with ui.element("section").classes("card").props('aria-label="Score"'):
            self._score = ui.html(sanitize=False).classes("wide").props('aria-live="polite" data-testid=score')
            self._status = ui.label().classes("status").props('role="status" data-testid=status')
        with ui.element("div").classes("views"):
            with ui.element("section").classes("card").props('aria-label="Camera"'):
                self._title = ui.label().classes("caption")
                self._camera = (
                    ui.interactive_image(sanitize=False).classes("picture").props("data-testid=camera-picture")
                )
                with ui.row().classes("wide items-center no-wrap"):
                    self._play = ui.button(icon="play_arrow", on_click=self._play_or_pause).props("dense round flat")
                    self._play.props('aria-label="Play" data-testid=play')
                    self._controls.one("frame")
                self._timer = ui.timer(SECONDS_A_KEYFRAME, self._next, active=False)
                ui.html(LEGEND, sanitize=False)
            with ui.element("section").classes("card").props('aria-label="From above"'):
                ui.label("From above, ahead is up").classes("caption")
                self._ground = ui.interactive_image(sanitize=False).classes("picture ground")
                self._ground.props("data-testid=ground-picture")

    def _build_views(self) -> None:
        with ui.element("section").classes("card").props('aria-label="Views"'):
            self._controls.one("view")
            self._own: dict[str, ui.element] = {}
            for name, view in VIEWS.items():
                with ui.element("div").classes("fields") as self._own[name]:
                    for field in view.fields:
                        self._controls.one(field, owner=name)
            with ui.element("div").classes("views"):
                self._view = ui.interactive_image(sanitize=False, on_mouse=self._pick).classes("picture")
                self._view.props("data-testid=view-picture")
                self._panel = ui.html(sanitize=False).classes("panel").props("data-testid=panel")

    def _build_controls(self) -> None:
        groups = {
            "Scene": ("level", "scene", "condition", "severity"),
            "Sensors": ("camera", "lidar", "radar", "beams"),
            "Calibration": ("turned", "degrees", "centimetres"),
            "Clock": ("late", "milliseconds"),
            "Network": ("depth", "threshold"),
        }
        for title, fields in groups.items():
            with ui.element("section").classes("card").props(f'aria-label="{title}"'):
                ui.html(f"<h2>{title}</h2>", sanitize=False)
                for field in fields:
                    self._controls.one(field)
        ui.button("Nothing wrong", on_click=self._repair).props("outline no-caps data-testid=repair")
