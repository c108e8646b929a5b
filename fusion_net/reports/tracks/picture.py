"""Tracks of one scene from above: what is there, and what each set of tracks makes of it."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
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
    path: Path,
    panels: Mapping[str, TrackBoxes],
    frames: Frames,
    *,
    scene: int,
    global_T_ego: NDArray[np.float64],
    min_score: float = 0.3,
) -> None:
    """One panel for each set of tracks, without those whose mean score is less than ``min_score``. Each track has a colour
    of its own, so that a change of colour along a way is a change of identity. Axes are those of the car in the scene's
    first keyframe; its own way is black."""
    samples = np.flatnonzero(frames.scene == scene)
    samples = samples[np.argsort(frames.timestamp[samples])]
    start_T_global = invert(global_T_ego[samples[0]])
    ego = transform(start_T_global, global_T_ego[samples, :3, 3])[:, :2]
    columns = 3 if len(panels) > 2 else len(panels)
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(4.4 * columns, 4.6 * rows), dpi=110, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for axes, (title, tracks) in zip(grid, panels.items(), strict=False):
        rows_of = np.flatnonzero(np.isin(tracks.table.sample, samples))
        count = _draw(axes, tracks, frames, rows_of, start_T_global, min_score)
        axes.plot(*ego.T, color="black", linewidth=2)
        axes.plot(*ego[-1], marker="^", color="black", markersize=6)
        axes.set_title(f"{title}: {count} tracks", fontsize=10)
        axes.set_aspect("equal")
        axes.grid(color="#e4e4e4", linewidth=0.6)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    figure.suptitle(f"{len(samples)} keyframes of a scene, metres; tracks with a mean score of at least {min_score:g}")
    figure.savefig(path)


def _draw(
    axes: Axes, tracks: TrackBoxes, frames: Frames, rows: NDArray[np.int64], start_T_global: NDArray, min_score: float
) -> int:
    """Draws what is good enough; returns how many tracks that is."""
    colors, drawn = colormaps["tab20"].colors, 0  # type: ignore[attr-defined]
    for number, (own, _) in enumerate(_paths(tracks, frames, rows)):
        if tracks.table.boxes.score[own].mean() < min_score:
            continue
        xy = transform(start_T_global, tracks.table.boxes.center[own])[:, :2]
        color, drawn = colors[number % len(colors)], drawn + 1
        if np.linalg.norm(xy - xy[0], axis=1).max() < STILL:
            axes.plot(*xy.mean(axis=0), marker="s", markersize=3, color=color)
            continue
        axes.add_collection(LineCollection([xy], colors=[color], linewidths=1.4))
        axes.plot(*xy.T, ".", markersize=3, color=color)
        axes.plot(*xy[-1], marker="o", markersize=4, color=color)
    return drawn


def _paths(tracks: TrackBoxes, frames: Frames, rows: NDArray[np.int64]):
    """Rows and places of each track, in the order of time."""
    scene = frames.scene[tracks.table.sample[rows]]
    time = frames.timestamp[tracks.table.sample[rows]]
    order = rows[np.lexsort([time, tracks.track[rows], scene])]
    name, scene = tracks.track[order], frames.scene[tracks.table.sample[order]]
    cuts = np.flatnonzero((name[1:] != name[:-1]) | (scene[1:] != scene[:-1])) + 1
    for own in np.split(order, cuts) if len(order) else []:
        yield own, tracks.table.boxes.center[own, :2]
