"""The edge of the carriageway as curves to walk along, traced from the ground raster, and the kerb that stands on it."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from data_gen.assets.shapes.mesh import Mesh, Surface
from data_gen.world.ground import GROUND_NAMES, MARKS, GroundMap

Array = NDArray[np.float64]

SPACING = 1.0
"""Metres between the points of a :class:`Verge`."""
KERB_HEIGHT = 0.12
_CARRIAGEWAY = ("asphalt", "shoulder", "patch", *MARKS)


@dataclass(frozen=True)
class Verge:
    """A stretch of the carriageway's edge: points (N, 2) about a metre apart and unit normals (N, 2) away from the road."""

    points: Array
    outward: Array

    @property
    def is_island(self) -> bool:
        """Whether it runs around something, such as the middle of a roundabout."""
        return bool(np.linalg.norm(self.points[0] - self.points[-1]) < 2 * SPACING)

    def places(self, spacing: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """Points (K, 2) and outward normals (K, 2) each ``spacing`` metres, from a random start."""
        step = max(1, round(spacing / SPACING))
        index = np.arange(int(rng.integers(step)), len(self.points), step)
        return self.points[index], self.outward[index]


def carriageway(ground: GroundMap, stride: int = 1) -> NDArray[np.bool_]:
    """Mask of the road surface, shoulders and paint included, pavements not: the middle pixel of each ``stride`` by
    ``stride`` block."""
    table = np.array([name in _CARRIAGEWAY for name in GROUND_NAMES])
    return table[ground.material[stride // 2 :: stride, stride // 2 :: stride]]


def trace_verges(ground: GroundMap, *, stride: int = 3, smooth: int = 5) -> list[Verge]:
    """The edges of the carriageway. Traced on a mask ``stride`` times coarser and smoothed over ``smooth`` points; the
    border of the raster is not an edge."""
    mask = carriageway(ground, stride).view(np.uint8)
    cell = ground.resolution * stride
    contours, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    high = np.array(mask.shape[::-1]) * cell
    found = []
    for contour in contours:
        if len(contour) * cell < 12.0:
            continue
        # A contour runs through the middles of the outermost road cells, the road on one known hand, hole or not.
        loop = (contour[:, 0] + 0.5) * cell
        loop = _every(np.concatenate([loop, loop[:1]]), SPACING)[:-1]
        loop = uniform_filter1d(loop, smooth, axis=0, mode="wrap")
        tangent = np.roll(loop, -1, axis=0) - np.roll(loop, 1, axis=0)
        tangent /= np.maximum(np.hypot(*tangent.T), 1e-9)[:, None]
        outward = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        inner = ((loop > 4.0) & (loop < high - 4.0)).all(axis=1)
        loop = loop + cell / 2 * outward
        found += [Verge(loop[run], outward[run]) for run in _runs(inner) if len(run) > 5]
    return found


def kerb_mesh(verges: list[Verge], *, width: float, height: float = KERB_HEIGHT) -> Mesh:
    """A kerb stone along each verge: front, top and back. Its colour is the ground raster's."""
    parts, faces, start = [], [], 0
    for verge in verges:
        foot, back = verge.points + 0.08 * verge.outward, verge.points + (width - 0.02) * verge.outward
        corners = np.zeros((len(foot), 4, 3), np.float32)
        corners[:, (0, 1), :2], corners[:, (2, 3), :2] = foot[:, None], back[:, None]
        corners[:, 1:3, 2] = height
        base = start + 4 * np.arange(len(foot) - 1)[:, None] + np.arange(3)  # from point k, strip s to point k + 1
        quads = np.stack([base, base + 1, base + 5, base + 4], axis=-1).reshape(-1, 4)
        faces.append(quads[:, [0, 2, 1, 0, 3, 2]].reshape(-1, 3))
        parts.append(corners.reshape(-1, 3))
        start += 4 * len(foot)
    if not parts:
        return Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), Surface.uniform(0, (0.4, 0.4, 0.4), 0.38))
    face = np.concatenate(faces).astype(np.int32)
    return Mesh(np.concatenate(parts), face, Surface.uniform(len(face), (0.42, 0.41, 0.39), 0.38, texture="concrete"))


def _every(line: Array, spacing: float) -> Array:
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.linspace(0.0, arc[-1], max(4, round(arc[-1] / spacing)))
    return np.stack([np.interp(at, arc, line[:, 0]), np.interp(at, arc, line[:, 1])], axis=1)


def _runs(wanted: NDArray[np.bool_]) -> Iterator[NDArray[np.int64]]:
    """Index arrays of the stretches of a closed loop that are wanted."""
    if wanted.all():
        yield np.append(np.arange(len(wanted)), 0)
        return
    first = int(np.argmin(wanted))
    order = np.roll(np.arange(len(wanted)), -first)
    for start, stop in np.flatnonzero(np.diff(np.pad(wanted[order].astype(int), 1))).reshape(-1, 2):
        yield order[start:stop]
