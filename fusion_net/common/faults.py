"""What goes wrong with a car's sensors: one set of definitions for the generator, which renders a faulty car, and for the
reader, which spoils clean data as it reads them.

A :class:`Fault` is an effect, the sensors that it may hit and how often it does. What a channel suffers at one time are
:class:`SensorFaults`; all draws in it follow from (seed, scene or sample token, channel), so both ways draw alike.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.common.checks import check_names
from fusion_net.common.fault_effects import EFFECTS, Array, Effect, Mask, Number, Rings
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.common.random import stream

Key = tuple[int, str, *tuple[str | int, ...]]
"""Seed, token and more that a draw follows from."""


@beartype
@dataclass(frozen=True, kw_only=True)
class Fault:
    """An effect, and what it hits: ``sensors`` are modalities or channels, of which ``count`` drawn ones (None: each).

    Each of them is hit with ``probability``, drawn once a scene or once a sample, and then for as long.
    """

    sensors: list[str]
    effect: Effect
    count: int | None = None
    probability: Number = 1.0
    per: Literal["scene", "sample"] = "scene"

    def __post_init__(self) -> None:
        if not 0 <= self.probability <= 1:
            raise ValueError(f"fault: probability={self.probability} is not within [0, 1]")
        if self.count is not None and self.count < 1:
            raise ValueError(f"fault: count={self.count} hits nothing; use 1 or more, or null for every sensor")
        kind = type(self.effect)
        for sensor in self.sensors:
            if modality_of(sensor) not in kind.modalities:
                raise ValueError(
                    f"fault: {kind.__name__} cannot act on {sensor!r}; use {' or '.join(kind.modalities)}, or channels"
                )

    def matches(self, channels: Mapping[str, str]) -> list[str]:
        """Of channels (to modalities), those it may hit."""
        return sorted(c for c, modality in channels.items() if c in self.sensors or modality in self.sensors)

    def hits(self, channel: str, channels: Mapping[str, str], key: Key) -> bool:
        """Whether it hits ``channel`` in the draw that follows from ``key``."""
        matching = self.matches(channels)
        if channel not in matching:
            return False
        if self.count is not None:
            order = stream(*key).permutation(len(matching))
            matching = [matching[place] for place in order[: self.count]]
        return channel in matching and stream(*key, channel).random() < self.probability


def modality_of(sensor: str) -> str:
    """The modality that nuScenes' channel name tells; a modality is its own."""
    return {"CAM": "camera", "LIDAR": "lidar", "RADAR": "radar"}.get(sensor.split("_")[0], sensor)


@beartype
@dataclass(frozen=True)
class FaultPlan:
    """The faults of a data set and the seed of their draws."""

    faults: list[Fault] = field(default_factory=list)
    seed: int = 0

    def check(self, channels: Mapping[str, str], beams: Mapping[str, int]) -> None:
        """ValueError for a sensor that is not among these channels (to modalities), or an effect that is none on a LiDAR with
        so many ``beams``, by channel."""
        known = [*MODALITIES, *channels]
        for fault in self.faults:
            if wrong := [sensor for sensor in fault.sensors if sensor not in known]:
                raise ValueError(f"fault: there is no sensor {wrong[0]!r}; there are {', '.join(known)}")
            for channel in fault.matches(channels):
                if channel in beams:
                    fault.effect.check_lidar(channel, beams[channel])

    def on(self, channel: str, channels: Mapping[str, str], *, scene: str, sample: str) -> "SensorFaults":
        """What ``channel`` suffers in a sample, given both tokens."""
        drawn: list[tuple[Effect, Key]] = []
        for place, fault in enumerate(self.faults):
            key: Key = (self.seed, scene if fault.per == "scene" else sample, place)
            if fault.hits(channel, channels, key):
                drawn.append((fault.effect, (*key, channel, "values")))
        return SensorFaults(tuple(drawn))


@dataclass(frozen=True)
class SensorFaults:
    """Effects on one channel, each with the key of its draws. False where there is none."""

    drawn: tuple[tuple[Effect, Key], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.drawn)

    @property
    def dead(self) -> bool:
        """Whether the sensor gives nothing."""
        return any(effect.kills for effect, _ in self.drawn)

    @property
    def late_firings(self) -> int:
        """How many firings ago the delivered data were taken."""
        return sum(effect.late_firings() for effect, _ in self.drawn)

    def clock_error(self, since_start: float) -> float:
        """Reported minus true time, s."""
        return sum(effect.clock_error(since_start) for effect, _ in self.drawn)

    def true_mount(self, ego_T_sensor: Array) -> Array:
        """Where (4, 4) the sensor truly sits."""
        for effect, key in self.drawn:
            ego_T_sensor = effect.true_mount(ego_T_sensor, stream(*key))
        return ego_T_sensor

    def kept(self, points: NDArray, ego_T_sensor: Array, stamp: int, rings: Rings | None = None) -> Mask:
        """Which points (P, 3) of the sensor's frame are left of the firing reported at ``stamp`` us; ``rings`` of a LiDAR's."""
        x, y = (points @ ego_T_sensor[:2, :3].T).T if self.drawn else np.zeros((2, len(points)))
        azimuth = np.arctan2(y, x)
        kept = np.ones(len(points), bool)
        for effect, key in self.drawn:
            kept &= effect.kept(azimuth, rings, stream(*key), stream(*key, stamp))
        return kept

    def covered(self, height: int, width: int) -> Mask | None:
        """Which pixels (H, W) something on the lens hides; None: none."""
        masks = [effect.covered(height, width, stream(*key)) for effect, key in self.drawn]
        there = [mask for mask in masks if mask is not None]
        return np.logical_or.reduce(there) if there else None


@beartype
def at_severity(*, name: str, levels: list[list[Fault]], severity: int) -> list[Fault]:
    """The faults of the preset ``name`` at a severity, 1 for the first of its ``levels``."""
    if not 1 <= severity <= len(levels):
        there = f"has severities 1 to {len(levels)}" if len(levels) > 1 else "has only severity 1"
        raise ValueError(f"fault.severity={severity}: {name!r} {there}")
    return levels[severity - 1]


@beartype
def fault_at_severity(
    *,
    name: str,
    sensors: list[str],
    effect: str,
    levels: list[dict[str, Any]],
    severity: int,
    per: Literal["scene", "sample"] = "scene",
) -> list[Fault]:
    """The preset of a single fault at a severity. ``effect`` names a class of ``fault_effects``; each of the ``levels`` has
    what it takes there, and ``count`` and ``probability`` of the :class:`Fault` where the level has them."""
    check_names("effect", [effect], list(EFFECTS))
    known = [each.name for each in fields(EFFECTS[effect])]
    check_names(f"setting of {effect}", [key for level in levels for key in level], [*known, "count", "probability"])
    built = []
    for level in levels:
        chosen = EFFECTS[effect](**{key: value for key, value in level.items() if key in known})
        more = {key: value for key, value in level.items() if key not in known}
        built.append([Fault(sensors=sensors, effect=chosen, per=per, **more)])
    return at_severity(name=name, levels=built, severity=severity)
