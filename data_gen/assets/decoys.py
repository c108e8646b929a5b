"""Bodies that one sensor mistakes for objects: one thing to LiDAR and radar but another to the camera, or one look at
two sizes."""

from dataclasses import replace
from functools import cache

import numpy as np

from data_gen.assets.shapes.mesh import TEXTURES, Asset, Mesh, Scatterers

LOUD = np.array([(0.85, 0.01, 0.50), (0.32, 0.85, 0.02), (0.01, 0.62, 0.80)], np.float32)
"""Magenta, lime, cyan: no vehicle, person or sign of the palette comes in them."""


@cache
def decoy_of(asset: Asset) -> Asset:
    """A billboard in the shape of ``asset``: vertices, faces, reflectivity and scatterers are its very own; every face,
    glass and tyres included, is painted over in loud blocks, dull and unlit. It is no object: category ""."""
    mesh, count = asset.mesh, len(asset.mesh.faces)
    centre = mesh.vertices[mesh.faces].mean(axis=1) / np.array(asset.size, np.float32) + (0.5, 0.5, 0.0)
    blocks = np.floor(centre * np.array((3, 2, 2)) + 1e-3).astype(np.int64)
    choice = blocks.sum(axis=1) % len(LOUD)
    distance = np.linalg.norm(LOUD[None] - mesh.surface.albedo[:, None], axis=2)
    close = distance[np.arange(count), choice] < 0.45
    choice[close] = distance[close].argmax(axis=1)
    surface = replace(
        mesh.surface,
        albedo=LOUD[choice],
        texture=np.full(count, TEXTURES.index("billboard"), np.uint8),
        specular=np.zeros(count, np.float32),
        emission=np.zeros(count, np.float32),
    )
    return replace(
        asset,
        name=f"decoy {asset.name}",
        category="",
        imitates=asset.category,
        mesh=Mesh(mesh.vertices, mesh.faces, surface),
    )


@cache
def scaled_decoy(asset: Asset, scale: float = 2.0) -> Asset:
    """``asset`` at another scale: ``scale`` times as far away it fills the same pixels. Its radar cross-section grows
    with its area, by 20 log10(scale) dB. It is no object: category ""."""
    if scale <= 0:
        raise ValueError(f"scaled_decoy: scale={scale} of '{asset.name}' is not above 0")
    mesh, points = asset.mesh, asset.scatterers
    length, width, height = asset.size
    return replace(
        asset,
        name=f"scaled {asset.name}",
        category="",
        imitates=asset.category,
        size=(scale * length, scale * width, scale * height),
        gait=(),
        mesh=Mesh(mesh.vertices * np.float32(scale), mesh.faces, mesh.surface),
        scatterers=Scatterers(
            points.position * np.float32(scale), points.normal, points.rcs + np.float32(20 * np.log10(scale))
        ),
    )
