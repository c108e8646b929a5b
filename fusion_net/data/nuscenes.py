"""The tables of a nuScenes tree, ours or a real one, indexed by token.

The format is that of https://www.nuscenes.org/nuscenes#data-format: a root folder with one version folder ``v1.0-*``
of JSON tables. Poses come out as ``a_T_b`` matrices; no sensor file is opened here.
"""

import json
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusion_net.command_line import command_line
from fusion_net.data.annotations import Annotations, AnnotationTable

FIELDS = {
    "category": {"name"}, "attribute": {"name"}, "instance": {"category_token"}, "sensor": {"channel", "modality"},
    "calibrated_sensor": {"sensor_token", "translation", "rotation", "camera_intrinsic"},
    "ego_pose": {"translation", "rotation"}, "scene": {"name", "first_sample_token"},
    "sample": {"timestamp", "scene_token", "next"},
    "sample_data": {
        "sample_token", "ego_pose_token", "calibrated_sensor_token", "filename", "timestamp", "is_key_frame", "prev",
    },
    "sample_annotation": {
        "sample_token", "instance_token", "visibility_token", "attribute_tokens", "translation", "size", "rotation",
        "prev", "next", "num_lidar_pts", "num_radar_pts",
    },
}  # fmt: skip
"""The tables that are read, and what a record of each must have."""
TABLES = tuple(FIELDS)
REFERENCE = "LIDAR_TOP"
"""The channel whose keyframe gives a sample its reference time and ego pose."""
Record = dict[str, Any]


