"""The physical state of a scene: one vector that every sensor reads, so that all of them see the same weather."""

import math
from dataclasses import dataclass, field

import numpy as np
from beartype import beartype

from fusion_net.common.settings import Number

CLEAR_MOR = 20_000.0
"""Meteorological optical range of clear air in metres."""

KOSCHMIEDER = math.log(20.0)
"""Extinction times meteorological optical range, which is where 5 % of a contrast are left."""

DECADES = ("illuminance", "visibility")
"""Quantities that span decades."""


@beartype
@dataclass(frozen=True)
class Condition:
    """Weather and light of one scene.

    Units: ``rain_rate`` mm/h, ``visibility`` (meteorological optical range, 5 % contrast, of the air with all that floats
    and falls in it) m, ``illuminance`` on the ground lux, sun angles in degrees (azimuth counter-clockwise from global x,
    elevation above the horizon; negative: set), ``water_film`` mm, ``spray`` whether wheels throw it up, ``dirt`` the fraction
    of a camera's lens that dried dirt covers. ``severity`` is the level of the preset it was sampled from, 1 the mildest.
    """

    name: str = "clear"
    severity: int = 1
    rain_rate: float = 0.0
    visibility: float = CLEAR_MOR
    illuminance: float = 60_000.0
    sun_azimuth: float = 140.0
    sun_elevation: float = 45.0
    water_film: float = 0.0
    spray: bool = False
    dirt: float = 0.0

    def __post_init__(self) -> None:
        lows = {"rain_rate": 0.0, "visibility": 1.0, "illuminance": 0.0, "water_film": 0.0, "dirt": 0.0}
        for name, low in lows.items():
            if getattr(self, name) < low:
                raise ValueError(f"condition '{self.name}': {name}={getattr(self, name)} is below {low}")
        if not -90 <= self.sun_elevation <= 90:
            raise ValueError(f"condition '{self.name}': sun_elevation={self.sun_elevation} is not within [-90, 90]")

    @property
    def extinction(self) -> float:
        """Extinction coefficient of visible and near-infrared light in 1/m: ln(20) / MOR (Koschmieder)."""
        return KOSCHMIEDER / self.visibility

    @property
    def rain_extinction(self) -> float:
        """What the falling drops contribute to it, in 1/m: 3.65e-4 R^0.63 (Marshall and Palmer's sizes, Q_ext = 2)."""
        return 3.65e-4 * self.rain_rate**0.63

    @property
    def mist_extinction(self) -> float:
        """The rest, in 1/m: fog, mist and haze."""
        return max(self.extinction - self.rain_extinction, 0.0)

    @property
    def is_night(self) -> bool:
        """Whether lamps are lit: under 200 lux."""
        return self.illuminance < 200.0


@beartype
@dataclass(frozen=True, kw_only=True)
class Preset:
    """Conditions of one kind and severity: the [lowest, highest] value of each field of :class:`Condition`, in its units.

    The ``DECADES`` are sampled evenly in their logarithm, the others evenly. With ``sun_ahead`` the sun's azimuth counts from
    the ego's heading: 0 shines into the front camera.
    """

    illuminance: list[Number]
    sun_elevation: list[Number]
    sun_azimuth: list[Number] = field(default_factory=lambda: [-180.0, 180.0])
    visibility: list[Number] = field(default_factory=lambda: [CLEAR_MOR, CLEAR_MOR])
    rain_rate: list[Number] = field(default_factory=lambda: [0.0, 0.0])
    water_film: list[Number] = field(default_factory=lambda: [0.0, 0.0])
    dirt: list[Number] = field(default_factory=lambda: [0.0, 0.0])
    spray: bool = False
    sun_ahead: bool = False

    def __post_init__(self) -> None:
        for key, bounds in self._ranges().items():
            if len(bounds) != 2 or not bounds[0] <= bounds[1]:
                raise ValueError(f"condition: {key}={bounds} is not [lowest, highest]")
            if key in DECADES and bounds[0] <= 0:
                raise ValueError(f"condition: {key}={bounds} must be above 0, as it is sampled on a logarithmic scale")

    def sample(self, name: str, severity: int, heading: float, rng: np.random.Generator) -> Condition:
        """One condition of this kind, called ``name``. ``heading`` of the ego in radians."""
        values = {}
        for key, (low, high) in self._ranges().items():
            uniform = rng.random()
            values[key] = float(low * (high / low) ** uniform if key in DECADES else low + (high - low) * uniform)
        if self.sun_ahead:
            values["sun_azimuth"] = (values["sun_azimuth"] + math.degrees(heading) + 180.0) % 360.0 - 180.0
        return Condition(name=name, severity=severity, spray=self.spray, **values)

    def _ranges(self) -> dict[str, list[Number]]:
        return {key: value for key, value in vars(self).items() if isinstance(value, list)}


@beartype
@dataclass(frozen=True, kw_only=True)
class ConditionMix:
    """Presets by name, and the fraction of scenes that each gets (in proportion to ``weights``).

    A preset has one entry a severity, mildest first. ``severity`` chooses it, None samples it evenly; a preset with fewer
    levels gives its worst.
    """

    presets: dict[str, list[Preset]]
    weights: dict[str, Number]
    severity: int | None = None

    def __post_init__(self) -> None:
        if unknown := sorted(self.weights.keys() - self.presets.keys()):
            raise ValueError(f"condition: weights name '{unknown[0]}', but the presets are {', '.join(self.presets)}")
        if min(self.weights.values(), default=0.0) < 0 or sum(self.weights.values()) <= 0:
            raise ValueError(f"condition: weights {self.weights} are negative or all zero")
        levels = max(len(self.presets[name]) for name, weight in self.weights.items() if weight > 0)
        if self.severity is not None and not 1 <= self.severity <= levels:
            there = "1 is the only severity" if levels == 1 else f"severities are 1 to {levels}, or null for any"
            raise ValueError(f"condition.severity={self.severity}: {there}")

    def sample(self, rng: np.random.Generator, *, heading: float) -> Condition:
        """The condition of one scene, whose ego starts at ``heading`` (radians, global)."""
        names = sorted(self.weights)
        weights = np.array([self.weights[name] for name in names])
        name = names[rng.choice(len(names), p=weights / weights.sum())]
        levels = self.presets[name]
        severity = min(self.severity or int(rng.integers(len(levels))) + 1, len(levels))
        return levels[severity - 1].sample(name, severity, heading, rng)
