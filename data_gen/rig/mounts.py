"""The sensors of a car: where they sit, what they are, when they fire, what they cover."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from beartype import beartype
from numpy.typing import ArrayLike, NDArray

from data_gen.rig.lidar_model import LidarModel
from fusion_net.common.geometry import from_rpy, invert, project, rigid, transform
from fusion_net.common.nuscenes_format import BEAMS

Array = NDArray[np.float64]
Interval = tuple[float, float]

EGO_T_OPTICAL = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.zeros(3))
"""A level camera looking along ego x: camera x (right) is -y, camera y (down) is -z, camera z (forward) is x."""


@beartype
@dataclass(frozen=True, kw_only=True)
class Mount:
    """A sensor's place. ``translation`` in the ego frame (m); ``rotation_deg`` roll, pitch (positive: nose down), yaw of
    the sensor's body, whose x axis is its boresight. ``rate`` Hz, ``phase`` s and ``jitter`` s say when it fires: at phase +
    n / rate, with a standard deviation of ``jitter``."""

    modality: ClassVar[str]
    translation: list[float]
    rotation_deg: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    rate: float
    phase: float = 0.0
    jitter: float = 0.0

    @cached_property
    def ego_T_body(self) -> Array:
        """(4, 4): body axes are x along the boresight, y left, z up."""
        roll, pitch, yaw = np.radians(self.rotation_deg).tolist()
        return from_rpy(roll, pitch, yaw, self.translation)

    @property
    def ego_T_sensor(self) -> Array:
        """(4, 4) of the frame that the sensor's data are written in, as nuScenes defines it for the modality."""
        return self.ego_T_body

    @property
    def max_range(self) -> float:
        """Metres beyond which it detects nothing."""
        return math.inf

    @property
    def azimuth_range_deg(self) -> Interval:
        """Azimuths that it covers, counter-clockwise from its boresight: right-hand then left-hand edge."""
        raise NotImplementedError

    @property
    def nominal_azimuth_range_deg(self) -> Interval:
        """The same by its nominal figures."""
        return self.azimuth_range_deg

    @property
    def elevations_deg(self) -> Array:
        """Elevations over its x-y plane, ascending: of a LiDAR's beams, of an image's lower and upper edge; (0,) of a radar."""
        return np.zeros(0)

    @property
    def resolution(self) -> tuple[int, int] | None:
        """Width and height of an image, beams and columns of a turn; None of a radar, which has cells."""
        return None

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height in pixels; 0, 0 of a sensor without an image."""
        return 0, 0

    @property
    def calibration_fields(self) -> dict[str, Any]:
        """What its record in nuScenes' table calibrated_sensor has besides its place."""
        return {"camera_intrinsic": []}

    def sees(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Which ego points (N, 3) lie within its field of view and range."""
        body = transform(invert(self.ego_T_body), points)
        low, high = self.azimuth_range_deg
        inside = (np.degrees(np.arctan2(body[:, 1], body[:, 0])) - low) % 360 <= high - low
        distance = np.linalg.norm(body, axis=1)
        if len(self.elevations_deg):
            elevation = np.degrees(np.arcsin(body[:, 2] / np.maximum(distance, 1e-9)))
            inside &= (elevation >= self.elevations_deg[0]) & (elevation <= self.elevations_deg[-1])
        return inside & (distance <= self.max_range)

    def rays(self) -> Array:
        """Directions (N, 3) in the ego frame all over its field of view; none of a radar."""
        azimuth, elevation = np.radians(np.meshgrid(np.linspace(*self.azimuth_range_deg, 181), self.elevations_deg))
        level = np.cos(elevation)
        body = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)
        return body.reshape(-1, 3) @ self.ego_T_body[:3, :3].T

    @property
    def nearest_ground(self) -> float:
        """Horizontal distance in metres to the nearest ground in its field of view; inf where there is none."""
        rays = self.rays()
        down = rays[rays[:, 2] < -1e-6]
        reach = np.hypot(down[:, 0], down[:, 1]) / -down[:, 2] * self.translation[2]
        return float(reach.min(initial=np.inf))


@beartype
@dataclass(frozen=True, kw_only=True)
class Camera(Mount):
    """A pinhole camera. ``principal`` is the principal point in pixels, None for the image's centre."""

    modality: ClassVar[str] = "camera"
    width: int
    height: int
    hfov_deg: float
    principal: list[float] | None = None

    @property
    def cam_K(self) -> Array:
        """Pinhole matrix (3, 3) in pixels, square pixels."""
        f = self.width / 2 / math.tan(math.radians(self.hfov_deg) / 2)
        cx, cy = self.principal or (self.width / 2, self.height / 2)
        return np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])

    @property
    def ego_T_sensor(self) -> Array:
        """Optical frame: x right, y down, z forward."""
        return self.ego_T_body @ EGO_T_OPTICAL

    @property
    def azimuth_range_deg(self) -> Interval:
        """Of the image's right-hand and left-hand edge."""
        (focal, _, cx), _, _ = self.cam_K.tolist()
        return float(-np.degrees(np.arctan((self.width - cx) / focal))), float(np.degrees(np.arctan(cx / focal)))

    @property
    def nominal_azimuth_range_deg(self) -> Interval:
        """About the boresight, wherever the principal point is."""
        return -self.hfov_deg / 2, self.hfov_deg / 2

    @property
    def elevations_deg(self) -> Array:
        """(2,) of the image's lower and upper edge, below and above the principal point."""
        _, (_, focal, cy), _ = self.cam_K.tolist()
        return np.degrees(np.arctan(np.array([cy - self.height, cy]) / focal))

    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height."""
        return self.image_size

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width, self.height

    @property
    def calibration_fields(self) -> dict[str, Any]:
        """The camera matrix, and the image's size, which nuScenes' own lacks."""
        return {"camera_intrinsic": self.cam_K.tolist(), "width": self.width, "height": self.height}

    def sees(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Which ego points (N, 3) lie in the image."""
        local = transform(invert(self.ego_T_sensor), points)
        (u, v), depth = project(self.cam_K, local)[0].T, local[:, 2]
        return (depth > 0) & (u >= 0) & (u < self.width) & (v >= 0) & (v < self.height)

    def rays(self) -> Array:
        """Through a grid of 65 x 65 pixels."""
        u, v = np.meshgrid(np.linspace(0, self.width, 65), np.linspace(0, self.height, 65))
        pixels = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1)
        return pixels @ np.linalg.inv(self.cam_K).T @ self.ego_T_sensor[:3, :3].T


