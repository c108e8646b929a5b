"""Sources of light that stand in the meshes: faces with an emission, gathered into lamps."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data_gen.assets.shapes.mesh import Mesh

Array = NDArray[np.float64]


class Luminaires(NamedTuple):
    """Sources of light. Towards the unit direction u goes flux ((1 - |axis|) / 4 + max(u . axis, 0)) / pi candela: a flat lamp
    has a unit axis (Lambert), one that shines all around a zero axis."""

    position: Array  # (L, 3) metres
    axis: Array  # (L, 3)
    flux: Array  # (L, 3) lumen


def luminaires(mesh: Mesh) -> Luminaires:
    """The lamps of a mesh: its faces with an emission gathered over half a metre."""
    shining = np.flatnonzero(mesh.surface.emission > 0)
    corners = mesh.vertices[mesh.faces[shining]].astype(float)  # (F, 3, 3)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    area, center = np.linalg.norm(normal, axis=1), corners.mean(axis=1)
    _, cell = np.unique(np.floor(center / 0.5).astype(int), axis=0, return_inverse=True)
    surface = mesh.surface
    flux = 1000.0 * (area * surface.emission[shining])[:, None] * surface.albedo[shining]
    total = np.zeros((cell.max(initial=-1) + 1, 10))
    np.add.at(total, cell.ravel(), np.hstack([area[:, None], area[:, None] * center, normal, flux]))
    size = np.maximum(total[:, :1], 1e-9)
    return Luminaires(total[:, 1:4] / size, total[:, 4:7] / size, total[:, 7:])
