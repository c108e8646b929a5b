"""Tracks of one scene from above: what is there, and what each set of tracks makes of it."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fusion_net.common.geometry import invert, transform
from fusion_net.metrics.track_boxes import TrackBoxes
from fusion_net.metrics.track_paths import Frames

STILL = 1.0
"""Metres that an object moves at least to be drawn as a path; the others are dots."""


def busiest_scene(labels: TrackBoxes, frames: Frames) -> int:
    """Number of the scene whose labelled tracks are, added up, the longest ways."""
    scene = frames.scene[labels.table.sample]
    ways = np.zeros(frames.scene.max(initial=0) + 1)
    for number, xy in _paths(labels, frames, np.arange(len(labels))):
        ways[scene[number[0]]] += np.linalg.norm(xy[-1] - xy[0])
    return int(ways.argmax())


def draw_tracks(
    path: Path, panels: Mapping[str, TrackBoxes], frames: Frames, *, scene: int, global_T_ego: NDArray[np.float64]
) -> None:
    """One panel for each set of tracks, the first of them the labels. Of the others as many are drawn as there are labelled
    ones, those of the largest sum of scores. Each has a colour of its own, so that a change of colour along a way is a
    change of identity; squares stand. Axes are those of the car in the scene's first keyframe; its own way is black."""
    samples = np.flatnonzero(frames.scene == scene)
    samples = samples[np.argsort(frames.timestamp[samples])]
    start_T_global = invert(global_T_ego[samples[0]])
    ego = transform(start_T_global, global_T_ego[samples, :3, 3])[:, :2]
    ways = {title: _ways(tracks, frames, samples, start_T_global) for title, tracks in panels.items()}
    number = len(next(iter(ways.values())))
    shown = {title: sorted(own, key=lambda way: -way[1])[:number] for title, own in ways.items()}
    everything = np.concatenate([ego, *(xy for own in shown.values() for xy, _ in own)])
    width, height = np.maximum(np.ptp(everything, axis=0), 20.0) + 10.0
    columns = 1 if width > 2.5 * height else min(3, len(shown))
    rows = -(-len(shown) // columns)
    panel = 12.0 / columns
    figure = Figure(figsize=(12.0, 0.6 + rows * (0.45 + panel * height / width)), dpi=110, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for axes, (title, own) in zip(grid, shown.items(), strict=False):
        _draw(axes, [xy for xy, _ in own])
        axes.plot(*ego.T, color="black", linewidth=2)
        axes.plot(*ego[-1], marker="^", color="black", markersize=6)
        axes.set_title(title if title == next(iter(shown)) else f"tracks of {title}", fontsize=10)
        axes.set_aspect("equal")
        axes.grid(color="#e4e4e4", linewidth=0.6)
    for axes in grid[len(shown) :]:
        axes.set_axis_off()
    figure.suptitle(f"{len(samples)} keyframes from above, metres; of each the best {number} tracks")
    figure.savefig(path)


def _ways(
    tracks: TrackBoxes, frames: Frames, samples: NDArray[np.int64], start_T_global: NDArray[np.float64]
) -> list[tuple[NDArray[np.float64], float]]:
    """The way (K, 2) of each track of a scene, in the order of time, and the sum of its scores."""
    rows = np.flatnonzero(np.isin(tracks.table.sample, samples))
    boxes = tracks.table.boxes
    return [
        (transform(start_T_global, boxes.center[own])[:, :2], float(boxes.score[own].sum()))
        for own, _ in _paths(tracks, frames, rows)
    ]


def _draw(axes: Axes, ways: list[NDArray[np.float64]]) -> None:
    colors = colormaps["tab20"].colors  # type: ignore[attr-defined]
    for number, xy in enumerate(ways):
        color = colors[number % len(colors)]
        if np.linalg.norm(xy - xy[0], axis=1).max() < STILL:
            axes.plot(*xy.mean(axis=0), marker="s", markersize=4, color=color)
            continue
        axes.plot(*xy.T, ".-", markersize=3, linewidth=1.3, color=color)
        axes.plot(*xy[-1], marker="o", markersize=5, color=color)


def _paths(tracks: TrackBoxes, frames: Frames, rows: NDArray[np.int64]):
    """Rows and places of each track, in the order of time."""
    scene = frames.scene[tracks.table.sample[rows]]
    time = frames.timestamp[tracks.table.sample[rows]]
    order = rows[np.lexsort([time, tracks.track[rows], scene])]
    name, scene = tracks.track[order], frames.scene[tracks.table.sample[order]]
    cuts = np.flatnonzero((name[1:] != name[:-1]) | (scene[1:] != scene[:-1])) + 1
    for own in np.split(order, cuts) if len(order) else []:
        yield own, tracks.table.boxes.center[own, :2]
