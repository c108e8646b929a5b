"""What goes wrong with a car's sensors: one set of definitions for the generator, which renders a faulty car, and for the
reader, which applies faults to clean data as it reads them.

A :class:`Fault` is an effect, the sensors that it may hit and with what probability. The faults that are active on a channel
at one time are :class:`SensorFaults`; their random values follow from (seed, scene or sample token, channel), so that
generator and reader sample the same ones.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.common.checks import check_names
from fusion_net.common.fault_effects import EFFECTS, Array, Effect, Mask, Rings
from fusion_net.common.modalities import modality_of
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.common.random import stream
from fusion_net.common.settings import Number

Key = tuple[int, str, *tuple[str | int, ...]]
"""Seed, token and more that a random stream follows from."""


@beartype
@dataclass(frozen=True, kw_only=True)
class Fault:
    """An effect, and what it hits: ``sensors`` are modalities or channels, of which ``count`` at random (None: each).

    Each of them is hit with ``probability``, sampled once per scene or once per sample, and then for as long.
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
        """Whether it hits ``channel`` by the random stream of ``key``."""
        matching = self.matches(channels)
        if channel not in matching:
            return False
        if self.count is not None:
            order = stream(*key).permutation(len(matching))
            matching = [matching[place] for place in order[: self.count]]
        return channel in matching and stream(*key, channel).random() < self.probability


@beartype
@dataclass(frozen=True)
class FaultPlan:
    """The faults of a data set and the seed of their random values."""

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
        """The faults that are active on ``channel`` in a sample, given both tokens."""
        active: list[tuple[Effect, Key]] = []
        for place, fault in enumerate(self.faults):
            key: Key = (self.seed, scene if fault.per == "scene" else sample, place)
            if fault.hits(channel, channels, key):
                active.append((fault.effect, (*key, channel, "values")))
        return SensorFaults(tuple(active))


@dataclass(frozen=True)
class SensorFaults:
    """Active effects on one channel, each with the key of its random values. False where there is none."""

    active: tuple[tuple[Effect, Key], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.active)

    @property
    def dead(self) -> bool:
        """Whether the sensor gives nothing."""
        return any(effect.kills for effect, _ in self.active)

    @property
    def late_firings(self) -> int:
        """How many firings ago the delivered data were taken."""
        return sum(effect.late_firings() for effect, _ in self.active)

    def clock_error(self, since_start: float) -> float:
        """Reported minus true time, s."""
        return sum(effect.clock_error(since_start) for effect, _ in self.active)

    def true_mount(self, ego_T_sensor: Array) -> Array:
        """Where (4, 4) the sensor truly sits."""
        for effect, key in self.active:
            ego_T_sensor = effect.true_mount(ego_T_sensor, stream(*key))
        return ego_T_sensor

    def kept(self, points: NDArray, ego_T_sensor: Array, stamp: int, rings: Rings | None = None) -> Mask:
        """Which points (P, 3) of the sensor's frame are left of the firing reported at ``stamp`` us; ``rings`` of a LiDAR's."""
        x, y = (points @ ego_T_sensor[:2, :3].T).T if self.active else np.zeros((2, len(points)))
        azimuth = np.arctan2(y, x)
        kept = np.ones(len(points), bool)
        for effect, key in self.active:
            kept &= effect.kept(azimuth, rings, stream(*key), stream(*key, stamp))
        return kept

    def covered(self, height: int, width: int) -> Mask | None:
        """Which pixels (H, W) something on the lens hides; None: none."""
        masks = [effect.covered(height, width, stream(*key)) for effect, key in self.active]
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
