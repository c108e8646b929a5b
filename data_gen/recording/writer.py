"""Writes the files of one scene and gathers its rows of the nuScenes tables."""

from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_gen.assets.shapes.mesh import Asset
from data_gen.recording.annotations import Row, annotation_rows, yaw_quaternion
from data_gen.recording.image_files import write_camera, write_map
from data_gen.recording.point_files import write_lidar, write_radar
from data_gen.recording.tokens import SceneNames, calibration_token, token
from data_gen.recording.visibility import Visibility
from data_gen.rig.rig import Rig
from data_gen.scene.scene import Scene
from data_gen.sensors.common.data import SensorData
from data_gen.sensors.common.event import CaptureEvent
from fusion_net.common.geometry import to_quaternion
from fusion_net.common.nuscenes_format import (
    CATEGORY_TO_CLASS,
    CLASSES,
    FILE_FORMAT,
    FILE_SUFFIX,
    MAPS,
    REFERENCE,
    SAMPLES,
    SWEEPS,
    TRUE_ROTATION,
    TRUE_TIMESTAMP,
    TRUE_TRANSLATION,
)


class SceneWriter:
    """Takes the events of one scene as they are captured; ``finish`` gives its rows by table name.

    ``times`` (K,) of the keyframes in seconds. Raises OSError when the disk does not take a file.
    """

    def __init__(
        self, scene: Scene, rig: Rig, names: SceneNames, *, times: NDArray[np.float64], root: Path, layout: str
    ) -> None:
        self._scene, self._rig, self._names, self._times = scene, rig, names, times
        self._root, self._layout = root, layout
        self._samples = names.sample_tokens(len(times))
        self._visibility = [Visibility(scene, t) for t in times.tolist()]
        self._classes = class_ids(scene)
        self._by_channel: dict[str, list[Row]] = {channel: [] for channel in rig.sensors}
        self._rows: dict[str, list[Row]] = {"sample_data": [], "ego_pose": []}

    def add(self, event: CaptureEvent, data: SensorData) -> None:
        """Counts what a keyframe shows of each object, and writes what the faults leave of the data. Of a dead sensor nothing
        is, but for the keyframe that gives a sample its time and pose, which is an empty cloud."""
        if event.is_keyframe:
            self._visibility[event.keyframe].add(event, data)
        if event.faults.dead and event.channel != REFERENCE:
            return
        stamp = self._names.stamp(event.time)
        modality = event.mount.modality
        folder = SAMPLES if event.is_keyframe else SWEEPS
        name = f"{self._names.log}__{event.channel}__{stamp}{FILE_SUFFIX[modality]}"
        filename = f"{folder}/{event.channel}/{name}"
        write_data(self._root / filename, modality, data.with_faults(event, stamp), self._classes)
        self._add_rows(event, stamp, filename)

    def _add_rows(self, event: CaptureEvent, stamp: int, filename: str) -> None:
        key = token(self._names.log, event.channel, stamp)
        position, yaw, _ = self._scene.ego.at(event.time)
        self._rows["ego_pose"].append(
            {"token": key, "timestamp": stamp, "rotation": yaw_quaternion(float(yaw)), "translation": position.tolist()}
        )
        width, height = event.mount.image_size
        row = {
            "token": key,
            "sample_token": self._samples[event.keyframe],
            "ego_pose_token": key,
            "calibrated_sensor_token": calibration_token(self._names.dataset, self._rig.name, event.channel),
            "timestamp": stamp,
            TRUE_TIMESTAMP: self._names.stamp(event.true_time),
            "fileformat": FILE_FORMAT[event.mount.modality],
            "is_key_frame": event.is_keyframe,
            "height": height,
            "width": width,
            "filename": filename,
            "prev": "",
            "next": "",
        }
        if event.faults and not np.array_equal(event.ego_T_sensor, event.mount.ego_T_sensor):
            row[TRUE_TRANSLATION] = event.ego_T_sensor[:3, 3].tolist()
            row[TRUE_ROTATION] = to_quaternion(event.ego_T_sensor).tolist()
        self._rows["sample_data"].append(row)
        self._by_channel[event.channel].append(row)

    def finish(self) -> dict[str, list[Row]]:
        """Writes the map; returns all rows of the scene."""
        for rows in self._by_channel.values():
            for before, after in pairwise(rows):
                before["next"], after["prev"] = after["token"], before["token"]
        instances, annotations = annotation_rows(self._scene, self._names, self._times, self._visibility)
        return {
            **self._log_and_map(),
            "scene": [self._scene_row()],
            "sample": self._sample_rows(),
            **self._rows,
            "instance": instances,
            "sample_annotation": annotations,
        }

    def _log_and_map(self) -> dict[str, list[Row]]:
        filename = f"{MAPS}/{self._names.log}.png"
        write_map(self._root / filename, self._scene.ground.drivable)
        key, log = self._names.log_token, self._names.log
        date = datetime.fromtimestamp(self._names.stamp(0.0) / 1e6, UTC).date().isoformat()
        place = f"{self._layout}-{self._scene.name}"  # of its own, as each scene has its own map
        return {
            "log": [
                {"token": key, "logfile": log, "vehicle": self._rig.name, "date_captured": date, "location": place}
            ],
            "map": [
                {"token": token(log, "map"), "log_tokens": [key], "category": "semantic_prior", "filename": filename}
            ],
        }

    def _scene_row(self) -> Row:
        condition = self._scene.condition
        return {
            "token": self._names.scene_token,
            "log_token": self._names.log_token,
            "nbr_samples": len(self._samples),
            "first_sample_token": self._samples[0],
            "last_sample_token": self._samples[-1],
            "name": self._scene.name,
            "description": f"{self._layout}, {condition.name}",
            "layout": self._layout,
            "condition": {name: getattr(condition, name) for name in condition.__dataclass_fields__},
        }

    def _sample_rows(self) -> list[Row]:
        keys = ["", *self._samples, ""]
        return [
            {"token": keys[k], "timestamp": self._names.stamp(t), "scene_token": self._names.scene_token,
             "prev": keys[k - 1], "next": keys[k + 1]}
            for k, t in enumerate(self._times.tolist(), start=1)
        ]  # fmt: skip


def write_data(path: Path, modality: str, data: Any, classes: NDArray[np.uint8]) -> None:
    """The file of what a sensor measured, and what lies beside it. ``classes`` (A + 2,) of :func:`class_ids`."""
    match modality:
        case "camera":
            write_camera(path, data, classes)
        case "lidar":
            write_lidar(path, data)
        case "radar":
            write_radar(path, data)


def class_ids(scene: Scene) -> NDArray[np.uint8]:
    """(A + 2,) the value in a class image of each body index; NOTHING and WORLD, which index from the end, are 0."""
    return np.array([class_id(actor.asset) for actor in scene.actors] + [0, 0], np.uint8)


def class_id(asset: Asset) -> int:
    """1 + the index of the asset's detection class, 0 for what is no object."""
    return 1 + CLASSES.index(CATEGORY_TO_CLASS[asset.category]) if asset.category else 0
