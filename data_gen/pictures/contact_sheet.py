"""``python -m data_gen.pictures.contact_sheet``: every layout, or every sensor, in every condition as one picture."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from omegaconf import DictConfig

from data_gen.episode import build_episode
from data_gen.pictures.picture_file import picture_file
from data_gen.recording.capture import capture
from data_gen.rig.coverage import view_of
from data_gen.rig.rig import Rig
from data_gen.road.layout import LAYOUTS
from data_gen.scene.conditions import ConditionMix
from data_gen.scene.scene import Scene
from data_gen.sensors.camera.camera import CameraFrame
from fusion_net.common.cli.command import build, command

Image = NDArray[np.uint8]

GAP, HEAD, SIDE = 4, 30, 112
"""Pixels between tiles, and of the margins of a small sheet that hold the names above and on the left."""
PAPER, INK = 250, "#222222"
DPI = 100


@command(config_name="contact_sheet")
def main(cfg: DictConfig) -> None:
    """Draws the sheet that ``cfg.show`` names into ``cfg.out``."""
    from data_gen.pictures.sensor_sheet import draw_sensors

    out = picture_file(cfg.out)
    rig, mix = build(cfg.rig, "rig"), build(cfg.condition, "condition")
    settings: dict[str, Any] = {"severity": cfg.severity, "seed": cfg.seed}
    if cfg.show == "layouts":
        draw_layouts(out, rig, mix, **settings)
    elif cfg.show == "sensors":
        draw_sensors(out, rig, mix, layout=cfg.layout, **settings)
    else:
        raise ValueError(f"show={cfg.show} is neither layouts nor sensors")
    print(f"wrote {out}")


def draw_layouts(path: Path, rig: Rig, mix: ConditionMix, *, severity: int, seed: int) -> None:
    """Writes what the rig's first camera sees: a row a layout, a column a condition; a row shows the same road and
    traffic throughout, but for the lorry that throws up the spray."""
    if not rig.cameras:
        raise ValueError(f"rig '{rig.name}' has no camera, and this sheet shows one; try show=sensors or rig=nano")
    channel, camera = next(iter(rig.cameras.items()))
    alone = replace(rig, cameras={channel: camera}, radars={})
    names = list(mix.weights)
    rows = []
    for layout in LAYOUTS:
        scenes = (episode(rig, layout, only(mix, name, severity), seed) for name in names)
        rows.append([_picture(scene, alone, seed) for scene in scenes])
    write_sheet(path, rows, row_names=[spoken(name) for name in LAYOUTS], column_names=[spoken(name) for name in names])


def _picture(scene: Scene, rig: Rig, seed: int) -> Image:
    """The first image of a rig; what would fire after it does not."""
    firings = capture(scene, rig, keyframes=1, seed=seed)
    return next(firing.data.image for firing in firings if isinstance(firing.data, CameraFrame) and firing.is_keyframe)


def only(mix: ConditionMix, name: str, severity: int) -> ConditionMix:
    """One condition of a mixture, at this severity or at its worst if it has fewer."""
    if severity < 1:
        raise ValueError(f"severity={severity}: the mildest is 1")
    return replace(mix, weights={name: 1.0}, severity=min(severity, len(mix.presets[name])))


def episode(rig: Rig, layout: str, condition: ConditionMix, seed: int) -> Scene:
    """A short scene for the rig; the same seed gives the same road and traffic in every condition."""
    duration = 1.0 + 1 / rig.keyframe_rate
    return build_episode(
        name=layout, layout=layout, seed=seed, duration=duration, condition=condition, view=view_of(rig)
    )


def spoken(name: str) -> str:
    """A name of the settings as one says it."""
    return {"dusk_glare_spray": "dusk, glare, spray"}.get(name, name.replace("_", " "))


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


if __name__ == "__main__":
    main()