class NuScenes:
    """A tree. ``tables[name][token]`` is a record, ``keyframes[sample][channel]`` the sample_data record of a
    keyframe."""

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)
        self.folder = _version_folder(self.root)
        self.tables = {name: _load_table(self.folder / f"{name}.json") for name in TABLES}
        self._channel_of = {
            token: self.get("sensor", record["sensor_token"])["channel"]
            for token, record in self.tables["calibrated_sensor"].items()
        }
        self.keyframes: dict[str, dict[str, Record]] = {token: {} for token in self.tables["sample"]}
        for record in self.tables["sample_data"].values():
            if record["is_key_frame"] and record["sample_token"] in self.keyframes:
                self.keyframes[record["sample_token"]][self.channel(record)] = record
        self._poses, self._mounts = _transforms(self.tables["ego_pose"]), _transforms(self.tables["calibrated_sensor"])

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the settings that the tree was generated with; "" for a real one."""
        return _manifest(self.root).get("hash", "")

    def get(self, table: str, token: str) -> Record:
        """One record by token."""
        try:
            return self.tables[table][token]
        except KeyError:
            raise ValueError(f"{self.folder / table}.json has no record with the token {token!r}") from None

    def channel(self, record: Record) -> str:
        """Channel of a sample_data record, such as CAM_FRONT."""
        return self._channel_of[self.get("calibrated_sensor", record["calibrated_sensor_token"])["token"]]

    def channels(self, modality: str) -> list[str]:
        """Channels of a modality, in the order of the sensor table."""
        return [sensor["channel"] for sensor in self.tables["sensor"].values() if sensor["modality"] == modality]

    @cached_property
    def modalities(self) -> dict[str, str]:
        """The modality of every channel."""
        return {sensor["channel"]: sensor["modality"] for sensor in self.tables["sensor"].values()}

    def path(self, record: Record) -> Path:
        """File of a sample_data record."""
        return self.root / record["filename"]

    def firings(self, sample_token: str, channel: str, past: int) -> list[Record]:
        """A channel's keyframe and up to ``past`` firings before it, newest first; [] if the sensor gave no
        keyframe."""
        record = self.keyframes[sample_token].get(channel)
        found: list[Record] = []
        while record is not None and len(found) <= past:
            found.append(record)
            record = self.get("sample_data", record["prev"]) if record["prev"] else None
        return found

    def any_firing(self, channel: str) -> Record:
        """Some record of a channel: its calibration and image size stand in where the sensor is dead."""
        for frames in self.keyframes.values():
            if channel in frames:
                return frames[channel]
        for mount in self.tables["calibrated_sensor"].values():
            is_dead = self._channel_of[mount["token"]] == channel  # in every scene of a generated tree
            if is_dead and "height" in mount:
                return {"calibrated_sensor_token": mount["token"], "height": mount["height"], "width": mount["width"]}
        present = sorted({channel for frames in self.keyframes.values() for channel in frames})
        raise ValueError(f"{self.root} has no keyframe of {channel}; it has {', '.join(present)}")

    def reference(self, sample_token: str) -> Record:
        """The sample_data record that gives a sample its time and its ego frame."""
        frames = self.keyframes.get(sample_token, {})
        if REFERENCE not in frames:
            raise ValueError(f"{self.folder / 'sample_data.json'}: sample {sample_token!r} has no {REFERENCE} keyframe")
        return frames[REFERENCE]

    def global_T_ego(self, record: Record) -> NDArray[np.float64]:
        """Pose (4, 4) of the car when a sample_data record was taken."""
        return self._poses[self.get("ego_pose", record["ego_pose_token"])["token"]]

    def ego_T_sensor(self, record: Record) -> NDArray[np.float64]:
        """Mount (4, 4) of the sensor that took a sample_data record."""
        return self._mounts[self.get("calibrated_sensor", record["calibrated_sensor_token"])["token"]]

    def cam_K(self, record: Record) -> NDArray[np.float64]:
        """Pinhole matrix (3, 3) of the camera that took a sample_data record."""
        mount = self.get("calibrated_sensor", record["calibrated_sensor_token"])
        return np.array(mount["camera_intrinsic"], float).reshape(3, 3)

    @cached_property
    def splits(self) -> dict[str, list[str]]:
        """Scene names by split, from ``splits.json`` where there is one; "all" is every scene."""
        path = self.folder / "splits.json"
        named = _load_json(path) if path.exists() else {}
        return named | {"all": [scene["name"] for scene in self.tables["scene"].values()]}

    def split_name(self, name: str) -> str | None:
        """Full name of a split: itself, or the one that ends with it, as nano_val does with "val"; None if there is
        none."""
        found = [name] if name in self.splits else [full for full in self.splits if full.endswith(f"_{name}")]
        return found[0] if len(found) == 1 else None

    def split(self, name: str) -> list[str]:
        """Sample tokens of a split by scene and time; names as in :meth:`split_name`."""
        full = self.split_name(name)
        if full is None:
            raise ValueError(f"{self.folder / 'splits.json'}: no split {name!r}; there are {', '.join(self.splits)}")
        scenes = {scene["name"]: scene for scene in self.tables["scene"].values()}
        unknown = [scene for scene in self.splits[full] if scene not in scenes]
        if unknown:
            raise ValueError(f"{self.folder / 'scene.json'} lacks {unknown[0]!r}, a scene of the split {full!r}")
        return [token for scene in self.splits[full] for token in self._samples(scenes[scene])]

    def _samples(self, scene: Record) -> list[str]:
        tokens, token = [], scene["first_sample_token"]
        while token:
            tokens.append(token)
            token = self.get("sample", token)["next"]
        return tokens

    @cached_property
    def readings_of(self) -> dict[str, list[Record]]:
        """The sample_data records of each scene."""
        found: dict[str, list[Record]] = {token: [] for token in self.tables["scene"]}
        for record in self.tables["sample_data"].values():
            if sample := self.tables["sample"].get(record["sample_token"]):
                found[sample["scene_token"]].append(record)
        return found

    def scene(self, sample_token: str) -> Record:
        """The scene of a sample."""
        return self.get("scene", self.get("sample", sample_token)["scene_token"])

    def annotations(self, sample_token: str, classes: Sequence[str]) -> Annotations:
        """Labelled boxes of the given classes in the GLOBAL frame; their ``label`` indexes ``classes``."""
        return self._annotation_table.of(sample_token, classes)

    @cached_property
    def _annotation_table(self) -> AnnotationTable:
        return AnnotationTable(self)


def _version_folder(root: Path) -> Path:
    """The one folder ``v1.0-*`` of a tree that is whole."""
    if not root.is_dir() or not any(root.iterdir()):
        make = command_line("-m data_gen", data="nano", data__root=root)
        raise ValueError(f"no data in {root}; make some: {make}")
    manifest = _manifest(root)
    if not manifest.get("complete", True):
        command = manifest.get("command") or "give the command that made it again"
        raise ValueError(f"{root} is half generated; this goes on where it stopped: {command}")
    found = sorted(path for path in root.glob("v1.0-*") if path.is_dir())
    if len(found) != 1:
        names = ", ".join(path.name for path in found) or "none"
        raise ValueError(f"{root} needs one folder v1.0-* of tables and has {names}; is it a nuScenes root?")
    missing = [name for name in TABLES if not (found[0] / f"{name}.json").exists()]
    if missing:
        raise ValueError(f"{found[0]} lacks {', '.join(f'{name}.json' for name in missing)}: generate it again")
    return found[0]


def _manifest(root: Path) -> dict[str, Any]:
    """What a generated tree says of itself; {} for a real one."""
    path = root / "manifest.json"
    manifest = _load_json(path) if path.exists() else {}
    if not isinstance(manifest, dict):
        raise ValueError(f"{path} is no manifest of generated data; generate it again")
    return manifest


def _transforms(table: dict[str, Record]) -> dict[str, NDArray[np.float64]]:
    """``a_T_b`` (4, 4) by token, from the records' rotation and translation; converted at once, which is 50 times
    faster."""
    if not table:
        return {}
    a_T_b = np.tile(np.eye(4), (len(table), 1, 1))
    rotation = np.array([record["rotation"] for record in table.values()], float)
    a_T_b[:, :3, :3] = Rotation.from_quat(rotation, scalar_first=True).as_matrix()
    a_T_b[:, :3, 3] = [record["translation"] for record in table.values()]
    return dict(zip(table, a_T_b, strict=True))


def _load_table(path: Path) -> dict[str, Record]:
    try:
        table = {record["token"]: record for record in _load_json(path)}
    except (TypeError, KeyError):
        raise ValueError(f"{path} is not a nuScenes table: a list of records with a token each") from None
    fields = FIELDS[path.stem]
    for token, record in table.items():
        if not fields <= record.keys():
            raise ValueError(f"{path}: the record {token!r} has no {', '.join(sorted(fields - record.keys()))}")
    return table


def _load_json(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is damaged or cut short ({error}); generate it again") from None
