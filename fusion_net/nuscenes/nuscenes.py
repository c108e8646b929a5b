"""The tables of a nuScenes data set, ours or a real one, indexed by token.

The format is that of https://www.nuscenes.org/nuscenes#data-format: a root folder with a version folder ``v1.0-*``
of JSON tables. Poses come out as ``a_T_b`` matrices; no sensor file is opened here.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.nuscenes_format import BEAMS, REFERENCE
from fusion_net.nuscenes.absent import refuse_no_data
from fusion_net.nuscenes.annotations import Annotations, AnnotationTable, BicycleRacks
from fusion_net.nuscenes.mapped_tables import View, listed, map_tables
from fusion_net.nuscenes.splits import read_splits
from fusion_net.nuscenes.table_fields import Record, Tables
from fusion_net.nuscenes.tables import load_tables, manifest, repair_advice, version_folder
from fusion_net.nuscenes.transforms import transform_of, transforms_of


class NuScenes:
    """A data set. ``tables[name][token]`` is a record, ``keyframes[sample][channel]`` the sample_data record of a
    keyframe. ``version``: name of the folder of tables; None for the only one. ``mapped``: the large tables are mapped from a
    file below ``root``, where it can be written (:mod:`fusion_net.nuscenes.mapped_tables`)."""

    def __init__(self, root: str | Path, version: str | None = None, *, mapped: bool = False) -> None:
        self.root = Path(root)
        refuse_no_data(self.root)
        self.folder = version_folder(self.root, version)
        try:
            self.mapped = map_tables(self.root, self.folder) if mapped else None
            self.tables: Tables = self.mapped.tables if self.mapped else load_tables(self.folder)
        except ValueError as error:
            raise ValueError(f"{error}; {repair_advice(self.root)}") from None
        self._channel_of = {
            token: self.get("sensor", record["sensor_token"])["channel"]
            for token, record in self.tables["calibrated_sensor"].items()
        }
        self._annotation_tables: dict[str, AnnotationTable] = {}
        self._mounts = transforms_of(self.tables["calibrated_sensor"])
        self.keyframes: Mapping[str, dict[str, Record]] = (
            View(self.mapped.keyframes, self._keyframes_of) if self.mapped else self._all_keyframes()
        )

    def _all_keyframes(self) -> dict[str, dict[str, Record]]:
        keyframes: dict[str, dict[str, Record]] = {token: {} for token in self.tables["sample"]}
        for record in self.tables["sample_data"].values():
            if record["is_key_frame"]:
                keyframes[record["sample_token"]][self.channel(record)] = record
        return keyframes

    def _keyframes_of(self, tokens: list[str]) -> dict[str, Record]:
        records = [self.tables["sample_data"][token] for token in tokens]
        return {self.channel(record): record for record in records}

    def _sample_data_of(self, tokens: dict[str, list[str]]) -> list[Record]:
        return [self.tables["sample_data"][token] for token in tokens["sample_data"]]

    @cached_property
    def _poses(self) -> Mapping[str, NDArray[np.float64]]:
        poses = self.tables["ego_pose"]
        return View(poses, transform_of) if self.mapped else transforms_of(poses)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the settings that the data set was generated with; "" for a real one."""
        return str(manifest(self.root).get("hash", ""))

    @cached_property
    def files_hash(self) -> str:
        """Hash of the manifest, and of name, size and time of the tables and of every file in the folders of its channels."""
        digest = hashlib.sha256(self.fingerprint.encode())
        sensors = (self.root / kind / channel for kind in ("samples", "sweeps") for channel in self.modalities)
        for folder in (self.folder, *sensors):
            digest.update("\n".join((folder.name, *listed(folder))).encode("utf-8", "surrogateescape"))
        return digest.hexdigest()[:16]

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

    @contextmanager
    def file_of(self, record: Record) -> Iterator[Path]:
        """The file of a sample_data record to be read; a ValueError in reading it also names the record. ValueError when it
        is not there."""
        path, name = self.path(record), self.name_of("sample_data", record)
        if not path.is_file():
            raise ValueError(f"{path} is not there; {name} has filename={record['filename']!r}")
        try:
            yield path
        except ValueError as error:
            raise ValueError(f"{error}; {name} names this file; {repair_advice(self.root)}") from None

    def name_of(self, table: str, record: Record) -> str:
        """A record as messages name it."""
        return f"{self.folder / table}.json: the record {record['token']!r}"

    def image_size(self, record: Record) -> tuple[int, int]:
        """Height and width of the image of a camera's record."""
        height, width = (record.get(name, 0) for name in ("height", "width"))
        if not (height and width):
            raise ValueError(f"{self.name_of('sample_data', record)} of a camera has height={height}, width={width}")
        return height, width

    def keyframe_and_sweeps(self, sample_token: str, channel: str, past: int) -> list[Record]:
        """A channel's keyframe and up to ``past`` sweeps before it, newest first; [] if the sensor gave no
        keyframe."""
        record = self.keyframes[sample_token].get(channel)
        found: list[Record] = []
        while record is not None and len(found) <= past:
            found.append(record)
            record = self.get("sample_data", record["prev"]) if record["prev"] else None
        return found

    def calibration_record(self, channel: str) -> Record:
        """Some record of a channel: its calibration and image size stand in where the sensor is dead."""
        for frames in self.keyframes.values():
            if channel in frames:
                return frames[channel]
        for mount in self.tables["calibrated_sensor"].values():
            is_dead = self._channel_of[mount["token"]] == channel  # in every scene of a generated data set
            if is_dead and {"height", "width"} <= mount.keys():
                return {"calibrated_sensor_token": mount["token"], "height": mount["height"], "width": mount["width"]}
        present = sorted({channel for frames in self.keyframes.values() for channel in frames})
        raise ValueError(f"{self.root} has no keyframe of {channel}; it has {', '.join(present)}")

    def reference(self, sample_token: str) -> Record:
        """The sample_data record that gives a sample its time and its ego frame."""
        frames = self.keyframes.get(sample_token, {})
        if REFERENCE not in frames:
            raise ValueError(
                f"{self.folder / 'sample_data.json'}: sample {sample_token!r} has no {REFERENCE} keyframe"
                f" but {', '.join(frames) or 'none at all'}"
            )
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
        if not mount["camera_intrinsic"]:
            raise ValueError(f"{self.name_of('calibrated_sensor', mount)} of a camera has camera_intrinsic=[]")
        return np.array(mount["camera_intrinsic"], float)

    @cached_property
    def beams(self) -> dict[str, int]:
        """How many beams each LiDAR has, by channel: 32 where the data set does not say, as in nuScenes."""
        mounts = {self._channel_of[token]: mount for token, mount in self.tables["calibrated_sensor"].items()}
        return {channel: mounts[channel].get(BEAMS, 32) for channel in self.channels("lidar") if channel in mounts}

    @cached_property
    def splits(self) -> dict[str, list[str]]:
        """Scene names by split; "all" is every scene."""
        return read_splits(self.folder, [scene["name"] for scene in self.tables["scene"].values()])

    def split_name(self, name: str) -> str | None:
        """Full name of a split: itself, or the one that ends with it, as nano_val does with "val"; None if there is
        none."""
        found = [name] if name in self.splits else [full for full in self.splits if full.endswith(f"_{name}")]
        return found[0] if len(found) == 1 else None

    def split(self, name: str) -> list[str]:
        """Sample tokens of a split by scene and time; names as in :meth:`split_name`."""
        full = self.split_name(name)
        if full is None:
            raise ValueError(f"{self.folder} has no split {name!r}; there are {', '.join(self.splits)}")
        scenes = {scene["name"]: scene for scene in self.tables["scene"].values()}
        unknown = [scene for scene in self.splits[full] if scene not in scenes]
        if unknown:
            raise ValueError(f"{self.folder / 'scene.json'} lacks {unknown[0]!r}, a scene of the split {full!r}")
        return [token for scene in self.splits[full] for token in self._samples(scenes[scene])]

    def _samples(self, scene: Record) -> list[str]:
        tokens: dict[str, None] = {}
        token = scene["first_sample_token"]
        while token:
            if token in tokens:
                raise ValueError(f"{self.folder / 'sample.json'}: the 'next' of the record {token!r} leads back to it")
            tokens[token] = None
            token = self.tables["sample"][token]["next"]
        return [*tokens]

    @cached_property
    def sample_data_of(self) -> Mapping[str, list[Record]]:
        """The sample_data records of each scene."""
        if self.mapped:
            return View(self.mapped.scenes, self._sample_data_of)
        found: dict[str, list[Record]] = {token: [] for token in self.tables["scene"]}
        for record in self.tables["sample_data"].values():
            found[self.tables["sample"][record["sample_token"]]["scene_token"]].append(record)
        return found

    def scene(self, sample_token: str) -> Record:
        """The scene of a sample."""
        return self.get("scene", self.get("sample", sample_token)["scene_token"])

    def annotations(self, sample_token: str, classes: Sequence[str]) -> Annotations:
        """Labelled boxes of the given classes in the GLOBAL frame; their ``label`` indexes ``classes``."""
        return self._annotation_table(sample_token).of(sample_token, classes)

    def racks(self, sample_token: str) -> BicycleRacks:
        """Bicycle racks in the GLOBAL frame: nuScenes evaluates no bicycle or motorcycle inside one."""
        return self._annotation_table(sample_token).racks(sample_token)

    def _annotation_table(self, sample_token: str) -> AnnotationTable:
        """The table that has a sample's annotations: of its scene, or of everything where all is in memory anyway."""
        part = self.scene(sample_token)["token"] if self.mapped else ""
        if part not in self._annotation_tables:
            records = self.tables["sample_annotation"]
            own = (
                [records[token] for token in self.mapped.scenes[part]["sample_annotation"]]
                if self.mapped
                else [*records.values()]
            )
            self._annotation_tables[part] = AnnotationTable(self.tables, own)
        return self._annotation_tables[part]
