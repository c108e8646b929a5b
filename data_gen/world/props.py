"""Many copies of few assets, turned into one mesh and one set of reflections each, without a loop over copies."""

import numpy as np
from numpy.typing import NDArray

from data_gen.assets.catalogue import build_asset
from data_gen.assets.shapes.mesh import Mesh, Scatterers, Surface

Array = NDArray[np.float64]


class Props:
    """Places of assets, gathered by asset and turned into one mesh each."""

    def __init__(self) -> None:
        self.places: dict[tuple[str, int, int], list[Array]] = {}

    def add(self, kind: str, variant: int, paint: int, at: Array, yaw: Array) -> None:
        """One asset at places (K, 2) with yaw (K,)."""
        self.places.setdefault((kind, variant, paint), []).extend(np.column_stack([at, yaw]))

    def build(self, rng: np.random.Generator) -> tuple[list[Mesh], list[Scatterers]]:
        """Meshes and scatterers in the global frame; each reflection is 2 dB (1 sigma) off its asset's."""
        meshes, echoes = [], []
        for key, places in sorted(self.places.items()):
            if not places:
                continue
            asset = build_asset(*key)
            x, y, yaw = np.array(places).T
            vertices = _placed(asset.mesh.vertices, x, y, yaw)
            count, corners = len(x), len(asset.mesh.vertices)
            faces = asset.mesh.faces[None] + corners * np.arange(count)[:, None, None]
            surface = Surface(*(np.tile(v, (count,) + (1,) * (v.ndim - 1)) for v in vars(asset.mesh.surface).values()))
            meshes.append(Mesh(vertices, faces.reshape(-1, 3).astype(np.int32), surface))
            points = asset.scatterers
            rcs = np.tile(points.rcs, count) + rng.normal(0.0, 2.0, count * len(points.rcs))
            still = np.zeros(count)
            echoes.append(
                Scatterers(
                    _placed(points.position, x, y, yaw),
                    _placed(points.normal, still, still, yaw),
                    rcs.astype(np.float32),
                )
            )
        return meshes, echoes


def _placed(points: NDArray, x: Array, y: Array, yaw: Array) -> NDArray[np.float32]:
    """Local points (V, 3) at each of K places: (K * V, 3)."""
    cos, sin = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    out = np.empty((len(yaw), len(points), 3), np.float32)
    out[..., 0] = cos * points[:, 0] - sin * points[:, 1] + x[:, None]
    out[..., 1] = sin * points[:, 0] + cos * points[:, 1] + y[:, None]
    out[..., 2] = points[:, 2]
    return out.reshape(-1, 3)
