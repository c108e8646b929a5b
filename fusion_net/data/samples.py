"""One keyframe as arrays: images, accumulated LiDAR and radar sweeps and labels, all in one reference frame.

The reference is the ego frame at the time of the LIDAR_TOP keyframe. A reading of another time is taken there through
the ego poses of both times: sensor -> ego then -> global -> ego at the reference.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.boxes import CLASSES, Boxes, transform_boxes
from fusion_net.data.cameras import CameraView, ImageFit, view_camera
from fusion_net.data.nuscenes import NuScenes, Record
from fusion_net.data.sensor_files import read_lidar, read_radar
from fusion_net.geometry import invert
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


@beartype
@dataclass(frozen=True, kw_only=True)
class SampleReader:
    """How a keyframe is read.

    ``cameras``: channels, None for all that the tree has. ``image_size`` [H, W]: images are scaled to W and lose rows
    at the top; None: as they are. ``lidar_sweeps``, ``radar_sweeps``: firings before the keyframe's that are added to
    it. ``motion_compensation`` False leaves each reading in the ego frame of its own time. ``propagate_radar`` moves
    radar points to the reference time by their measured (radial) velocity. ``modalities``: the others are not given
    and not present. ``label_stride``: pixels a cell of the depth and class labels (LiDAR depth is there even if the
    LiDAR is not given); None for no such labels.
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
        moment = _Moment(tree, token, self.motion_compensation)
        lidar, newest = self._lidar(moment)
        radar, has_radar = self._radar(moment)
        views = [self._camera(moment, channel, lidar[:newest]) for channel in self._camera_channels(tree)]
        present = {"camera": any(view.alive for view in views), "lidar": newest > 0, "radar": has_radar}
        return Sample(
            token=token,
            lidar_points=lidar if "lidar" in self.modalities else lidar[:0],
            radar_points=radar,
            present=np.array([present[name] and name in self.modalities for name in MODALITIES]),
            boxes=labelled_boxes(tree, token, self.classes),
            **_stack(views),
        )

    def _lidar(self, moment: "_Moment") -> tuple[NDArray[np.float32], int]:
        """Points (P, 5), those of the keyframe first, and how many these are (0: the LiDAR is dead)."""
        wanted = "lidar" in self.modalities or ("camera" in self.modalities and self.label_stride is not None)
        clouds = [np.zeros((0, len(LIDAR_CHANNELS)), np.float32)]
        newest = 0
        for channel in moment.tree.channels("lidar") if wanted else ():
            for place, record in enumerate(moment.firings(channel, self.lidar_sweeps)):
                cloud = _lidar_cloud(moment, record)
                clouds.insert(1, cloud) if place == 0 else clouds.append(cloud)
                newest += len(cloud) if place == 0 else 0
        return np.concatenate(clouds), newest

    def _radar(self, moment: "_Moment") -> tuple[NDArray[np.float32], bool]:
        """Points (R, 7) of all radars and whether any radar is alive."""
        channels = moment.tree.channels("radar") if "radar" in self.modalities else []
        records = [record for channel in channels for record in moment.firings(channel, self.radar_sweeps)]
        if not records:
            return np.zeros((0, len(RADAR_CHANNELS)), np.float32), False
        scans = [read_radar(moment.tree.path(record), default_filter=self.radar_default_filter) for record in records]
        seen, scan = np.concatenate(scans), np.repeat(np.arange(len(scans)), [len(scan) for scan in scans])
        ego_T_radar = np.stack([moment.ego_T_sensor(record) for record in records])[scan]
        age = np.array([moment.age(record) for record in records])[scan, None]
        place = np.stack([seen["x"], seen["y"], seen["z"]], axis=1)
        position = np.einsum("pij,pj->pi", ego_T_radar[:, :3, :3], place) + ego_T_radar[:, :3, 3]
        vector = np.stack([seen["vx_comp"], seen["vy_comp"]], axis=1)
        velocity = np.einsum("pij,pj->pi", ego_T_radar[:, :2, :2], vector)  # turned, not moved
        if self.propagate_radar:
            position[:, :2] += velocity * age
        return np.hstack([position, seen["rcs"][:, None], velocity, age]).astype(np.float32), True

    def _camera_channels(self, tree: NuScenes) -> list[str]:
        if "camera" not in self.modalities:
            return []
        return tree.channels("camera") if self.cameras is None else self.cameras

    def _camera(self, moment: "_Moment", channel: str, lidar: NDArray[np.float32]) -> CameraView:
        tree = moment.tree
        alive = moment.firings(channel)
        record = alive[0] if alive else tree.any_firing(channel)
        size = (record["height"], record["width"])
        return view_camera(
            tree.path(record) if alive else None,
            ImageFit(size, *(self.image_size or size)),
            tree.cam_K(record),
            moment.ego_T_sensor(record) if alive else tree.ego_T_sensor(record),
            lidar_points=lidar,
            label_of=self._label_of_pixel(),
            label_stride=self.label_stride,
        )

    def _label_of_pixel(self) -> NDArray[np.int64]:
        """(256,): from the value in a class image (0 none, 1 + index into CLASSES) to the configured label or -1."""
        label = np.full(256, -1)
        label[[1 + CLASSES.index(name) for name in self.classes]] = np.arange(len(self.classes))
        return label


