"""What a fault does to a sensor: the effects that a ``faults.Fault`` is made of."""

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import cv2
import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.common.geometry import from_rpy
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.common.settings import Number

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rng = np.random.Generator

MUD = 12
"""Level of 255 of what a blocked lens shows."""


class Rings(NamedTuple):
    """Which beam measured each point of a LiDAR."""

    ring: NDArray  # (P,) from 0, the lowest beam
    beams: int  # how many the LiDAR has


class Effect:
    """What a fault does to a sensor. An effect overrides the hooks that it needs; the others leave all as it is.

    ``rng`` gives the values that stay the same for as long as the fault is active, ``rng_of_firing`` those of one measurement.
    """

    modalities: ClassVar[tuple[str, ...]] = MODALITIES
    """Sensors that it can act on."""
    kills: ClassVar[bool] = False
    """Whether the sensor gives nothing."""

    def check_lidar(self, channel: str, beams: int) -> None:
        """Raises ValueError if it cannot act on a LiDAR of so many beams."""

    def late_firings(self) -> int:
        """How many firings ago the delivered data were taken."""
        return 0

    def clock_error(self, since_start: float) -> float:
        """Reported minus true time in seconds, ``since_start`` seconds after the scene's first keyframe."""
        return 0.0

    def true_mount(self, ego_T_sensor: Array, rng: Rng) -> Array:
        """Where (4, 4) the sensor truly sits whose reported mount is ``ego_T_sensor``."""
        return ego_T_sensor

    def kept(self, azimuth: Array, rings: Rings | None, rng: Rng, rng_of_firing: Rng) -> Mask:
        """Which points (P,) are left. ``azimuth`` (P,) radians from the sensor, counter-clockwise from the ego's x axis;
        ``rings`` of a LiDAR's points."""
        return np.ones(len(azimuth), bool)

    def covered(self, height: int, width: int, rng: Rng) -> Mask | None:
        """Which pixels (H, W) of the image something on the lens hides."""
        return None


@beartype
@dataclass(frozen=True)
class Dead(Effect):
    """The sensor gives nothing."""

    kills: ClassVar[bool] = True

    def kept(self, azimuth: Array, rings: Rings | None, rng: Rng, rng_of_firing: Rng) -> Mask:
        """Nothing."""
        return np.zeros(len(azimuth), bool)


@beartype
@dataclass(frozen=True, kw_only=True)
class Stale(Effect):
    """The data of an earlier measurement come under the time stamp of this one: a buffer that was not refilled in time."""

    firings: int = 1

    def __post_init__(self) -> None:
        _at_least(0, firings=self.firings)

    def late_firings(self) -> int:
        """``firings``."""
        return self.firings


@beartype
@dataclass(frozen=True, kw_only=True)
class Clock(Effect):
    """The sensor's clock is wrong, and the car believes it.

    Reported - true time = ``offset`` + ``drift_ppm`` 1e-6 (``unsynchronised`` + t), t seconds into the scene, where
    ``unsynchronised`` are the seconds for which the clock had run by itself before. A sensor fires when its own clock says
    so, so at a positive offset what it delivers is older than its stamp.
    """

    offset: Number = 0.0
    drift_ppm: Number = 0.0
    unsynchronised: Number = 0.0

    def clock_error(self, since_start: float) -> float:
        """As the class says."""
        return self.offset + self.drift_ppm * 1e-6 * (self.unsynchronised + since_start)


@beartype
@dataclass(frozen=True, kw_only=True)
class Mismount(Effect):
    """The true mount has moved and the reported one has not: turned by ``rotation_deg`` (roll, pitch, yaw about the ego's
        axes, degrees) about the sensor, and moved by ``translation`` (m along the ego's axes).

    <<<<<<< HEAD
        ``drawn``: the six values are standard deviations of normally distributed ones, sampled each time the fault is.
    =======
        ``random``: the six values are standard deviations of normal distributions, sampled each time the fault is.
    >>>>>>> w/hC
    """

    rotation_deg: list[Number] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    translation: list[Number] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    random: bool = False

    def __post_init__(self) -> None:
        for name in ("rotation_deg", "translation"):
            if len(getattr(self, name)) != 3:
                raise ValueError(f"fault: {name}={getattr(self, name)} is not three numbers")

    def true_mount(self, ego_T_sensor: Array, rng: Rng) -> Array:
        """The turned and moved mount."""
        scale = rng.normal(size=6) if self.random else np.ones(6)
        roll, pitch, yaw = np.radians(self.rotation_deg) * scale[:3]
        true = from_rpy(roll, pitch, yaw) @ ego_T_sensor
        true[:3, 3] = ego_T_sensor[:3, 3] + np.array(self.translation) * scale[3:]
        return true


