"""One keyframe as arrays: images, accumulated LiDAR and radar sweeps and labels, all in one reference frame.

The reference is the ego frame at the time of the LIDAR_TOP keyframe. A reading of another time is taken there through the
ego poses of both times: sensor -> ego then -> global -> ego at the reference.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.boxes import CLASSES, Boxes
from fusion_net.data.cameras import CameraView, read_camera
from fusion_net.data.nuscenes import NuScenes, Record
from fusion_net.data.sensor_files import read_lidar, read_radar
from fusion_net.geometry import invert, transform, wrap_angle, yaw_of
from fusion_net.structures import LIDAR_CHANNELS, MODALITIES, RADAR_CHANNELS

OWN_CAR = 1.0
"""Metres: LiDAR returns with |x| and |y| below it in the sensor frame are of the car itself (the devkit's figure)."""


@dataclass(frozen=True)
class Sample:
    """One sample of ``structures.Batch`` as numpy arrays. Frame: ego at the reference time."""

    token: str
    images: NDArray[np.uint8]  # (N, H, W, 3) RGB; black where the camera gave none
    cam_K: NDArray[np.float64]  # (N, 3, 3) of the image as it is here
    ego_T_cam: NDArray[np.float64]  # (N, 4, 4)
    lidar_points: NDArray[np.float32]  # (P, 5) LIDAR_CHANNELS
    radar_points: NDArray[np.float32]  # (R, 7) RADAR_CHANNELS
    present: NDArray[np.bool_]  # (M,) MODALITIES
    lidar_depth: NDArray[np.float32]  # (N, h, w)
    dense_depth: NDArray[np.float32] | None  # (N, h, w)
    class_map: NDArray[np.int64] | None  # (N, h, w)
    boxes: Boxes  # labelled objects of the configured classes with at least one LiDAR or radar point


class _Moment:
    """A sample's reference time and frame, and where other readings lie in it."""

    def __init__(self, tree: NuScenes, token: str, *, motion_compensation: bool) -> None:
        self.tree, self.token, self.motion_compensation = tree, token, motion_compensation
        self.record = tree.reference(token)
        self.ego_T_global = invert(tree.global_T_ego(self.record))

    def firings(self, channel: str, past: int = 0) -> list[Record]:
        """The channel's readings that are on disk, newest first; [] if its keyframe's is not: the sensor is dead."""
        records = self.tree.firings(self.token, channel, past)
        on_disk = [record for record in records if self.tree.path(record).exists()]
        return on_disk if on_disk and on_disk[0] is records[0] else []

    def ego_T_sensor(self, record: Record) -> NDArray[np.float64]:
        """From the sensor at its own time to the ego frame at the reference time (4, 4)."""
        mount = self.tree.ego_T_sensor(record)
        return self.ego_T_global @ self.tree.global_T_ego(record) @ mount if self.motion_compensation else mount

    def age(self, record: Record) -> float:
        """Seconds from a reading to the reference time."""
        return (self.record["timestamp"] - record["timestamp"]) * 1e-6


@beartype
@dataclass(frozen=True, kw_only=True)
class SampleReader:
    """How a keyframe is read.

    ``cameras``: channels, None for all that the tree has. ``image_size`` [H, W]: images are scaled to W and lose rows at the
    top; None: as they are. ``lidar_sweeps``, ``radar_sweeps``: firings before the keyframe's that are added to it.
    ``motion_compensation`` False leaves each reading in the ego frame of its own time. ``propagate_radar`` moves radar points
    to the reference time by their measured (radial) velocity. ``modalities``: the others are not given and not present.
    ``label_stride``: pixels a cell of the depth and class labels (LiDAR depth is there even if the LiDAR is not given);
    None for no such labels.
    """

    classes: list[str] = field(default_factory=lambda: list(CLASSES))
    cameras: list[str] | None = None
    image_size: list[int] | None = None
    lidar_sweeps: int = 0
    radar_sweeps: int = 2
    label_stride: int | None = 8
    motion_compensation: bool = True
    propagate_radar: bool = True
    radar_default_filter: bool = False
    modalities: list[str] = field(default_factory=lambda: list(MODALITIES))

    def __post_init__(self) -> None:
        for name, given, known in (("classes", self.classes, CLASSES), ("modalities", self.modalities, MODALITIES)):
            wrong = [value for value in given if value not in known or given.count(value) > 1]
            if wrong:
                raise ValueError(f"{name}: {wrong[0]!r} is unknown or there twice; choose from {', '.join(known)}")
        if self.lidar_sweeps < 0 or self.radar_sweeps < 0:
            raise ValueError(f"lidar_sweeps={self.lidar_sweeps}, radar_sweeps={self.radar_sweeps}: use 0 or more")

    def read(self, tree: NuScenes, token: str) -> Sample:
        """The sample with this token."""
        moment = _Moment(tree, token, motion_compensation=self.motion_compensation)
        lidar, newest = self._lidar(moment)
        radar, has_radar = self._radar(moment)
        views = [self._camera(moment, channel, lidar[newest]) for channel in self._channels(tree)]
        present = {"camera": any(view.alive for view in views), "lidar": len(newest) > 0, "radar": has_radar}
        return Sample(
            token=token,
            lidar_points=lidar if "lidar" in self.modalities else lidar[:0],
            radar_points=radar,
            present=np.array([present[name] and name in self.modalities for name in MODALITIES]),
            boxes=boxes_in_ego(tree, token, self.classes),
            **_stack(views),
        )
