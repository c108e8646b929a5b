"""What every contact sheet needs: short scenes in one condition each, and tiles written as a grid with their names."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from data_gen.episode import Scenario, build_episode
from data_gen.rig.coverage import sector_covered
from data_gen.rig.mounts import Mount
from data_gen.rig.rig import Rig
from data_gen.scene.conditions import ConditionMix
from data_gen.scene.scene import Scene
from data_gen.sensors.common.event import CaptureEvent

Image = NDArray[np.uint8]

GAP, HEAD, SIDE = 4, 30, 112
"""Pixels between tiles, and of the margins of a small sheet that hold the names above and on the left."""
PAPER, INK = 250, "#222222"
DPI = 100


def single_condition(mix: ConditionMix, name: str, severity: int) -> ConditionMix:
    """One condition of a mixture, at this severity or at its worst if it has fewer."""
    if severity < 1:
        raise ValueError(f"severity={severity}: the mildest is 1")
    return replace(mix, weights={name: 1.0}, severity=min(severity, len(mix.presets[name])))


def short_scene(rig: Rig, layout: str, scenario: Scenario, condition: ConditionMix, seed: int) -> Scene:
    """A scene of one keyframe for the rig; the same seed gives the same road and traffic in every condition."""
    view = sector_covered(rig)
    return build_episode(
        name=layout,
        layout=layout,
        seed=seed,
        duration=rig.duration(1),
        scenario=scenario,
        condition=condition,
        view=view,
    )


Captured = tuple[CaptureEvent, Any]
"""An event and what was measured."""


def data_of(captured: Iterable[Captured], mounts: Mapping[str, Mount]) -> Iterator[Any]:
    """What these sensors measured."""
    return (data for event, data in captured if event.channel in mounts)


def write_sheet(
    path: Path,
    rows: Sequence[Sequence[Image]],
    *,
    row_names: Sequence[str],
    column_names: Sequence[str],
    side: int = SIDE,
) -> None:
    """Writes tiles in a grid, one pixel a pixel: equal heights in a row, equal widths in a column. ``side`` pixels on the left
    hold the rows' names, whose lines after the first are set smaller; margins and type grow with a sheet wider than 1,500
    pixels. Raises OSError when the picture cannot be written."""
    scale = max(1.0, sum(tile.shape[1] for tile in rows[0]) / 1500)
    head, side = round(HEAD * scale), round(side * scale)
    lefts = side + np.cumsum([0, *(tile.shape[1] + GAP for tile in rows[0])])
    tops = head + np.cumsum([0, *(row[0].shape[0] + GAP for row in rows)])
    canvas = np.full((tops[-1], lefts[-1], 3), PAPER, np.uint8)
    for top, row in zip(tops, rows, strict=False):
        for left, tile in zip(lefts, row, strict=False):
            canvas[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    height, width = canvas.shape[:2]
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    figure.figimage(canvas, origin="upper")
    for left, tile, name in zip(lefts, rows[0], column_names, strict=False):
        _write(figure, name, left + tile.shape[1] / 2, head / 2, size=11 * scale, ha="center", va="center")
    for top, row, name in zip(tops, rows, row_names, strict=False):
        title, *more = name.split("\n")
        middle = top + row[0].shape[0] / 2 - 7.0 * scale * len(more)
        _write(figure, title, 8, middle, size=10 * scale, va="center", weight="bold")
        _write(figure, "\n".join(more), 8, middle + 12 * scale, size=7.5 * scale, va="top", linespacing=1.35)
    figure.savefig(path, pil_kwargs={"quality": 84, "optimize": True} if path.suffix == ".jpg" else None)


def _write(figure: Figure, text: str, x: float, y: float, **style: Any) -> None:
    width, height = figure.get_size_inches() * DPI
    figure.text(x / width, 1 - y / height, text, color=INK, **style)