class _Moment:
    """A sample's reference time and frame, and where readings of other times lie in it."""

    def __init__(self, tree: NuScenes, token: str, motion_compensation: bool) -> None:
        self.tree, self.token, self.motion_compensation = tree, token, motion_compensation
        self.reference = tree.reference(token)
        self.ego_T_global = invert(tree.global_T_ego(self.reference))

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
        return (self.reference["timestamp"] - record["timestamp"]) * 1e-6


def labelled_boxes(tree: NuScenes, token: str, classes: list[str]) -> Boxes:
    """The sample's objects of these classes with at least one LiDAR or radar point, in the reference ego frame."""
    annotations = tree.annotations(token, classes)
    ego_T_global = invert(tree.global_T_ego(tree.reference(token)))
    return transform_boxes(ego_T_global, annotations.boxes[annotations.num_pts > 0])


def _lidar_cloud(moment: _Moment, record: Record) -> NDArray[np.float32]:
    """Points (P, 5) of one sweep in the reference frame, without the car's own and without NaN."""
    points, time = read_lidar(moment.tree.path(record))
    own = (np.abs(points[:, 0]) < OWN_CAR) & (np.abs(points[:, 1]) < OWN_CAR)
    keep = ~own & np.isfinite(points.sum(axis=1))
    points, time = points[keep], time[keep]
    ego_T_lidar = moment.ego_T_sensor(record).astype(np.float32)
    cloud = np.empty((len(points), len(LIDAR_CHANNELS)), np.float32)
    cloud[:, :3] = points[:, :3] @ ego_T_lidar[:3, :3].T + ego_T_lidar[:3, 3]
    cloud[:, 3] = points[:, 3] / 255
    cloud[:, 4] = moment.age(record) - time
    return cloud


def _stack(views: list[CameraView]) -> dict[str, Any]:
    """The views' arrays by Sample's names, with the camera axis first; a label that any view lacks is None."""
    sizes = {view.image.shape[:2] for view in views}
    if len(sizes) > 1:
        raise ValueError(f"cameras of unlike sizes {sorted(sizes)}: give image_size, or name cameras of one size")
    if not views:
        return {
            "images": np.zeros((0, 0, 0, 3), np.uint8), "cam_K": np.zeros((0, 3, 3)), "ego_T_cam": np.zeros((0, 4, 4)),
            "lidar_depth": np.zeros((0, 0, 0), np.float32), "dense_depth": None, "class_map": None,
        }  # fmt: skip

    def stack(name: str) -> NDArray | None:
        values = [getattr(view, name) for view in views]
        return None if any(value is None for value in values) else np.stack(values)

    names = {"images": "image"} | {n: n for n in ("cam_K", "ego_T_cam", "lidar_depth", "dense_depth", "class_map")}
    return {field: stack(name) for field, name in names.items()}