@beartype
@dataclass(frozen=True, kw_only=True)
class FewerBeams(Effect):
    """A LiDAR keeps ``keep`` of its beams, evenly spaced."""

    modalities: ClassVar[tuple[str, ...]] = ("lidar",)
    keep: int

    def __post_init__(self) -> None:
        _at_least(1, keep=self.keep)

    def check_lidar(self, channel: str, beams: int) -> None:
        """It has to have more beams than are kept."""
        if self.keep >= beams:
            raise ValueError(
                f"fault: keep={self.keep} takes no beam from {channel}, which has {beams}; use 1 to {beams - 1}"
            )

    def kept(self, azimuth: Array, rings: Rings | None, rng: Rng, rng_of_firing: Rng) -> Mask:
        """The lowest ring and every (beams / ``keep``)-th above it."""
        assert rings is not None
        return rings.ring.astype(int) * self.keep % rings.beams < self.keep


@beartype
@dataclass(frozen=True, kw_only=True)
class LostSector(Effect):
    """No returns from a sector of ``width_deg`` about ``center_deg``, counter-clockwise from straight ahead of the car;
    the centre is uniform within ``spread_deg`` to either side."""

    modalities: ClassVar[tuple[str, ...]] = ("lidar", "radar")
    width_deg: Number
    center_deg: Number = 0.0
    spread_deg: Number = 0.0

    def __post_init__(self) -> None:
        _at_least(0, width_deg=self.width_deg, spread_deg=self.spread_deg)

    def kept(self, azimuth: Array, rings: Rings | None, rng: Rng, rng_of_firing: Rng) -> Mask:
        """What lies outside the sector."""
        center = self.center_deg + self.spread_deg * rng.uniform(-1, 1)
        from_center = (np.degrees(azimuth) - center + 180) % 360 - 180
        return np.abs(from_center) > self.width_deg / 2


@beartype
@dataclass(frozen=True, kw_only=True)
class LostPoints(Effect):
    """Each return is lost with probability ``fraction``."""

    modalities: ClassVar[tuple[str, ...]] = ("lidar", "radar")
    fraction: Number

    def __post_init__(self) -> None:
        _fraction(fraction=self.fraction)

    def kept(self, azimuth: Array, rings: Rings | None, rng: Rng, rng_of_firing: Rng) -> Mask:
        """Sampled anew for each measurement."""
        return rng_of_firing.random(len(azimuth)) >= self.fraction


@beartype
@dataclass(frozen=True, kw_only=True)
class BlockedLens(Effect):
    """Mud in blots hides ``fraction`` of the image: nearly black, as it is far out of focus and lit from behind."""

    modalities: ClassVar[tuple[str, ...]] = ("camera",)
    fraction: Number
    blots: int = 6

    def __post_init__(self) -> None:
        _fraction(fraction=self.fraction)
        _at_least(1, blots=self.blots)

    def covered(self, height: int, width: int, rng: Rng) -> Mask | None:
        """Where smooth noise, ``blots`` knots along the image's height, exceeds its quantile."""
        knots = rng.normal(size=(self.blots, max(round(self.blots * width / height), 1)))
        noise = cv2.resize(knots, (width, height), interpolation=cv2.INTER_CUBIC)
        return noise > np.quantile(noise, 1 - self.fraction) if self.fraction < 1 else np.ones((height, width), bool)


EFFECTS: dict[str, type] = {
    kind.__name__: kind for kind in (Dead, Stale, Clock, Mismount, FewerBeams, LostSector, LostPoints, BlockedLens)
}
"""Every effect by name."""


def smear(image: NDArray[np.uint8], covered: Mask | None) -> NDArray[np.uint8]:
    """The image (H, W, 3) with what is covered (H, W) as dark as mud is."""
    return image if covered is None else np.where(covered[..., None], np.uint8(MUD), image)


def _at_least(low: Number, **values: Number) -> None:
    for name, value in values.items():
        if value < low:
            raise ValueError(f"fault: {name}={value} is below {low}")


def _fraction(**values: Number) -> None:
    for name, value in values.items():
        if not 0 <= value <= 1:
            raise ValueError(f"fault: {name}={value} is not within [0, 1]")
