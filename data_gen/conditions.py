"""The physical state of a scene: one vector that every sensor reads, so that all of them see the same weather."""

import math
from dataclasses import dataclass, field

import numpy as np
from beartype import beartype

CLEAR_MOR = 20_000.0
"""Meteorological optical range of clear air in metres."""


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

    Illuminance and visibility span decades and are drawn evenly in their logarithm, the others evenly.
    """

    illuminance: list[float]
    sun_elevation: list[float]
    sun_azimuth: list[float] = field(default_factory=lambda: [-180.0, 180.0])
    visibility: list[float] = field(default_factory=lambda: [CLEAR_MOR, CLEAR_MOR])
    rain_rate: list[float] = field(default_factory=lambda: [0.0, 0.0])
    water_film: list[float] = field(default_factory=lambda: [0.0, 0.0])
    spray: bool = False

    def draw(self, name: str, rng: np.random.Generator) -> Condition:
        """One condition of this kind, called ``name``."""
        values = {}
        for key, bounds in vars(self).items():
            if key == "spray":
                continue
            if len(bounds) != 2 or bounds[0] > bounds[1]:
                raise ValueError(f"condition '{name}': {key}={bounds} is not [lowest, highest]")
            decades = key in ("illuminance", "visibility") and bounds[0] > 0
            low, high = np.log(bounds) if decades else bounds
            value = low + (high - low) * rng.random()
            values[key] = float(np.exp(value) if decades else value)
        return Condition(name=name, spray=self.spray, **values)


@beartype
@dataclass(frozen=True, kw_only=True)
class ConditionMix:
    """Presets by name, and the share of scenes that each gets (in proportion to ``weights``)."""

    presets: dict[str, Preset]
    weights: dict[str, float]

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
