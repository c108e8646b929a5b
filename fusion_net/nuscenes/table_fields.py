"""What a record of each nuScenes table must hold, field by field.

A test takes many values at once: a whole column is tested in little more time than its JSON takes to read.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.nuscenes_format import BEAMS, EXACT_VELOCITY, IMITATED_CATEGORY, MODALITIES, VISIBILITY_LEVELS

Record = dict[str, Any]
Tables = dict[str, dict[str, Record]]
"""Records by table name and token."""

FAR = 1e9
"""No coordinate and no focal length is larger."""
BEYOND = 2**62
"""No count and no time stamp in microseconds is larger."""
VISIBILITY_TOKENS = tuple(str(level) for level, _ in enumerate(VISIBILITY_LEVELS, start=1))
NORM_TOLERANCE = 0.01
"""How far the norm of a quaternion may be from 1."""


@dataclass(frozen=True)
class Field:
    """What the values of a field must be: in words, and as a test of a list of them."""

    must_be: str
    holds: Callable[[list, Tables], bool]


def _are(values: list, *types: type) -> bool:
    return set(map(type, values)) <= set(types)


def _numbers(count: int, must_be: str, is_right: Callable[[NDArray], Any] = lambda rows: True) -> Field:
    """Lists of ``count`` finite numbers; ``is_right`` tests them as rows (N, count)."""

    def holds(values: list, tables: Tables) -> bool:
        if not (_are(values, list) and set(map(len, values)) <= {count}):
            return False
        flat = list(chain.from_iterable(values))
        if not _are(flat, int, float):
            return False
        try:
            rows = np.array(flat, float).reshape(-1, count)
        except OverflowError:
            return False
        return bool((np.abs(rows) < FAR).all() and np.all(is_right(rows)))

    return Field(must_be, holds)


def _whole(low: int) -> Field:
    return Field(
        f"a whole number of {low} or more",
        lambda values, tables: (
            _are(values, int) and low <= min(values, default=low) and max(values, default=low) < BEYOND
        ),
    )


def _one_of(*known: str | None) -> Field:
    types = {type(value) for value in known}
    return Field(
        f"one of {', '.join(map(json.dumps, known))}",
        lambda values, tables: _are(values, *types) and set(values) <= {*known},
    )


def _token(table: str, *, or_none: bool = False) -> Field:
    none = {""} if or_none else set()
    return Field(
        f"the token of a record of {table}.json{', or empty' * or_none}",
        lambda values, tables: _are(values, str) and set(values) <= tables[table].keys() | none,
    )


def _tokens(table: str) -> Field:
    one = _token(table)
    return Field(
        f"a list of tokens of {table}.json",
        lambda values, tables: _are(values, list) and one.holds(list(chain.from_iterable(values)), tables),
    )


def _is_intrinsic(value: Any) -> bool:
    """Whether it is a pinhole matrix, or [] as of a sensor that is no camera."""
    if value == []:
        return True
    if not (_are([value], list) and len(value) == 3 and ROW.holds(value, {})):
        return False
    cam_K = np.array(value, float)
    return bool((np.diag(cam_K) > 0).all() and (cam_K[2] == (0, 0, 1)).all())


def _is_condition(value: Any) -> bool:
    return _are([value], dict) and _are([value.get("name", "")], str) and _are([value.get("severity", 1)], int)


ROW = _numbers(3, "three finite numbers")
PLACE = _numbers(3, "three finite numbers in metres")
ROTATION = _numbers(
    4, "a unit quaternion w, x, y, z", lambda rows: np.abs(np.linalg.norm(rows, axis=1) - 1) < NORM_TOLERANCE
)
SIZE = _numbers(3, "width, length and height in metres, above 0", lambda rows: rows > 0)
NAME = Field(
    "printable text", lambda values, tables: _are(values, str) and all(values) and all(map(str.isprintable, values))
)
TEXT = Field("text", lambda values, tables: _are(values, str))
FLAG = Field("true or false", lambda values, tables: _are(values, bool))
NEIGHBOUR = Field("a token, or empty", TEXT.holds)
"""Of a label. It may lie outside a part of a data set: the track ends there."""
INTRINSIC = Field("a pinhole matrix of three rows, or []", lambda values, tables: all(map(_is_intrinsic, values)))
CONDITION = Field("a name and a severity", lambda values, tables: all(map(_is_condition, values)))

FIELDS: dict[str, dict[str, Field]] = {
    "category": {"name": NAME},
    "attribute": {"name": NAME},
    "sensor": {"channel": NAME, "modality": _one_of(*MODALITIES)},
    "calibrated_sensor": {
        "sensor_token": _token("sensor"), "translation": PLACE, "rotation": ROTATION, "camera_intrinsic": INTRINSIC,
    },
    "ego_pose": {"translation": PLACE, "rotation": ROTATION},
    "scene": {"name": NAME, "first_sample_token": _token("sample")},
    "sample": {"timestamp": _whole(0), "scene_token": _token("scene"), "next": _token("sample", or_none=True)},
    "sample_data": {
        "sample_token": _token("sample"), "ego_pose_token": _token("ego_pose"),
        "calibrated_sensor_token": _token("calibrated_sensor"), "filename": NAME, "timestamp": _whole(0),
        "is_key_frame": FLAG, "prev": _token("sample_data", or_none=True),
    },
    "instance": {"category_token": _token("category")},
    "sample_annotation": {
        "sample_token": _token("sample"), "instance_token": _token("instance"), "attribute_tokens": _tokens("attribute"),
        "visibility_token": _one_of(*VISIBILITY_TOKENS, "", None), "translation": PLACE, "size": SIZE,
        "rotation": ROTATION, "prev": NEIGHBOUR, "next": NEIGHBOUR, "num_lidar_pts": _whole(0),
        "num_radar_pts": _whole(0),
    },
}  # fmt: skip
"""The tables that are read, and the fields that a record of each must have."""

OPTIONAL: dict[str, dict[str, Field]] = {
    "calibrated_sensor": {"height": _whole(1), "width": _whole(1), BEAMS: _whole(1)},
    "scene": {"condition": CONDITION, "layout": TEXT},
    "sample_data": {"height": _whole(0), "width": _whole(0), "next": _token("sample_data", or_none=True)},
    "sample_annotation": {IMITATED_CATEGORY: TEXT, EXACT_VELOCITY: _numbers(2, "two finite numbers in m/s")},
}
"""The fields that are read where a record has them."""
