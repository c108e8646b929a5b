"""A picture with boxes over it that has a name for a screen reader, and whose boxes never lie over another picture."""

from collections.abc import Callable

from nicegui.element import Element

from fusion_lab.views.screen import Picture


class PictureFrame(Element, component="picture.js"):  # type: ignore[call-arg]
    """Shows one :class:`Picture` after the other, none at first. ``pick`` is told where it is clicked, in fractions of its size
    from the upper left."""

    def __init__(self, pick: Callable[[float, float], None] | None = None) -> None:
        super().__init__()
        self.props["width"], self.props["height"] = 10, 3
        if pick is not None:
            self.on("pick", lambda event: pick(*event.args))

    def show(self, picture: Picture, address: str) -> None:
        """Takes the place of what is shown as soon as the browser has the image from ``address``."""
        self.props["width"], self.props["height"] = picture.size
        self.props["src"], self.props["overlay"], self.props["alt"] = address, picture.overlay, picture.alt
