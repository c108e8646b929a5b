"""Triangles and what they are made of: the common currency of assets, scenery and sensors."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

TEXTURES = (
    "plain",
    "asphalt",
    "grass",
    "concrete",
    "brick",
    "facade",
    "foliage",
    "billboard",
    "metal",
    "fabric",
    "wood",
    "slabs",
    "paint",
    "gravel",
    "lacquer",
    "tiles",
)
"""Names of the procedural textures; a surface stores the index. The camera evaluates them at local coordinates."""


@dataclass(frozen=True)
class Surface:
    """Optical properties of F faces. What the camera sees (albedo, texture, specular, emission) is apart from what the
    LiDAR sees (reflectivity), so that a decoy may differ in one alone."""

    albedo: NDArray[np.float32]  # (F, 3) linear RGB in [0, 1]
    texture: NDArray[np.uint8]  # (F,) index into TEXTURES
    specular: NDArray[np.float32]  # (F,) share of mirror reflection, 0 dull .. 1 mirror (glass 0.5, car paint 0.2)
    emission: NDArray[np.float32]  # (F,) luminous exitance relative to white paper in 1,000 lux; lamps only
    reflectivity: NDArray[np.float32]  # (F,) diffuse reflectivity at 905 nm, 0.02 tyre .. 0.9 sign sheeting

    @staticmethod
    def uniform(
        count: int,
        albedo: Sequence[float],
        reflectivity: float,
        *,
        texture: str = "plain",
        specular: float = 0.0,
        emission: float = 0.0,
    ) -> "Surface":
        """The same material on ``count`` faces."""
        return Surface(
            np.tile(np.asarray(albedo, np.float32), (count, 1)),
            np.full(count, TEXTURES.index(texture), np.uint8),
            np.full(count, specular, np.float32),
            np.full(count, emission, np.float32),
            np.full(count, reflectivity, np.float32),
        )

    @staticmethod
    def concatenate(surfaces: Sequence["Surface"]) -> "Surface":
        """All faces of the surfaces, in order."""
        return Surface(*(np.concatenate([getattr(s, f.name) for s in surfaces]) for f in fields(Surface)))


@dataclass(frozen=True)
class Mesh:
    """Triangles in a local frame with one surface entry a face. Normals point out (counter-clockwise winding)."""

    vertices: NDArray[np.float32]  # (V, 3) metres
    faces: NDArray[np.int32]  # (F, 3)
    surface: Surface

    @staticmethod
    def concatenate(meshes: Sequence["Mesh"]) -> "Mesh":
        """One mesh of all the parts."""
        starts = np.cumsum([0, *(len(m.vertices) for m in meshes[:-1])])
        return Mesh(
            np.concatenate([m.vertices for m in meshes]),
            np.concatenate([m.faces + start for m, start in zip(meshes, starts, strict=True)]).astype(np.int32),
            Surface.concatenate([m.surface for m in meshes]),
        )

    def moved(self, a_T_b: NDArray[np.float64]) -> "Mesh":
        """The mesh of frame ``b`` expressed in frame ``a``."""
        vertices = self.vertices @ a_T_b[:3, :3].T + a_T_b[:3, 3]
        return Mesh(vertices.astype(np.float32), self.faces, self.surface)


@dataclass(frozen=True)
class Scatterers:
    """Radar reflection points of a body in its local frame. ``normal`` zero means visible from every side."""

    position: NDArray[np.float32]  # (S, 3)
    normal: NDArray[np.float32]  # (S, 3) unit, or zero
    rcs: NDArray[np.float32]  # (S,) mean radar cross-section in dBsm

    @staticmethod
    def concatenate(parts: Sequence["Scatterers"]) -> "Scatterers":
        """All points of the parts."""
        return Scatterers(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Scatterers)))


@dataclass(frozen=True, eq=False)  # equal and hashed by identity, so that functions of an asset can be cached
class Asset:
    """A body: what it looks like to each sensor and what it is called.

    Local frame: origin on the ground below the box's centre, x forward, y left, z up. ``category`` is a nuScenes
    category, or "" for what is no object (decoys, props). ``size`` is length, width, height of the labelled box.
    ``imitates`` is the category that a decoy is mistaken for. ``gait`` holds the meshes of one cycle of its limbs, which takes
    ``stride`` metres, evenly spaced: face by face those of ``mesh``, within its box; empty for what is rigid.
    """

    name: str
    category: str
    size: tuple[float, float, float]
    mesh: Mesh
    scatterers: Scatterers
    imitates: str = ""
    gait: tuple[Mesh, ...] = ()
    stride: float = 1.0
