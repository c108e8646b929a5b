"""One open page: its state, its elements, and what it shows. Two tabs are two pages and know nothing of each other."""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from html import escape
from typing import Any

from nicegui.client import Client

from fusion_lab.engine.ahead import far, near
from fusion_lab.engine.answers import Lab
from fusion_lab.engine.state import RANGES, LabState
from fusion_lab.engine.steps import STEPS, state_of
from fusion_lab.engine.worker import NewestWins
from fusion_lab.page.controls import Controls
from fusion_lab.page.gallery import Gallery
from fusion_lab.page.layout import Layout
from fusion_lab.views.screen import VIEWS, Picture, Screen, draw, figure
from fusion_net.common.drawing import label
from fusion_net.common.nuscenes_format import MODALITIES

IDLE_SECONDS = 0.3
"""Without a change, after which the page works ahead."""
SCENE_SCORE = "mAP of the whole scene"
Work = tuple[Callable[[], Any], Callable[[Any], None]]
"""Something to be done, and who takes the answer."""


class Page:
    """Builds itself into the client that is open, and shows ``state``. ``lab`` is asked in the thread of ``worker`` alone."""

    def __init__(self, client: Client, gallery: Gallery, lab: Lab, worker: NewestWins, state: LabState) -> None:
        self.client, self.offer, self.state = client, lab.offer, state
        self._gallery, self._lab, self._worker = gallery, lab, worker
        self._loop = asyncio.get_running_loop()
        self._is_waiting = self._is_closed = self._has_failed = False
        self._scored: LabState | None = None  # of whose scene the score is shown
        self._controls = Controls(self.offer, self.change)
        self._on = Layout(self._controls, step=self._take_step, play=self._next, pick=self._pick, repair=self._repair)
        self._follow()
        self._ask()

    @property
    def _scene(self) -> LabState:
        """What all keyframes of the scene are seen in: states that agree in it have one score of the scene."""
        return replace(self.state.seen_as(self.offer.beams[0]), frame=0)

    def say(self, words: str) -> None:
        """Shows a sentence above everything; "" takes it away."""
        self._on.notice.set_text(words)
        self._on.notice.set_visibility(bool(words))

    def change(self, **fields: Any) -> None:
        """A user has set these fields of the state."""
        state = replace(self.state, **fields)
        severities = self.offer.conditions[state.condition]
        self._go(replace(state, severity=min(int(state.severity), severities), frame=int(state.frame)))

    def close(self) -> None:
        """Forgets all that the page wanted: it is gone."""
        self._is_closed = True
        self._worker.forget(self.client.id)
        self._gallery.drop(self.client.id)

    def _go(self, state: LabState) -> None:
        if state != self.state:
            self.state = state
            self._follow()
            self._ask()

    def _ask(self) -> None:
        self._wait(True)
        self._on.status.props["data-settled"] = "false"
        self._wish(partial(draw, self._lab, self.state, compared=False), self._show)

    def _wait(self, is_waiting: bool) -> None:
        """Whether what is shown is not yet what is set: the old pictures grow pale if that lasts."""
        self._is_waiting = is_waiting
        self._on.scene.props["aria-busy"] = str(is_waiting).lower()

    def _wish(self, work: Callable[[], Any], take: Callable[[Any], None], *, idle: bool = False) -> None:
        """Has ``work`` done in the worker's thread, in place of what waits there, and its answer taken in this one,
        if the page is still there."""

        def arrive(answer: Any) -> None:
            if not self._is_closed:
                take(answer)

        def deliver(answer: Any) -> None:
            self._loop.call_soon_threadsafe(arrive, answer)

        self._worker.submit(self.client.id, work, deliver, idle=idle)

    def _show(self, screen: Screen | Exception) -> None:
        """Shows what came back. When something else has been set since, the next screen follows."""
        if isinstance(screen, Exception):
            self._wait(False)
            self._has_failed = True
            self.say(f"This setting cannot be shown: {' '.join(str(screen).split())}")
            self._on.status.set_text("The pictures are of the setting before")
            self._on.status.props["data-settled"] = "true"
            return
        if self._has_failed:
            self._has_failed = False
            self.say("")
        on, layout = self._on, label(self.offer.layouts[screen.state.scene])
        on.title.set_text(f"Camera: {layout}, keyframe {screen.state.frame + 1} of {self.offer.frames}")
        for name, picture in (("camera", screen.camera), ("ground", screen.ground), ("view", screen.view)):
            self._set_picture(name, picture)
        on.panel.set_content(screen.panel)
        on.score.set_content(screen.score)
        self._controls.forbid_depth(screen.forbidden)
        if screen.state == self.state:
            if self._is_waiting:  # the second screen of a state only adds the comparison
                on.status.set_text(f"Answered in {screen.ms:.0f} ms")
            self._wait(False)
            on.status.props["data-shown"] = self.state.query()
            if not screen.is_compared:
                self._wish(partial(draw, self._lab, self.state), self._show)
                return
            on.status.props["data-settled"] = "true"
            if self._scene != self._scored:
                on.scene_score.set_content(f'<div class="figure"><b>...</b><span>{SCENE_SCORE}</span></div>')
            self._loop.call_later(IDLE_SECONDS, self._work_ahead, self.state, self._works(self.state))

    def _set_picture(self, name: str, picture: Picture | None) -> None:
        frame = self._on.pictures[name]
        frame.set_visibility(picture is not None)
        if picture is not None:
            frame.show(picture, self._gallery.put(self.client.id, name, picture.file))

    def _work_ahead(self, state: LabState, works: Iterator[Work]) -> None:
        """Has the ``works`` done one after the other for as long as ``state`` is what is set."""
        if state == self.state and not self._is_closed and (work := next(works, None)):
            wish, take = work

            def go_on(answer: Any) -> None:
                take(answer)
                self._work_ahead(state, works)

            self._wish(wish, go_on, idle=True)

    def _works(self, state: LabState) -> Iterator[Work]:
        """What is done while nothing is set: what one step of a slider asks for, the score of the scene, other weather."""
        for each in near(state, self.offer):
            yield from self._preparations(each)
        scene = self._scene
        if scene != self._scored:
            for frame in range(self.offer.frames):
                for each in (scene, scene.undisturbed):
                    yield partial(self._lab.look, replace(each, frame=frame)), _nobody
            yield partial(self._lab.scene_score, scene), partial(self._show_scene_score, scene)
        for each in far(state, self.offer):
            yield from self._preparations(each)

    def _preparations(self, state: LabState) -> Iterator[Work]:
        for modality in MODALITIES:
            yield partial(self._lab.prepare, state, modality), _nobody

    def _show_scene_score(self, scene: LabState, answer: tuple[float, float] | Exception) -> None:
        if scene == self._scene and not isinstance(answer, Exception):
            self._scored = scene
            self._on.scene_score.set_content(figure(SCENE_SCORE, *answer, "{:.2f}", good=1))

    def _follow(self) -> None:
        """Brings controls, guide and address to the state."""
        self._controls.follow(self.state)
        for name, box in self._on.own_fields.items():
            box.set_visibility(self.state.view == name)
        self._on.step.set_visibility(self.state.step > 0)
        if self.state.step:
            step = STEPS[self.state.step - 1]
            self._on.step.set_content(
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

    def _pick(self, u: float, v: float) -> None:
        """A click on the view's picture chooses a pixel."""
        if self.state.view in VIEWS and "u" in VIEWS[self.state.view].fields:
            self.change(u=RANGES["u"].nearest(u), v=RANGES["v"].nearest(v))


def _nobody(answer: Any) -> None:
    """Takes the answer of what is only to be known or to lie on disk; if it failed, whoever wants it is told."""
