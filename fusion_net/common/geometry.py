"""Rigid transforms and the pinhole camera.

Convention: ``a_T_b`` (4, 4) takes points from frame ``b`` to frame ``a``, so ``a_T_c = a_T_b @ b_T_c``. Frames are
right-handed; ego and global are x forward, y left, z up; camera is x right, y down, z forward. Metres, radians.
Quaternions are (w, x, y, z), as nuScenes writes them.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def rigid(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """``a_T_b`` (4, 4) from a rotation matrix (3, 3) and the origin of ``b`` in ``a`` (3,)."""
    a_T_b = np.eye(4)
    a_T_b[:3, :3] = rotation
    a_T_b[:3, 3] = translation
    return a_T_b


def from_quaternion(quaternion: ArrayLike, translation: ArrayLike) -> Array:
    """``a_T_b`` (4, 4) from a (w, x, y, z) quaternion and a translation, the two fields of a nuScenes pose record."""
    return rigid(Rotation.from_quat(np.asarray(quaternion, float), scalar_first=True).as_matrix(), translation)


def to_quaternion(a_T_b: ArrayLike) -> Array:
    """The (w, x, y, z) quaternion of a transform (4, 4) or rotation (3, 3), with w >= 0."""
    rotation = np.asarray(a_T_b)[:3, :3]
    return Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True)


def from_yaw(yaw: float, translation: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """``a_T_b`` (4, 4) of a body at ``translation`` in ``a``, turned by ``yaw`` counter-clockwise about z."""
    c, s = np.cos(yaw), np.sin(yaw)
    return rigid([[c, -s, 0], [s, c, 0], [0, 0, 1]], translation)


def from_rpy(roll: float, pitch: float, yaw: float, translation: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """``a_T_b`` (4, 4) from roll about x, pitch about y (positive: nose down), yaw about z, applied in that order."""
    return rigid(Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix(), translation)


def invert(a_T_b: Array) -> Array:
    """``b_T_a`` for rigid ``a_T_b`` (..., 4, 4), without a general matrix inverse."""
    b_T_a = np.zeros_like(a_T_b)
    rotation_t = np.swapaxes(a_T_b[..., :3, :3], -1, -2)
    b_T_a[..., :3, :3] = rotation_t
    b_T_a[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation_t, a_T_b[..., :3, 3])
    b_T_a[..., 3, 3] = 1.0
    return b_T_a


def transform(a_T_b: Array, points: ArrayLike) -> Array:
    """Points (N, 3) of frame ``b`` in frame ``a``."""
    return np.asarray(points) @ a_T_b[:3, :3].T + a_T_b[:3, 3]


def rotate_yaw(vectors: ArrayLike, yaw: ArrayLike) -> Array:
    """Vectors (N, 3) turned about z by ``yaw`` radians, (N,) or a scalar: ego axes to global axes at those headings."""
    v, cos, sin = np.asarray(vectors), np.cos(yaw), np.sin(yaw)
    return np.stack([cos * v[:, 0] - sin * v[:, 1], sin * v[:, 0] + cos * v[:, 1], v[:, 2]], axis=1)


def yaw_of(a_T_b: ArrayLike) -> float:
    """Heading in frame ``a`` of the x axis of ``b``, counter-clockwise from x, in (-pi, pi]."""
    rotation = np.asarray(a_T_b)
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))


def wrap_angle(angle: ArrayLike, period: ArrayLike = 2 * np.pi) -> Array:
    """Angle folded into [-period / 2, period / 2)."""
    period = np.asarray(period)
    return (np.asarray(angle) + period / 2) % period - period / 2


def project(cam_K: Array, points: ArrayLike) -> tuple[Array, Array]:
    """Pinhole projection of camera-frame points (N, 3).

    Returns pixels (N, 2) as (u, v) and depths z (N,). Pixel (i, j) of the image covers u in [j, j + 1), so its centre
    is at +0.5. Points with z <= 0 get NaN pixels: they are behind the camera and project nowhere.
    """
    points = np.asarray(points, float)
    depth = points[:, 2]
    safe = np.where(depth > 0, depth, np.nan)
    return (points @ cam_K.T)[:, :2] / safe[:, None], depth


def unproject(cam_K: Array, pixels: ArrayLike, depth: ArrayLike) -> Array:
    """Camera-frame points (N, 3) of pixels (N, 2) at depth z (N,): the inverse of :func:`project`."""
    pixels = np.asarray(pixels, float)
    homogeneous = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1)
    return homogeneous @ np.linalg.inv(cam_K).T * np.asarray(depth)[:, None]
