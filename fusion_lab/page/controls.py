"""The controls of the page. Each sets one field of the state, and follows it when something else sets it."""

from collections.abc import Callable
from typing import Any

from nicegui import ui

from fusion_lab.engine.state import CHOICES, RANGES, LabState, Offer, Range
from fusion_lab.page.slider import Slider
from fusion_lab.views.screen import VIEWS
from fusion_net.common.drawing import label

SENSORS = {"camera": "camera", "lidar": "LiDAR", "radar": "radar"}
TITLES = {
    "level": "Fusion", "scene": "Scene", "frame": "Keyframe", "condition": "Weather and light", "severity": "Severity",
    "camera": "Camera", "lidar": "LiDAR", "radar": "Radar", "beams": "LiDAR beams", "turned": "Sensor that has moved",
    "degrees": "Turned to the left", "centimetres": "Moved to the left", "late": "Sensor whose clock is ahead",
    "milliseconds": "Ahead by", "depth": "Camera depth", "threshold": "Score threshold", "view": "View",
    "offset": "Calibration offset", "u": "Pixel, from the left", "v": "Pixel, from the top", "confidence": "Confidence",
    "layer": "Whose map", "merge": "The sensors meet", "metres": "Distance of the person",
}  # fmt: skip
WORDS: dict[str, Callable[[Any], str]] = {
    "degrees": "{:+.1f}°".format, "centimetres": "{:+.0f} cm".format,
    "milliseconds": "{:.0f} ms".format, "threshold": "{:.2f}".format, "offset": "{:+.1f}°".format, "u": "{:.0%}".format,
    "v": "{:.0%}".format, "confidence": "power {:.1f}".format, "metres": "{:.0f} m".format,
    "frame": lambda value: str(int(value) + 1),
}  # fmt: skip
"""How the value of a slider is written beside it and read out, but for the severity."""
HEALTH = {"blinded": "blinded by the low sun", "rained out": "rained out", "stale": "stale: an old frame"}
DEPTH = {"uniform": "uniform: unknown", "lidar": "LiDAR returns", "oracle": "oracle: exact"}
INLINE = ("level", "view", "layer", "merge")
"""Fields whose choices are all shown."""


class Controls:
    """Builds controls into whatever element is open. ``change`` is told what a user sets, as fields of the state."""

    def __init__(self, offer: Offer, change: Callable[..., None]) -> None:
        self._offer, self._change = offer, change
        self._elements: list[tuple[str, Any, ui.label | None]] = []
        self._is_following = False
        self._forbidden: dict[str, str] = {}

    def one(self, name: str, owner: str = "") -> None:
        """The control of a field; of one that several views have, ``owner`` is the view."""
        choices = self._offer.choices(name)
        mark = f"data-testid={f'{owner}-' * bool(owner)}{name}"
        if name == "frame":
            self._slider(name, Range(0, self._offer.frames - 1, 1), mark)
        elif choices is None:
            self._slider(name, RANGES[name], mark)
        elif name in INLINE:
            self._radio(name, {choice: self._word(name, choice) for choice in choices}, mark)
        else:
            self._select(name, {choice: self._word(name, choice) for choice in choices}, mark)

    def follow(self, state: LabState) -> None:
        """Shows a state, and tells nobody that it changed."""
        self._is_following = True
        try:
            for name, element, caption in self._elements:
                value = getattr(state, name)
                if element.value != value:
                    element.set_value(value)
                if caption is not None:
                    words = self._read_out(name, state)
                    caption.set_text(words)
                    element.say(words)
                if name == "severity":
                    element.set_enabled(self._offer.conditions[state.condition] > 1)
        finally:
            self._is_following = False

    def forbid_depth(self, reasons: dict[str, str]) -> None:
        """Greys out choices of ``depth`` and says below why."""
        if reasons == self._forbidden:
            return
        self._forbidden = reasons
        element = next(element for name, element, _ in self._elements if name == "depth")
        places = [place for place, choice in enumerate(CHOICES["depth"]) if choice in reasons]
        element.props[":option-disable"] = f"option => {places}.includes(option.value)"
        element.props["hint"] = "; ".join(dict.fromkeys(reasons.values()))
        element.update()

    def _read_out(self, name: str, state: LabState) -> str:
        """The value of a slider in words."""
        if name == "severity":
            return f"{state.severity} of {self._offer.conditions[state.condition]}"
        return WORDS[name](getattr(state, name))

    def _word(self, name: str, choice: Any) -> str:
        if name == "scene":
            return f"{choice + 1}: {label(self._offer.layouts[choice])}"
        if name == "view":
            return VIEWS[choice].title if choice in VIEWS else "none"
        if name in ("turned", "late", "layer"):
            return SENSORS.get(choice, choice)
        named = DEPTH if name == "depth" else HEALTH
        return label(named.get(choice, str(choice)))

    def _set(self, name: str, value: Any) -> None:
        if not self._is_following and value is not None:
            self._change(**{name: value})

    def _select(self, name: str, options: dict[Any, str], mark: str) -> None:
        element = ui.select(options, label=TITLES[name], on_change=lambda event: self._set(name, event.value))
        self._elements.append((name, element.props(f"dense outlined options-dense {mark}").classes("wide"), None))

    def _radio(self, name: str, options: dict[Any, str], mark: str) -> None:
        with ui.element("div").props(f'role="group" aria-label="{TITLES[name]}" {mark}').classes("wide"):
            ui.label(TITLES[name]).classes("caption")
            element = ui.radio(options, on_change=lambda event: self._set(name, event.value)).props("inline dense")
        self._elements.append((name, element, None))

    def _slider(self, name: str, numbers: Range, mark: str) -> None:
        with ui.element("div").classes("wide slider"):
            with ui.row().classes("captions"):
                ui.label(TITLES[name]).classes("caption")
                caption = ui.label().classes("value")
            element = Slider(numbers, TITLES[name], lambda event: self._set(name, event.value)).props(mark)
        self._elements.append((name, element, caption))
