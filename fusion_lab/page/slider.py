"""A slider that a screen reader can name and read: the browser's own range input."""

from collections.abc import Callable
from typing import Any

from nicegui.elements.mixins.disableable_element import DisableableElement
from nicegui.elements.mixins.value_element import ValueElement

from fusion_lab.engine.state import Range

THROTTLE = 0.05
"""Seconds between two values that are told while it is dragged; the last one always is."""


class Slider(ValueElement[float], DisableableElement, component="slider.js"):  # type: ignore[call-arg]
    """Chooses one of ``numbers``; ``name`` is what it is called."""

    LOOPBACK = False  # what is dragged is not set back to what the server has heard of

    def __init__(self, numbers: Range, name: str, on_change: Callable[[Any], None]) -> None:
        super().__init__(value=numbers.low, on_value_change=on_change, throttle=THROTTLE)
        self.props["min"], self.props["max"], self.props["step"] = numbers
        self.props["aria-label"] = name

    def say(self, words: str) -> None:
        """How the value is read out, with its unit."""
        if self.props.get("aria-valuetext") != words:
            self.props["aria-valuetext"] = words
            self.update()
