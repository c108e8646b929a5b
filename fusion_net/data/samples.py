"""One keyframe as arrays: images, accumulated LiDAR and radar sweeps and labels, all in one reference frame: the ego frame
at the time of the LIDAR_TOP keyframe.
"""

from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes, transform_boxes
from fusion_net.common.fault_effects import apply_mask
from fusion_net.common.faults import Fault, FaultPlan
from fusion_net.common.geometry import invert
from fusion_net.common.nuscenes_format import CLASSES, MODALITIES
from fusion_net.data.batch import LIDAR_CHANNELS
from fusion_net.data.cameras import CameraView, check_size, fit_image, view_camera
from fusion_net.data.point_clouds import lidar_point_cloud, radar_point_cloud
from fusion_net.data.propagation import propagate_lidar, propagate_radar
from fusion_net.data.sensor_frames import SampleContext
from fusion_net.nuscenes.nuscenes import NuScenes


@dataclass(frozen=True)
class Sample:
    """One sample of a ``batch.Batch`` as numpy arrays. Frame: ego at the reference time."""

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
    colors: NDArray[np.float32] | None = None  # (3, 4) colour augmentation of the images, see augment.py


@beartype
@dataclass(frozen=True, kw_only=True)
class SampleReader:
    """How a keyframe is read.

    ``cameras``: channels, None for all that the data set has. ``image_size`` [H, W]: images are scaled to W and lose rows
    at the top; None: at most ``cameras.MAX_WIDTH`` wide and cut to whole cells of ``label_stride``, or as they are without
    one. ``lidar_sweeps``, ``radar_sweeps``: sweeps before the keyframe that are added to it. ``motion_compensation``
    False leaves each sensor frame in the ego frame of its own time. ``propagate_radar`` moves radar points to the reference
    time by their measured (radial) velocity, and ``propagate_lidar`` the LiDAR points near them. ``modalities``: files of the
    others are not opened, and they are not present. ``label_stride``: pixels per cell of the depth and class labels (the
    LiDAR is then read for them even if it is not given); None for no such labels. ``faults`` are applied to what is read;
    their random values follow from ``fault_seed`` and the sample.
    """

    classes: list[str] = field(default_factory=lambda: list(CLASSES))
    cameras: list[str] | None = None
    image_size: list[int] | None = None
    lidar_sweeps: int = 0
    radar_sweeps: int = 2
    label_stride: int | None = 8
    motion_compensation: bool = True
    propagate_radar: bool = True
    propagate_lidar: bool = False
    radar_default_filter: bool = False
    modalities: list[str] = field(default_factory=lambda: list(MODALITIES))
    faults: list[Fault] = field(default_factory=list)
    fault_seed: int = 0

    def __post_init__(self) -> None:
        for name, given, known in (("classes", self.classes, CLASSES), ("modalities", self.modalities, MODALITIES)):
            wrong = [value for value in given if value not in known or given.count(value) > 1]
            if wrong:
                raise ValueError(f"{name}: {wrong[0]!r} is unknown or there twice; choose from {', '.join(known)}")
        if self.lidar_sweeps < 0 or self.radar_sweeps < 0:
            raise ValueError(f"lidar_sweeps={self.lidar_sweeps}, radar_sweeps={self.radar_sweeps}: use 0 or more")
        if self.label_stride is not None and self.label_stride < 1:
            raise ValueError(f"label_stride={self.label_stride}: use 1 or more pixels")
        if self.image_size is not None:
            check_size(self.image_size, self.label_stride)

    def channels_of(self, nusc: NuScenes) -> dict[str, int]:
        """The channels of a data set whose files are read, each with the number of sweeps before the keyframe."""
        past = {"camera": 0, "lidar": self.lidar_sweeps, "radar": self.radar_sweeps}
        return {channel: past[name] for name in MODALITIES for channel in self._channels(nusc, name)}

    def read(self, nusc: NuScenes, token: str) -> Sample:
        """The sample with this token."""
        plan = FaultPlan(self.faults, self.fault_seed)
        context = SampleContext(nusc, token, plan, motion_compensation=self.motion_compensation)
        lidar, newest = self._lidar(context)
        views = [self._camera(context, channel, lidar[:newest]) for channel in self._channels(nusc, "camera")]
        radars = self._channels(nusc, "radar")
        scans = [frame for channel in radars for frame in context.sensor_frames(channel, self.radar_sweeps)]
        radar = radar_point_cloud(context, scans, default_filter=self.radar_default_filter)
        at_reference = propagate_radar(radar)
        present = {"camera": any(view.alive for view in views), "lidar": newest > 0, "radar": bool(scans)}
        lidar = lidar if "lidar" in self.modalities else lidar[:0]
        return Sample(
            token=token,
            lidar_points=propagate_lidar(lidar, at_reference) if self.propagate_lidar else lidar,
            radar_points=at_reference if self.propagate_radar else radar,
            present=np.array([present[name] and name in self.modalities for name in MODALITIES]),
            boxes=labelled_boxes(nusc, token, self.classes),
            **_stack(views),
        )

    def _lidar(self, context: SampleContext) -> tuple[NDArray[np.float32], int]:
        """Points (P, 5), those of the keyframe first, and how many these are (0: the LiDAR is dead)."""
        new: list[NDArray[np.float32]] = [np.zeros((0, len(LIDAR_CHANNELS)), np.float32)]
        old: list[NDArray[np.float32]] = []
        for channel in self._channels(context.nusc, "lidar"):
            clouds = [lidar_point_cloud(context, frame) for frame in context.sensor_frames(channel, self.lidar_sweeps)]
            if clouds and len(clouds[0]):
                new, old = [*new, clouds[0]], [*old, *clouds[1:]]
        return np.concatenate(new + old), sum(map(len, new))

    def _channels(self, nusc: NuScenes, modality: str) -> list[str]:
        """Channels of a modality that are read; the LiDAR's also where it labels the cells of images."""
        labels = modality == "lidar" and "camera" in self.modalities and self.label_stride is not None
        if modality not in self.modalities and not labels:
            return []
        return self.cameras if modality == "camera" and self.cameras is not None else nusc.channels(modality)

    def _camera(self, context: SampleContext, channel: str, lidar: NDArray[np.float32]) -> CameraView:
        nusc = context.nusc
        alive = context.sensor_frames(channel)
        record = alive[0].record if alive else nusc.calibration_record(channel)
        size = nusc.image_size(record)
        with nusc.file_of(record) if alive else nullcontext() as path:
            fit = fit_image(size, self.image_size, self.label_stride)
            view = view_camera(
                path,
                fit,
                nusc.cam_K(record),
                alive[0].ego_T_sensor if alive else nusc.ego_T_sensor(record),
                lidar_points=lidar,
                label_of=self._label_of_pixel(),
                label_stride=self.label_stride,
            )
        covered = alive[0].faults.covered(*size) if alive else None
        return (
            view
            if covered is None
            else replace(view, image=apply_mask(view.image, fit.image(covered.view(np.uint8)) > 0))
        )

    def _label_of_pixel(self) -> NDArray[np.int64]:
        """(256,): from the value in a class image (0 none, 1 + index into CLASSES) to the configured label or -1."""
        label = np.full(256, -1)
        label[[1 + CLASSES.index(name) for name in self.classes]] = np.arange(len(self.classes))
        return label


def labelled_boxes(nusc: NuScenes, token: str, classes: list[str]) -> Boxes:
    """The sample's objects of these classes with at least one LiDAR or radar point, in the reference ego frame."""
    annotations = nusc.annotations(token, classes)
    ego_T_global = invert(nusc.global_T_ego(nusc.reference(token)))
    return transform_boxes(ego_T_global, annotations.boxes[annotations.num_pts > 0])


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
