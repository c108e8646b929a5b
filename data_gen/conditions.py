"""The physical state of a scene: one vector that every sensor reads, so that all of them see the same weather."""

import math
from dataclasses import dataclass, field

import numpy as np
from beartype import beartype

CLEAR_MOR = 20_000.0
"""Meteorological optical range of clear air in metres."""

Number = float | int  # YAML writes 0 for 0.0

DECADES = ("illuminance", "visibility")
"""Quantities that span decades."""


@beartype
@dataclass(frozen=True)
class Condition:
    """Weather and light of one scene.

    Units: ``rain_rate`` mm/h, ``visibility`` (meteorological optical range, 5 % contrast) m, ``illuminance`` on the
    ground lux, sun angles in degrees (azimuth counter-clockwise from global x, elevation above the horizon; negative:
    set), ``water_film`` mm, ``spray`` whether wheels throw it up.
    """

    name: str = "clear"
    rain_rate: float = 0.0
    visibility: float = CLEAR_MOR
    illuminance: float = 60_000.0
    sun_azimuth: float = 140.0
    sun_elevation: float = 45.0
    water_film: float = 0.0
    spray: bool = False

    def __post_init__(self) -> None:
        for name, low in (("rain_rate", 0.0), ("visibility", 1.0), ("illuminance", 0.0), ("water_film", 0.0)):
            if getattr(self, name) < low:
                raise ValueError(f"condition '{self.name}': {name}={getattr(self, name)} is below {low}")
        if not -90 <= self.sun_elevation <= 90:
            raise ValueError(f"condition '{self.name}': sun_elevation={self.sun_elevation} is not within [-90, 90]")

    @property
    def extinction(self) -> float:
        """Extinction coefficient of visible and near-infrared light in 1/m: ln(20) / MOR (Koschmieder)."""
        return math.log(20.0) / self.visibility

    @property
    def is_night(self) -> bool:
        """Whether lamps are lit: under 200 lux."""
        return self.illuminance < 200.0


@beartype
@dataclass(frozen=True, kw_only=True)
class Preset:
    """Conditions of one kind: the [lowest, highest] value of each field of :class:`Condition`, in its units.

    The ``DECADES`` are drawn evenly in their logarithm, the others evenly.
    """

    illuminance: list[Number]
    sun_elevation: list[Number]
    sun_azimuth: list[Number] = field(default_factory=lambda: [-180.0, 180.0])
    visibility: list[Number] = field(default_factory=lambda: [CLEAR_MOR, CLEAR_MOR])
    rain_rate: list[Number] = field(default_factory=lambda: [0.0, 0.0])
    water_film: list[Number] = field(default_factory=lambda: [0.0, 0.0])
    spray: bool = False

    def __post_init__(self) -> None:
        for key, bounds in self._ranges().items():
            if len(bounds) != 2 or not bounds[0] <= bounds[1]:
                raise ValueError(f"condition: {key}={bounds} is not [lowest, highest]")
            if key in DECADES and bounds[0] <= 0:
                raise ValueError(f"condition: {key}={bounds} must be above 0, as it is drawn on a logarithmic scale")

    def draw(self, name: str, rng: np.random.Generator) -> Condition:
        """One condition of this kind, called ``name``."""
        values = {}
        for key, (low, high) in self._ranges().items():
            share = rng.random()
            values[key] = float(low * (high / low) ** share if key in DECADES else low + (high - low) * share)
        return Condition(name=name, spray=self.spray, **values)

    def _ranges(self) -> dict[str, list[Number]]:
        return {key: value for key, value in vars(self).items() if key != "spray"}


@beartype
@dataclass(frozen=True, kw_only=True)
class ConditionMix:
    """Presets by name, and the share of scenes that each gets (in proportion to ``weights``)."""

    presets: dict[str, Preset]
    weights: dict[str, Number]

    def __post_init__(self) -> None:
        if unknown := sorted(self.weights.keys() - self.presets.keys()):
            raise ValueError(f"condition: weights name '{unknown[0]}', but the presets are {', '.join(self.presets)}")
        if min(self.weights.values(), default=0.0) < 0 or sum(self.weights.values()) <= 0:
            raise ValueError(f"condition: weights {self.weights} are negative or all zero")

    def draw(self, rng: np.random.Generator) -> Condition:
        """The condition of one scene."""
        names = sorted(self.weights)
        shares = np.array([self.weights[name] for name in names])
        name = names[rng.choice(len(names), p=shares / shares.sum())]
        return self.presets[name].draw(name, rng)
