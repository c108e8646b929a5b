"""Three sensors fill one grid: how strong each sensor's feature map is in each cell, camera red, LiDAR green, radar blue."""

import numpy as np
from numpy.typing import NDArray

from fusion_lab.engine.answers import Answer
from fusion_lab.views.content import Content, table
from fusion_lab.views.pictures import panel_of
from fusion_net.common.nuscenes_format import MODALITIES

COLORS = {"camera": (255, 70, 60), "lidar": (70, 235, 90), "radar": (80, 130, 255)}


def content(answer: Answer) -> Content:
    """The maps from above in one picture, and what each of them holds."""
    maps, chosen = answer.seen.maps, answer.state.layer
    shown = [name for name in MODALITIES if name in maps and chosen in ("all", name)]
    strength = {name: _strength(maps[name].numpy()) for name in maps}
    picture = np.zeros((*answer.grid.shape, 3), np.float32)
    for name in shown:
        picture += strength[name][..., None] * np.array(COLORS[name], np.float32)
    large = panel_of(answer.grid).of_map(np.clip(picture, 0, 255).astype(np.uint8))
    rows = [(name, *_said(answer, name, strength)) for name in MODALITIES]
    filled = [strength[name] > 0.25 for name in maps]
    together = np.sum([np.zeros(answer.grid.shape, int), *filled], axis=0)
    sides = " to ".join(dict.fromkeys(f"{side:.2g}" for side in answer.grid.sides()))
    two, three = (int((together >= count).sum()) for count in (2, 3))
    said = (
        f"<p>Each sensor has put what it measured into the same {answer.grid.shape[1]} x {answer.grid.shape[0]} cells of"
        f" {sides} m. {two} cells are strong in two sensors or more, {three} in all three: there the colours add"
        " up to yellow, cyan or white, and fusing is work on the numbers of one cell.</p>"
    )
    return Content(
        said + table(rows, ("sensor", "colour", "strong cells", "map")), large, "",
        f"Feature maps from above of {', '.join(shown) or 'no sensor'}",
    )  # fmt: skip


def _said(answer: Answer, name: str, strength: dict[str, NDArray]) -> tuple[str, str, str]:
    color = {"camera": "red", "lidar": "green", "radar": "blue"}[name]
    if name not in strength:
        return color, "none", "no map: the sensor is dead, or this detector makes none of it"
    channels = answer.seen.maps[name].shape[0]
    return color, str(int((strength[name] > 0.25).sum())), f"{channels} x {' x '.join(map(str, strength[name].shape))}"


def _strength(bev: NDArray) -> NDArray[np.float32]:
    """(Y, X) in [0, 1]: the mean size of a cell's features beyond what an empty cell has, by the map's 99.5 % quantile."""
    size = np.abs(bev).mean(axis=0)
    size = np.clip(size - np.median(size), 0, None)
    top = float(np.quantile(size, 0.995))
    return (np.clip(size / top, 0, 1) if top > 0 else size).astype(np.float32)
