"""``python -m data_gen.pictures.asset_sheet``: every variant of every asset from front left and from rear right."""

import cv2
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from omegaconf import DictConfig

from data_gen.assets.catalogue import PAINTS, VARIANTS, build_asset, decoy_of
from data_gen.assets.shapes.mesh import Asset
from fusion_net.common.cli.command import command
from fusion_net.common.drawing import picture_file

SKY, SUN = np.array([0.55, 0.68, 0.85]), np.array([0.35, 0.5, 0.79])


def portrait(asset: Asset, azimuth: float, *, pixels: int = 200) -> NDArray[np.uint8]:
    """A BGR picture (pixels, pixels, 3) of the asset by Lambert's law, from ``azimuth`` radians (0: from the front)."""
    low, high = asset.mesh.vertices.min(axis=0), asset.mesh.vertices.max(axis=0)
    radius = float(np.linalg.norm(high - low)) / 2
    elevation = 0.25
    away = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.cross(away, right)
    span = (np.arange(2 * pixels) + 0.5) / pixels - 1
    plane = radius * (span[None, :, None] * right - span[:, None, None] * up)
    origins = ((low + high) / 2 + 3 * radius * away + plane).reshape(-1, 3).astype(np.float32)
    scene = EmbreeScene()
    TriangleMesh(scene, asset.mesh.vertices, asset.mesh.faces)
    hit = scene.run(origins, np.tile(-away, (len(origins), 1)).astype(np.float32), query="INTERSECT", output=True)
    normal = hit["Ng"] / np.maximum(np.linalg.norm(hit["Ng"], axis=1, keepdims=True), 1e-9)
    surface, face = asset.mesh.surface, hit["primID"]
    light = 0.35 + 0.15 * normal[:, 2] + 0.7 * np.maximum(normal @ SUN, 0)
    colour = surface.albedo[face] * np.where(surface.emission[face] > 0, 1.2, light)[:, None]
    colour += 0.25 * surface.specular[face, None] * SKY
    colour = np.where((face >= 0)[:, None], colour, SKY).reshape(pixels, 2, pixels, 2, 3).mean(axis=(1, 3))
    return (255 * np.clip(colour[..., ::-1], 0, 1) ** (1 / 2.2)).astype(np.uint8)


@command(config_name="asset_sheet")
def main(cfg: DictConfig) -> None:
    """Draws the kinds of ``cfg.kinds``, or all, into ``cfg.out``."""
    kinds = list(cfg.kinds) or list(VARIANTS)
    if unknown := [kind for kind in kinds if kind not in VARIANTS]:
        raise ValueError(f"kinds: there is no {unknown[0]!r}; there are {', '.join(VARIANTS)}")
    out = picture_file(cfg.out, formats=(".png", ".jpg"))
    out.write_bytes(cv2.imencode(out.suffix, draw_assets(kinds))[1].tobytes())  # unlike imwrite, says why it cannot
    print(f"wrote {out}")


def draw_assets(kinds: list[str]) -> NDArray[np.uint8]:
    """A BGR picture with a row per kind: every variant from front left and rear right, its paints in turn; last a decoy."""
    rows = []
    for kind in kinds:
        assets = [build_asset(kind, variant, variant % PAINTS[kind]) for variant in range(VARIANTS[kind])]
        assets.append(decoy_of(assets[0]))
        rows.append(np.hstack([np.vstack([portrait(asset, view) for view in (0.7, 0.7 + np.pi)]) for asset in assets]))
    width = max(row.shape[1] for row in rows)
    return np.vstack([np.pad(row, ((0, 4), (0, width - row.shape[1]), (0, 0))) for row in rows])


if __name__ == "__main__":
    main()
