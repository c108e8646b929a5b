"""Arrays of somebody else's program, checked before a detector sees them: what it was not trained on gives no error but bad
boxes. Each refusal is a ValueError that says what is wrong, where, and what would be right."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from fusion_net.data.batch import LIDAR_CHANNELS, RADAR_CHANNELS

OLDEST = 10.0
"""Seconds; detectors are shown half a second. A larger age is no age: a time stamp, or nuScenes' ring index."""
TOLERANCE = 1e-3
"""Of rotations, which may be of float32."""


def lidar_table(points: Any) -> NDArray[np.float32]:
    """LiDAR points (P, 5) with LIDAR_CHANNELS."""
    table = _table("points", points, LIDAR_CHANNELS, fewest=3)
    intensity = table[:, LIDAR_CHANNELS.index("intensity")]
    if len(table) and (intensity.min() < 0 or intensity.max() > 1):
        raise ValueError(
            f"detector: points have intensities (column 3) from {intensity.min():g} to {intensity.max():g}, but they must be"
            " in [0, 1]; divide those of nuScenes, 0 to 255, by 255"
        )
    return table


def radar_table(radar: Any) -> NDArray[np.float32]:
    """Radar detections (R, 7) with RADAR_CHANNELS."""
    return _table("radar", radar, RADAR_CHANNELS, fewest=6)


def _table(name: str, value: Any, channels: Sequence[str], *, fewest: int) -> NDArray[np.float32]:
    """Rows with all channels (P, C); those that are left out are 0."""
    if value is None:
        return np.zeros((0, len(channels)), np.float32)
    rows = as_numpy(value)
    if rows.ndim != 2 or not fewest <= rows.shape[1] <= len(channels) or not _is_number(rows):
        raise ValueError(
            f"detector: {name} of shape {list(rows.shape)} and type {rows.dtype}; give rows of {', '.join(channels)}, the first"
            f" {fewest} at least"
        )
    full = np.zeros((len(rows), len(channels)), np.float32)
    full[:, : rows.shape[1]] = rows
    is_finite = np.isfinite(full).all(axis=1)
    if not is_finite.all():
        raise ValueError(
            f"detector: {np.count_nonzero(~is_finite)} of {len(full)} rows of {name} are not finite, the first is row"
            f" {is_finite.argmin()}; leave them out: {name}[np.isfinite({name}).all(axis=1)]"
        )
    age = full[:, -1]
    if len(full) and np.abs(age).max() > OLDEST:
        raise ValueError(
            f"detector: {name} has ages (column {len(channels) - 1}) up to {np.abs(age).max():g} s; give the reference time"
            " minus the measurement's, in seconds, or leave the column out"
        )
    return full


def pictures(images: Any) -> list[NDArray[np.uint8]]:
    """Images (H, W, 3) of one size."""
    given = [as_numpy(each) for each in images] if isinstance(images, list | tuple) else as_numpy(images)
    found = given if isinstance(given, list) else [given] if given.ndim == 3 else list(given)
    shapes, types = (
        list(dict.fromkeys(map(str, each))) for each in ([x.shape for x in found], [x.dtype for x in found])
    )
    if not found:
        raise ValueError("detector: images holds none; leave it out where there is no camera")
    if len(shapes) == 1 and types == ["uint8"] and found[0].ndim == 3 and found[0].shape[2] == 3:
        return [np.ascontiguousarray(each) for each in found]
    what = f"detector: images of shapes {', '.join(shapes)} and types {', '.join(types)}"
    if len(shapes) > 1:
        raise ValueError(f"{what}; all cameras need one size: scale them, and cam_K with them")
    if found[0].ndim == 3 and found[0].shape[0] == 3 != found[0].shape[2]:
        raise ValueError(f"{what} have their channels first; give (N, H, W, 3): np.moveaxis(images, -3, -1)")
    if found[0].ndim == 3 and found[0].shape[2] == 3 and all(_is_number(each) for each in found):
        largest = max(np.nanmax(each, initial=0) for each in found)
        scaled = "np.uint8(255 * images)" if largest <= 1 else "np.uint8(images)"
        raise ValueError(f"{what}, values up to {largest:g}; give uint8 from 0 to 255: {scaled}")
    raise ValueError(f"{what}; give (N, H, W, 3) uint8 RGB")


def intrinsics(cam_K: Any, count: int) -> NDArray[np.float64]:
    """Pinhole matrices (N, 3, 3) of ``count`` cameras."""
    found = _matrices("cam_K", cam_K, 3, count)
    for camera, K in enumerate(found):
        if not (K[0, 0] > 0 and K[1, 1] > 0 and np.allclose([*K[1:, 0], *K[2]], [0, 0, 0, 0, 1])):
            raise ValueError(
                f"detector: cam_K of camera {camera} is no pinhole matrix; give [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels"
                f" with fx and fy above 0, not {K.round(3).tolist()}"
            )
    return found


def poses(ego_T_cam: Any, count: int) -> NDArray[np.float64]:
    """Rigid transforms (N, 4, 4) of ``count`` cameras."""
    found = _matrices("ego_T_cam", ego_T_cam, 4, count)
    for camera, pose in enumerate(found):
        where, rotation = f"detector: ego_T_cam of camera {camera}", pose[:3, :3]
        if not np.allclose(pose[3], [0, 0, 0, 1], atol=TOLERANCE):
            hint = "; it may be transposed" if np.allclose(pose[:, 3], [0, 0, 0, 1], atol=TOLERANCE) else ""
            raise ValueError(f"{where} has the last row {pose[3].round(3).tolist()}, which must be [0, 0, 0, 1]{hint}")
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > TOLERANCE:
            raise ValueError(
                f"{where} has no rotation in its upper left 3 x 3: the rows must have length 1 and be at right angles, and have"
                f" the lengths {np.linalg.norm(rotation, axis=1).round(3).tolist()}"
            )
        if np.linalg.det(rotation) < 0:
            raise ValueError(f"{where} mirrors (determinant -1); both frames are right-handed: turn one axis around")
    return found


def _matrices(name: str, value: Any, size: int, count: int) -> NDArray[np.float64]:
    """One finite matrix for each camera."""
    found = as_numpy(value)
    if not _is_number(found):
        raise ValueError(f"detector: {name} is of type {found.dtype}; give numbers of shape {[count, size, size]}")
    found = found[None] if found.ndim == 2 else found
    if found.shape != (count, size, size):
        raise ValueError(
            f"detector: {name} of shape {list(found.shape)}; give {[count, size, size]}: a matrix for each of {count} images"
        )
    if not np.isfinite(found).all():
        camera = int((~np.isfinite(found)).any(axis=(1, 2)).argmax())
        raise ValueError(f"detector: {name} of camera {camera} is not finite: {found[camera].tolist()}")
    return found.astype(np.float64)


def as_numpy(value: Any) -> NDArray:
    """An array of what may be a tensor on any device."""
    return value.detach().cpu().numpy() if isinstance(value, Tensor) else np.asarray(value)


def _is_number(array: NDArray) -> bool:
    return bool(np.issubdtype(array.dtype, np.number)) and not np.iscomplexobj(array)
