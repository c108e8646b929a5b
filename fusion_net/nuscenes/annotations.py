"""The labelled boxes of a nuScenes data set as arrays: one row per annotation, all samples in one table."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import BICYCLE_RACK, CATEGORY_TO_CLASS, CLASSES
from fusion_net.nuscenes.table_fields import Record, Tables

MAX_TIME_DIFF = 1.5
"""Seconds between an instance's annotations beyond which nuScenes knows no velocity; twice that where it is
centred."""
_CLASS_INDEX = {name: index for index, name in enumerate(CLASSES)}


@dataclass(frozen=True)
class Annotations:
    """N labelled boxes in the GLOBAL frame and what else the tables say of them."""

    boxes: Boxes
    num_lidar_pts: NDArray[np.int64]  # (N,)
    num_radar_pts: NDArray[np.int64]  # (N,)
    visibility: NDArray[np.int64]  # (N,) 1 (0-40 % visible) to 4 (80-100 %), 0 unknown
    attribute: NDArray[np.str_]  # (N,) name or ""
    instance: NDArray[np.str_]  # (N,) token of the tracked object

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index) -> "Annotations":
        """The annotations at an index array, mask or slice."""
        return Annotations(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    @property
    def num_pts(self) -> NDArray[np.int64]:
        """(N,) LiDAR and radar points together; nuScenes evaluates the boxes that have any."""
        return self.num_lidar_pts + self.num_radar_pts


@dataclass(frozen=True)
class BicycleRacks:
    """M bicycle racks: oriented boxes in the GLOBAL frame that may lean, as their records say."""

    center: NDArray[np.float64]  # (M, 3)
    wlh: NDArray[np.float64]  # (M, 3)
    rotation: NDArray[np.float64]  # (M, 4) quaternion (w, x, y, z)

    def __len__(self) -> int:
        return len(self.center)

    def contain(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) whether each point (N, 3) of the GLOBAL frame is in a rack, its surface included."""
        rack_R_global = Rotation.from_quat(self.rotation, scalar_first=True).as_matrix().swapaxes(1, 2)
        offset = np.einsum("mij,nmj->nmi", rack_R_global, points[:, None] - self.center)
        return (np.abs(offset) <= self.wlh[:, [1, 0, 2]] / 2).all(axis=2).any(axis=1)


class AnnotationTable:
    """The annotations of ``records`` (whole tracks), and which rows a sample has. ``label`` of ``everything`` indexes CLASSES,
    -1 for none."""

    def __init__(self, tables: Tables, records: list[Record]) -> None:
        self._rows_of: dict[str, list[int]] = defaultdict(list)
        for row, record in enumerate(records):
            self._rows_of[record["sample_token"]].append(row)
        categories = [_category(tables, record) for record in records]
        center = _column(records, "translation", (-1, 3))
        boxes = Boxes.labels(
            center,
            _column(records, "size", (-1, 3)),
            _yaw(_column(records, "rotation", (-1, 4))),
            _velocity(tables, records, center),
            np.array([_CLASS_INDEX.get(CATEGORY_TO_CLASS.get(name, ""), -1) for name in categories], np.int64),
        )
        self._everything = Annotations(
            boxes,
            _column(records, "num_lidar_pts", -1).astype(np.int64),
            _column(records, "num_radar_pts", -1).astype(np.int64),
            np.array([int(record["visibility_token"] or 0) for record in records], np.int64),
            np.array([_attribute(tables, record) for record in records], dtype=np.str_),
            np.array([record["instance_token"] for record in records], dtype=np.str_),
        )
        self._racks_of: dict[str, list[dict]] = defaultdict(list)
        for record, name in zip(records, categories, strict=True):
            if name == BICYCLE_RACK:
                self._racks_of[record["sample_token"]].append(record)

    def of(self, sample_token: str, classes: Sequence[str]) -> Annotations:
        """The annotations of a sample whose class is one of ``classes``; their ``label`` indexes ``classes``."""
        rows = np.array(self._rows_of.get(sample_token, ()), np.int64)
        label_of = np.array([classes.index(name) if name in classes else -1 for name in CLASSES] + [-1])
        label = label_of[self._everything.boxes.label[rows]]
        found = self._everything[rows[label >= 0]]
        return replace(found, boxes=replace(found.boxes, label=label[label >= 0]))

    def racks(self, sample_token: str) -> BicycleRacks:
        """The bicycle racks of a sample."""
        records = self._racks_of.get(sample_token, [])
        return BicycleRacks(
            _column(records, "translation", (-1, 3)),
            _column(records, "size", (-1, 3)),
            _column(records, "rotation", (-1, 4)),
        )


def _column(records: list[dict], field: str, shape) -> NDArray[np.float64]:
    return np.array([record[field] for record in records], float).reshape(shape)


def _category(tables: Tables, record: dict) -> str:
    instance = tables["instance"][record["instance_token"]]
    return tables["category"][instance["category_token"]]["name"]


def _attribute(tables: Tables, record: dict) -> str:
    tokens = record["attribute_tokens"]
    return tables["attribute"][tokens[0]]["name"] if tokens else ""


def _yaw(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heading of the x axis of (w, x, y, z) quaternions (N, 4)."""
    w, x, y, z = quaternion.T
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _velocity(tables: Tables, records: list[dict], center: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 2) m/s by differences between the neighbours in time, as the devkit's ``box_velocity``: one-sided at a
    track's ends, NaN for a lone annotation or too long a gap. A track ends where its next label is not in the table."""
    row_of = {record["token"]: row for row, record in enumerate(records)}
    own = np.arange(len(records))
    before = np.array([row_of.get(r["prev"], row) for row, r in enumerate(records)], np.int64)
    after = np.array([row_of.get(r["next"], row) for row, r in enumerate(records)], np.int64)
    time = np.array([tables["sample"][record["sample_token"]]["timestamp"] for record in records], np.int64) * 1e-6
    gap = time[after] - time[before]
    limit = MAX_TIME_DIFF * np.where((before != own) & (after != own), 2, 1)
    known = (gap > 0) & (gap <= limit)
    difference = center[after, :2] - center[before, :2]
    return np.where(known[:, None], difference / np.where(known, gap, 1.0)[:, None], np.nan)
