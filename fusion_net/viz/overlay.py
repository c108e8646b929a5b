"""The calibration overlay of a data set as it is read, faults and all: how many LiDAR points lie on the exact depth of their
pixels, at which turn of the LiDAR most of them do, and a picture."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.drawing import Image
from fusion_net.common.nuscenes_format import REFERENCE
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.data.samples import Sample
from fusion_net.viz.calibration import agreement, follow, turned
from fusion_net.viz.lidar_check import TimedView, draw_sample, read_views

STEP = 0.1
TURNS = np.arange(-4.0, 4.01, STEP)
"""Degrees about the LiDAR's vertical that are tried; half a step is the least error that is claimed."""
RESAMPLES = 50


@dataclass(frozen=True)
class Keyframe:
    """What the overlay needs of one sample: points without faults of the labels' cells, views of full size."""

    sample: Sample
    views: list[TimedView]
    lidar_place: NDArray[np.float64]  # (3,) ego frame


def read_keyframe(dataset: NuScenesDataset, place: int) -> Keyframe:
    """A sample at full size, with the data set's faults."""
    nusc, token = dataset.index[place]
    sample = replace(dataset.reader, cameras=[], label_stride=None).read(nusc, token)
    lidar_place = nusc.ego_T_sensor(nusc.keyframes[token][REFERENCE])[:3, 3]
    return Keyframe(sample, read_views(nusc, token, dataset.reader), lidar_place)


def overlay_picture(dataset: NuScenesDataset, place: int) -> Image:
    """The sheet of :mod:`fusion_net.viz.lidar_check`."""
    keyframe = read_keyframe(dataset, place)
    return draw_sample(keyframe.sample, keyframe.views, lidar_place=keyframe.lidar_place, grid=dataset.grid)


def measure_overlay(dataset: NuScenesDataset, places: Sequence[int]) -> dict[str, Any] | None:
    """The share of points that fit as they are and over turns, and the turn of the best fit with its standard error, as plain
    values; None where no camera has exact depth, as in recorded data, or no sample a point."""
    curves = [curve for place in places for curve in _curves(read_keyframe(dataset, place))]
    if not curves:
        return None
    every = np.array(curves)
    rng = np.random.default_rng(0)
    spread = [_peak(every[rng.integers(len(every), size=len(every))].mean(axis=0)) for _ in range(RESAMPLES)]
    mean = every.mean(axis=0)
    return {
        "agreement": float(mean[np.abs(TURNS).argmin()]),
        "turn_deg": _peak(mean),
        "turn_error": float(np.hypot(np.std(spread), STEP / 2)),
        "views": len(every),
        "turns_deg": np.round(TURNS, 2).tolist(),
        "by_turn": np.round(mean, 4).tolist(),
    }


def _curves(keyframe: Keyframe) -> list[NDArray[np.float64]]:
    """Of each camera with exact depth the share of points that fit, over TURNS."""
    points = keyframe.sample.lidar_points
    curves = []
    for view in keyframe.views:
        if view.depth is None or not len(points):
            continue
        there, _ = follow(points[:, :3], points[:, 4], keyframe.sample.boxes, view.time)
        turns = [turned(there, keyframe.lidar_place, turn) for turn in TURNS]
        curve = np.array([agreement(each, view.depth, view.cam_K, view.ego_T_cam) for each in turns])
        if np.isfinite(curve).all():
            curves.append(curve)
    return curves


def _peak(curve: NDArray[np.float64]) -> float:
    """Degrees at which a curve over TURNS is highest: the vertex of the parabola through the five points about its maximum."""
    middle = int(np.clip(curve.argmax(), 2, len(curve) - 3))
    window = slice(middle - 2, middle + 3)
    square, slope, _ = np.polyfit(TURNS[window] - TURNS[middle], curve[window], 2)
    step = -slope / (2 * square) if square < 0 else 0.0
    return float(TURNS[middle] + np.clip(step, -0.2, 0.2))
