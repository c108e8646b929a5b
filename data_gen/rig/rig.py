"""The sensors of a car: where they sit, what they are, when they fire."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from data_gen.rig.rig_checks import check_rig
from fusion_net.common.geometry import from_rpy, rigid

EGO_T_OPTICAL = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.zeros(3))
"""A level camera looking along ego x: camera x (right) is -y, camera y (down) is -z, camera z (forward) is x."""


@beartype
@dataclass(frozen=True, kw_only=True)
class Mount:
    """A sensor's place. ``translation`` in the ego frame (m); ``rotation_deg`` roll, pitch (positive: nose down), yaw of
    the sensor's body, whose x axis is its boresight. ``rate`` Hz, ``phase`` s and ``jitter`` s say when it fires: at phase +
    n / rate, with a standard deviation of ``jitter``."""

    translation: list[float]
    rotation_deg: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    rate: float
    phase: float = 0.0
    jitter: float = 0.0

    @cached_property
    def ego_T_body(self) -> NDArray[np.float64]:
        """(4, 4): body axes are x along the boresight, y left, z up."""
        roll, pitch, yaw = np.radians(self.rotation_deg).tolist()
        return from_rpy(roll, pitch, yaw, self.translation)

    @property
    def ego_T_sensor(self) -> NDArray[np.float64]:
        """(4, 4) of the frame that the sensor's data are written in, as nuScenes defines it for the modality."""
        return self.ego_T_body


@beartype
@dataclass(frozen=True, kw_only=True)
class Camera(Mount):
    """A pinhole camera. ``principal`` is the principal point in pixels, None for the image's centre."""

    width: int
    height: int
    hfov_deg: float
    principal: list[float] | None = None

    @property
    def cam_K(self) -> NDArray[np.float64]:
        """Pinhole matrix (3, 3) in pixels, square pixels."""
        f = self.width / 2 / math.tan(math.radians(self.hfov_deg) / 2)
        cx, cy = self.principal or (self.width / 2, self.height / 2)
        return np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])

    @property
    def ego_T_sensor(self) -> NDArray[np.float64]:
        """Optical frame: x right, y down, z forward."""
        return self.ego_T_body @ EGO_T_OPTICAL


@beartype
@dataclass(frozen=True, kw_only=True)
class Lidar(Mount):
    """A spinning LiDAR with the HDL-32E's beams. ``columns`` firings a turn; ``sector_deg`` the azimuths kept, counter-
    clockwise from the boresight, [-180, 180] for all; ``cut_deg`` the azimuth at which a turn begins and ends, so what lies
    just past it counter-clockwise is the freshest (nuScenes: 105); ``max_range`` at which a 90 % target disappears;
    ``crosstalk`` the share of the rays in which the pulse of another LiDAR is heard.

    Data are written in nuScenes' LIDAR_TOP frame: x right, y forward, z up.
    """

    columns: int
    sector_deg: list[float] = field(default_factory=lambda: [-180.0, 180.0])
    cut_deg: float = 105.0
    max_range: float = 100.0
    crosstalk: float = 0.0

    @property
    def ego_T_sensor(self) -> NDArray[np.float64]:
        """(4, 4): the body frame turned by -90 degrees."""
        return self.ego_T_body @ from_rpy(0.0, 0.0, -math.pi / 2)


@beartype
@dataclass(frozen=True, kw_only=True)
class Radar(Mount):
    """A 77 GHz FMCW radar that reports detections. Resolutions are cell sizes; ``max_range`` m, ``fov_deg`` half-angle;
    Doppler beyond +-``max_doppler`` m/s folds; the strongest ``max_detections`` of a scan are reported."""

    max_range: float = 100.0
    fov_deg: float = 60.0
    range_resolution: float = 0.4
    azimuth_resolution_deg: float = 3.2
    doppler_resolution: float = 0.1
    max_doppler: float = 111.0
    max_detections: int = 64


@beartype
@dataclass(frozen=True, kw_only=True)
class Rig:
    """All sensors by nuScenes channel name. ``keyframe_rate`` Hz; ``sweeps`` by modality how many firings before each
    keyframe's are written (0, if not named: none), or ``all`` since the keyframe before."""

    name: str
    cameras: dict[str, Camera]
    lidars: dict[str, Lidar]
    radars: dict[str, Radar]
    keyframe_rate: float = 2.0
    sweeps: dict[str, int | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_rig(self)

    @property
    def sensors(self) -> dict[str, Mount]:
        """Every mount by channel: cameras, then LiDARs, then radars."""
        return {**self.cameras, **self.lidars, **self.radars}

    @property
    def modalities(self) -> dict[str, str]:
        """The modality of every channel."""
        return {c: "camera" if c in self.cameras else "lidar" if c in self.lidars else "radar" for c in self.sensors}

    def past_firings(self, channel: str) -> int | str:
        """The modality's number in ``sweeps``, or ALL."""
        return self.sweeps.get(self.modalities[channel], 0)
