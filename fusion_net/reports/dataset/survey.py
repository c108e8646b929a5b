"""What there is in a data set: its objects, keyframes and sensor data as arrays, before anything is counted."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import invert, transform
from fusion_net.common.nuscenes_format import CLASSES, MODALITIES
from fusion_net.data.readable import refuse_missing_files
from fusion_net.data.samples import SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.sensor_files import read_image, read_radar

UNKNOWN = "not stated"
"""Condition and layout of a data set that does not say, such as a real one."""
RADAR_GATE = 1.0
"""Metres by which a box is grown on every side before radar returns are counted as the object's."""
ALL = list(CLASSES)


@dataclass(frozen=True)
class Objects:
    """N labelled objects, one row per keyframe in which they are labelled."""

    keyframe: NDArray[np.int64]  # (N,) row of Survey's keyframes
    label: NDArray[np.int64]  # (N,) index into CLASSES
    place: NDArray[np.float64]  # (N, 2) metres in the ego frame
    speed: NDArray[np.float64]  # (N,) m/s, NaN where unknown
    visibility: NDArray[np.int64]  # (N,) 1 .. 4, 0 unknown
    lidar_points: NDArray[np.int64]  # (N,)
    radar_points: NDArray[np.int64]  # (N,)
    wlh: NDArray[np.float64]  # (N, 3) metres

    @property
    def range(self) -> NDArray[np.float64]:
        """(N,) metres from the ego."""
        return np.hypot(*self.place.T)


@dataclass(frozen=True)
class KeyframeData:
    """What the sensors measured in one keyframe. ``radar_returns`` holds one figure per radar; ``rcs_of`` the RCS of the
    returns at each class's boxes."""

    keyframe: int
    brightness: float  # mean of the first camera's image, 0 .. 255; NaN without a camera
    contrast: float  # its standard deviation
    lidar_points: int
    radar_returns: list[int]
    rcs: NDArray[np.float32]  # dBsm of every return
    speed: NDArray[np.float32]  # m/s, compensated, of every return
    rcs_of: dict[str, NDArray[np.float32]]


@dataclass
class Survey:
    """A data set. ``condition``, ``severity`` and ``layout`` say it for each keyframe, ``scene`` which scene it is of;
    ``pictures`` has one image per condition and severity."""

    scene: list[str] = field(default_factory=list)
    condition: list[str] = field(default_factory=list)
    severity: list[int] = field(default_factory=list)
    layout: list[str] = field(default_factory=list)
    sensor_data: list[KeyframeData] = field(default_factory=list)
    pictures: dict[tuple[str, int], NDArray[np.uint8]] = field(default_factory=dict)
    channels: dict[str, list[str]] = field(default_factory=dict)
    image_size: tuple[int, int] = (0, 0)
    objects: Objects = field(init=False)


def survey(samples: Sequence[tuple[NuScenes, str]], *, files: int) -> Survey:
    """Looks at the labels of all ``samples`` (data set, token) and at the files of at most ``files`` of them."""
    found = Survey()
    first = samples[0][0]
    found.channels = {name: first.channels(name) for name in MODALITIES}
    opened = set(np.linspace(0, len(samples) - 1, files).round().astype(int).tolist())
    reader = SampleReader(cameras=found.channels["camera"][:1], lidar_sweeps=0, radar_sweeps=0, label_stride=None)
    refuse_missing_files([samples[row] for row in sorted(opened)], reader)
    parts = []
    for row, (nusc, token) in enumerate(samples):
        scene = nusc.scene(token)
        condition = scene.get("condition", {})
        found.scene.append(scene["name"])
        found.condition.append(condition.get("name", UNKNOWN))
        found.severity.append(condition.get("severity", 1))
        found.layout.append(scene.get("layout", UNKNOWN))
        parts.append(_objects(nusc, token, row))
        if row in opened:
            found.sensor_data.append(_keyframe_data(nusc, token, row, found))
    columns = zip(*parts, strict=True)
    found.objects = Objects(*(np.concatenate(column) for column in columns))
    return found


def _objects(nusc: NuScenes, token: str, row: int) -> tuple[NDArray, ...]:
    """The columns of Objects for one sample."""
    labels = nusc.annotations(token, ALL)
    boxes = labels.boxes
    place = transform(invert(nusc.global_T_ego(nusc.reference(token))), boxes.center)[:, :2]
    speed = np.hypot(*boxes.velocity.T)
    return (
        np.full(len(boxes), row), boxes.label, place, speed, labels.visibility, labels.num_lidar_pts,
        labels.num_radar_pts, boxes.wlh,
    )  # fmt: skip


def _keyframe_data(nusc: NuScenes, token: str, row: int, found: Survey) -> KeyframeData:
    light = np.array([np.nan, np.nan])
    camera = next((nusc.keyframes[token][c] for c in found.channels["camera"] if c in nusc.keyframes[token]), None)
    if camera is not None:
        with nusc.file_of(camera) as path:
            image = read_image(path, nusc.image_size(camera))
        found.image_size = image.shape[1], image.shape[0]
        found.pictures.setdefault((found.condition[row], found.severity[row]), image)
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        light = np.array([grey.mean(), grey.std()])
    reader = SampleReader(lidar_sweeps=0, radar_sweeps=0, label_stride=None, modalities=["lidar", "radar"])
    sample = reader.read(nusc, token)
    radar = sample.radar_points
    alone = [_radar_returns(nusc, token, channel) for channel in found.channels["radar"]]
    return KeyframeData(
        row, float(light[0]), float(light[1]), len(sample.lidar_points), [count for count in alone if count >= 0],
        radar[:, 3], np.hypot(radar[:, 4], radar[:, 5]), _rcs_of(sample.boxes, radar),
    )  # fmt: skip


def _radar_returns(nusc: NuScenes, token: str, channel: str) -> int:
    """Returns of one unit's keyframe scan, -1 where it gave none."""
    records = nusc.keyframe_and_sweeps(token, channel, 0)
    if not records:
        return -1
    with nusc.file_of(records[0]) as path:
        return len(read_radar(path))


def _rcs_of(boxes: Boxes, radar: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """RCS of the returns (R, 7) that lie at the boxes, by class."""
    delta = radar[:, None, :2] - boxes.center[None, :, :2]
    cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
    along, across = delta[..., 0] * cos + delta[..., 1] * sin, -delta[..., 0] * sin + delta[..., 1] * cos
    half = boxes.wlh / 2 + RADAR_GATE
    inside = (np.abs(along) <= half[:, 1]) & (np.abs(across) <= half[:, 0])
    return {CLASSES[c]: radar[inside[:, boxes.label == c].any(axis=1), 3] for c in np.unique(boxes.label).tolist()}
