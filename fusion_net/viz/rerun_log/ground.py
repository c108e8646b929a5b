"""The map of a scene as a picture that lies on the road.

nuScenes' map masks have 0.1 m a pixel, their lower left corner is the origin of the global frame.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion_net.nuscenes.tables import read_json
from fusion_net.viz.rerun_log.readings import Scene

PIXEL = 0.1
"""Metres of a pixel of the mask."""
MARGIN = 80.0
"""Metres around the car's path that are shown."""
COARSER = 4
"""Pixels of the mask, in each direction, that are one of the picture."""
BELOW = 0.05
"""Metres below the road, so that points and boxes on it are seen."""
ROAD, ELSE = (78, 80, 88), (36, 40, 38)


@dataclass(frozen=True)
class Ground:
    """A picture (H, W, 3) and where its corners (4, 3) are in the global frame: lower left, lower right, upper right, upper
    left."""

    image: NDArray[np.uint8]
    corners: NDArray[np.float64]


def ground(scene: Scene) -> Ground | None:
    """The map around the path of a scene's car; None where the data set has none."""
    path = _mask_file(scene)
    mask = None if path is None else cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if mask is None:
        return None
    _, poses = scene.path
    places = poses[:, :3, 3]
    low, high = places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN
    left, right = np.clip([low[0], high[0]], 0, mask.shape[1] * PIXEL)
    bottom, top = np.clip([low[1], high[1]], 0, mask.shape[0] * PIXEL)
    left, right, bottom, top = (round(edge / PIXEL) for edge in (left, right, bottom, top))
    part = mask[len(mask) - top : len(mask) - bottom, left:right]
    if not part.size:
        return None
    small = cv2.resize(part, None, fx=1 / COARSER, fy=1 / COARSER, interpolation=cv2.INTER_AREA)
    share = small[..., None] / 255
    z = float(np.median(places[:, 2])) - BELOW
    corners = np.array([(left, bottom), (right, bottom), (right, top), (left, top)]) * PIXEL
    return Ground((share * ROAD + (1 - share) * ELSE).astype(np.uint8), np.column_stack([corners, np.full(4, z)]))


def _mask_file(scene: Scene):
    """The file of the scene's map, if ``map.json`` names one that is there."""
    table = scene.nusc.folder / "map.json"
    log = scene.record.get("log_token")
    for record in read_json(table) if log and table.exists() else []:
        path = scene.nusc.root / record.get("filename", "")
        if log in record.get("log_tokens", ()) and path.is_file():
            return path
    return None