@beartype
@dataclass(frozen=True, kw_only=True)
class Lidar(Mount):
    """A spinning LiDAR of a ``model``. ``columns`` a turn, None for all that the model fires; ``sector_deg`` the azimuths
    kept, counter-clockwise from the boresight, [-180, 180] for all; ``cut_deg`` the azimuth at which a turn begins and ends,
    so what lies just past it counter-clockwise is the freshest (nuScenes: 105); ``crosstalk`` the fraction of the rays that
    receive the pulse of another LiDAR.

    Data are written in nuScenes' LIDAR_TOP frame: x right, y forward, z up.
    """

    modality: ClassVar[str] = "lidar"
    model: LidarModel
    columns: int | None = None
    sector_deg: list[float] = field(default_factory=lambda: [-180.0, 180.0])
    cut_deg: float = 105.0
    crosstalk: float = 0.0

    @property
    def ego_T_sensor(self) -> Array:
        """(4, 4): the body frame turned by -90 degrees."""
        return self.ego_T_body @ from_rpy(0.0, 0.0, -math.pi / 2)

    @property
    def max_range(self) -> float:
        """The model's."""
        return self.model.max_range

    @property
    def turn_columns(self) -> int:
        """Columns of a full turn."""
        return self.model.columns_in(1 / self.rate) if self.columns is None else self.columns

    @property
    def azimuth_range_deg(self) -> Interval:
        """The sector that is kept."""
        return self.sector_deg[0], self.sector_deg[1]

    @property
    def elevations_deg(self) -> Array:
        """(B,) of the beams."""
        return np.sort(np.array(self.model.elevation_deg, float))

    @property
    def calibration_fields(self) -> dict[str, Any]:
        """How many beams there are, which nuScenes' own lacks."""
        return super().calibration_fields | {BEAMS: self.model.beams}

    @property
    def resolution(self) -> tuple[int, int]:
        """Beams, and columns of the sector."""
        low, high = self.azimuth_range_deg
        return self.model.beams, round(self.turn_columns * (high - low) / 360)


@beartype
@dataclass(frozen=True, kw_only=True)
class Radar(Mount):
    """A 77 GHz FMCW radar that reports detections. Resolutions are cell sizes; ``max_range`` m, ``fov_deg`` half-angle;
    Doppler beyond +-``max_doppler`` m/s folds; the strongest ``max_detections`` of a scan are reported."""

    modality: ClassVar[str] = "radar"
    max_range: float = 100.0
    fov_deg: float = 60.0
    range_resolution: float = 0.4
    azimuth_resolution_deg: float = 3.2
    doppler_resolution: float = 0.1
    max_doppler: float = 111.0
    max_detections: int = 64

    @property
    def azimuth_range_deg(self) -> Interval:
        """The field of view."""
        return -self.fov_deg, self.fov_deg
