"""What is set on the page: one state, which a link reproduces, and what it does to the sensors.

Everything that can be set is a field of :class:`LabState`; ``CHOICES`` and ``RANGES`` say what each may be, for the controls of
the page and for the links alike.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from typing import Any, NamedTuple
from urllib.parse import urlencode

from fusion_net.common.fault_effects import Clock, Dead, FewerBeams, LostPoints, Mismount, Stale
from fusion_net.common.faults import Fault
from fusion_net.common.nuscenes_format import MODALITIES

CHOICES = {
    "camera": ("alive", "dead", "blinded", "stale"),
    "lidar": ("alive", "dead", "rained out", "stale"),
    "radar": ("alive", "dead", "stale"),
    "turned": MODALITIES,
    "late": MODALITIES,
    "depth": ("learned", "uniform", "lidar", "oracle"),
    "view": ("scene", "paint", "depth", "grid", "merge", "scale"),
    "layer": ("all", *MODALITIES),
    "merge": ("early", "mid", "late"),
}
"""Fields that are one of a few words. Those of ``level`` and ``condition`` depend on what there is: :class:`Offer`."""


class Range(NamedTuple):
    """Numbers from ``low`` to ``high`` in steps."""

    low: float
    high: float
    step: float

    def nearest(self, value: float) -> float:
        """The number of the range that is nearest to ``value``."""
        inside = min(max(value, self.low), self.high)
        return round(self.low + round((inside - self.low) / self.step) * self.step, 6)


RANGES = {
    "severity": Range(1, 3, 1),
    "degrees": Range(-5, 5, 0.1),
    "centimetres": Range(-50, 50, 1),
    "milliseconds": Range(0, 300, 10),
    "threshold": Range(0.05, 0.95, 0.05),
    "offset": Range(-5, 5, 0.1),
    "confidence": Range(0, 4, 0.1),
    "metres": Range(5, 50, 1),
    "step": Range(0, 6, 1),
    "u": Range(0, 1, 0.001),
    "v": Range(0, 1, 0.001),
}


class Weather(NamedTuple):
    """A condition of ``configs/condition`` and its severity, 1 the mildest."""

    name: str
    severity: int


LOW_SUN, DOWNPOUR = Weather("glare", 3), Weather("rain", 3)
"""What blinds a camera, and what drowns a LiDAR, while the others see the weather that is set."""
WET_WINDOW = 0.9
"""Of its returns that a LiDAR loses beside, when it is rained out: water stands on its window."""


@dataclass(frozen=True)
class Offer:
    """What there is to choose from: detectors by name, scenes by their layouts, keyframes of a scene, conditions with how many
    severities they have, and beams that the LiDAR may keep, all of them first."""

    levels: tuple[str, ...]
    layouts: tuple[str, ...]
    frames: int
    conditions: Mapping[str, int] = field(default_factory=lambda: {"clear": 1})
    beams: tuple[int, ...] = (32, 16, 8, 4)

    def choices(self, name: str) -> tuple[Any, ...] | None:
        """What a field may be, where it is one of a few."""
        whole = {"scene": range(len(self.layouts)), "frame": range(self.frames), "beams": self.beams}
        own = {"level": self.levels, "condition": tuple(self.conditions)} | whole
        return tuple(own[name]) if name in own else CHOICES.get(name)


@dataclass(frozen=True, kw_only=True)
class LabState:
    """One setting of the page.

    ``level``: which detector. ``camera``, ``lidar``, ``radar``: the health of each. ``turned``: the sensor that has moved on
    its mount, by ``degrees`` of yaw and ``centimetres`` to the left. ``late``: the sensor whose clock is ``milliseconds``
    ahead, so that its data are older than their stamp. ``depth``: what places the camera's pixels. ``beams`` that the LiDAR
    keeps. ``threshold``: the least score of a box that counts. ``step`` of the guide, 0 none. The rest is of the views: the
    ``offset`` in degrees at which points are painted, the pixel (``u``, ``v``) in fractions of the image, the power that its
    depth distribution is raised to (``confidence``), whose map is shown (``layer``), where the sensors meet (``merge``), how
    far the nearer of two objects is (``metres``).
    """

    level: str = ""
    scene: int = 0
    frame: int = 4
    condition: str = "clear"
    severity: int = 1
    camera: str = "alive"
    lidar: str = "alive"
    radar: str = "alive"
    turned: str = "camera"
    degrees: float = 0.0
    centimetres: float = 0.0
    late: str = "camera"
    milliseconds: float = 0.0
    depth: str = "learned"
    beams: int = 32
    threshold: float = 0.3
    view: str = "scene"
    step: int = 0
    offset: float = 0.0
    u: float = 0.5
    v: float = 0.6
    confidence: float = 1.0
    layer: str = "all"
    merge: str = "mid"
    metres: float = 30.0

    @property
    def undisturbed(self) -> "LabState":
        """The same detector, scene and keyframe with nothing wrong."""
        return LabState(level=self.level, scene=self.scene, frame=self.frame, threshold=self.threshold)

    def seen_as(self, beams: int) -> "LabState":
        """The state without what the detector does not see: states that agree in it get one answer. The LiDAR has ``beams``."""
        seen = replace(self.undisturbed, threshold=LabState.threshold, depth=self.depth)
        seen = replace(seen, camera=self.camera, lidar=self.lidar, radar=self.radar)
        if self.condition != "clear":
            seen = replace(seen, condition=self.condition, severity=self.severity)
        if self.degrees or self.centimetres:
            seen = replace(seen, turned=self.turned, degrees=self.degrees, centimetres=self.centimetres)
        if self.milliseconds:
            seen = replace(seen, late=self.late, milliseconds=self.milliseconds)
        return replace(seen, beams=self.beams) if self.beams < beams else seen

    def weather(self, modality: str) -> Weather:
        """What a sensor measures in."""
        if modality == "camera" and self.camera == "blinded":
            return LOW_SUN
        if modality == "lidar" and self.lidar == "rained out":
            return DOWNPOUR
        return Weather(self.condition, self.severity)

    def is_current(self, modality: str) -> bool:
        """Whether what a sensor gives is of the keyframe that is shown: it is neither dead nor late."""
        is_late = self.late == modality and self.milliseconds > 0
        return getattr(self, modality) not in ("dead", "stale") and not is_late

    def faults(self, beams: int) -> list[Fault]:
        """What is wrong with the sensors, as the reader applies it; the LiDAR has ``beams``."""
        found = []
        for modality in MODALITIES:
            match getattr(self, modality):
                case "dead":
                    found.append(Fault(sensors=[modality], effect=Dead()))
                case "rained out":
                    found.append(Fault(sensors=[modality], effect=LostPoints(fraction=WET_WINDOW)))
                case "stale":
                    found.append(Fault(sensors=[modality], effect=Stale(firings=1)))
        if self.degrees or self.centimetres:
            moved = Mismount(rotation_deg=[0.0, 0.0, self.degrees], translation=[0.0, self.centimetres / 100, 0.0])
            found.append(Fault(sensors=[self.turned], effect=moved))
        if self.milliseconds:
            found.append(Fault(sensors=[self.late], effect=Clock(offset=self.milliseconds / 1000)))
        if self.beams < beams:
            found.append(Fault(sensors=["lidar"], effect=FewerBeams(keep=self.beams)))
        return found

    def query(self) -> str:
        """The end of a link that reproduces the state: the fields that differ from a page just opened."""
        plain = LabState()
        changed = {
            f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != getattr(plain, f.name)
        }
        return urlencode({name: f"{value:g}" if isinstance(value, float) else value for name, value in changed.items()})


def first_state(offer: Offer) -> LabState:
    """What a page shows that is opened without a link: mid-level fusion, where there is such a detector."""
    level = "mid" if "mid" in offer.levels else offer.levels[0]
    return LabState(level=level, frame=min(4, offer.frames - 1), beams=offer.beams[0])


def from_query(query: Mapping[str, str], offer: Offer) -> tuple[LabState, list[str]]:
    """The state that a link names, and what of the link could not be had: one sentence each, with what was taken instead."""
    state, notes = first_state(offer), []
    types = {f.name: f.type for f in fields(LabState)}
    for name, text in query.items():
        if name not in types:
            near = get_close_matches(name, types, n=1)
            notes.append(f"There is no setting {name!r}{f'; is {near[0]!r} meant?' if near else '.'}")
            continue
        value, note = _read(name, text, offer, getattr(state, name))
        state, notes = replace(state, **{name: value}), [*notes, *([note] if note else [])]
    return replace(state, severity=min(state.severity, offer.conditions[state.condition])), notes


def _read(name: str, text: str, offer: Offer, otherwise: Any) -> tuple[Any, str]:
    """The value of a field, and what was wrong with ``text``."""
    choices = offer.choices(name)
    if choices is not None:
        named = {str(choice): choice for choice in choices}
        if text in named:
            return named[text], ""
        near = get_close_matches(text, named, n=1)
        value = named[near[0]] if near else otherwise
        return value, f"There is no {name}={text}; this is {name}={value}, and there are {', '.join(named)}."
    whole = isinstance(otherwise, int)
    try:
        given = float(text)
        value = RANGES[name].nearest(given)
    except (ValueError, OverflowError):
        return otherwise, f"{name}={text} is no number; this is {name}={otherwise:g}."
    note = (
        "" if abs(value - given) <= RANGES[name].step else f"{name}={text} is out of range; this is {name}={value:g}."
    )
    return int(value) if whole else value, note
