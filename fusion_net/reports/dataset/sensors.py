"""Charts of the conditions of a data set and of what its sensors get in them."""

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from fusion_net.common.drawing import label
from fusion_net.common.modalities import STYLES
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.reports.dataset.drawing import COLOR_OF, FIVE
from fusion_net.reports.dataset.summary import RANGES, Summary, all_returns
from fusion_net.reports.dataset.survey import Survey

Integers = NDArray[np.int64]

SEVERITY = ("#a9c5d8", "#5b8fb0", "#1f4e6e", "#10293b")
NEAR = (15, 45)
"""Metres between which objects are compared from condition to condition."""
CRN_RCS = (4.783, 7.576)
"""Mean and standard deviation of the RCS of nuScenes' radar returns in dBsm, as CRN normalises them."""


def conditions(axes: Axes, found: Survey, summary: Summary) -> None:
    """Scenes of each condition, stacked by severity."""
    names = list(dict.fromkeys(entry["condition"] for entry in summary["conditions"]))
    left = np.zeros(len(names))
    for severity in sorted({entry["severity"] for entry in summary["conditions"]}):
        of = {e["condition"]: e["scenes"] for e in summary["conditions"] if e["severity"] == severity}
        width = np.array([of.get(name, 0) for name in names])
        bars = axes.barh(
            [label(name) for name in names], width, left=left, color=SEVERITY[min(severity, 4) - 1], height=0.7,
            label=f"severity {severity}",
        )  # fmt: skip
        axes.bar_label(bars, [str(n) if n else "" for n in width], label_type="center", color="white", fontsize=8)
        left += width
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("scenes")
    axes.legend(loc="lower right")


def condition_effects(axes: Axes, found: Survey, summary: Summary) -> None:
    """The image's contrast in each condition, and of the LiDAR points and radar returns of the same objects: those
    of a class and a ring of distance relative to the clear mean of that class and ring."""
    condition = np.array(found.condition)
    names = list(dict.fromkeys(entry["condition"] for entry in summary["conditions"]))
    base = names.index("clear") if "clear" in names else 0
    contrast = [
        np.mean([r.contrast for r in found.sensor_data if condition[r.keyframe] == n] or [np.nan]) for n in names
    ]
    kinds = {
        "contrast of the image": (STYLES["camera"].color, np.array(contrast) / max(contrast[base], 1e-9)),
        "LiDAR points of an object": (
            STYLES["lidar"].color,
            _relative_to(found, found.objects.lidar_points, names, base),
        ),
        "its radar returns": (STYLES["radar"].color, _relative_to(found, found.objects.radar_points, names, base)),
    }
    place = np.arange(len(names))
    for i, (text, (color, height)) in enumerate(kinds.items()):
        axes.bar(place + 0.27 * (i - 1), height, 0.25, color=color, label=text)
    axes.axhline(1.0, color="#888888", linewidth=0.8)
    axes.set_xticks(place, [label(name).replace(" ", "\n") for name in names], fontsize=8)
    axes.grid(axis="x", visible=False)
    axes.set_ylim(top=1.2 * axes.get_ylim()[1])
    axes.set_ylabel(f"relative to {label(names[base])}, objects {NEAR[0]} to {NEAR[1]} m away", fontsize=7.5)
    axes.legend(ncols=3, loc="upper center", fontsize=7.5, columnspacing=1.0)


def _relative_to(found: Survey, values: Integers, names: list[str], base: int) -> NDArray[np.float64]:
    """Sum of the objects' values in each condition over what the base condition would give the same objects."""
    objects = found.objects
    condition = np.array(found.condition)[objects.keyframe]
    near = (objects.range >= NEAR[0]) & (objects.range < NEAR[1])
    cell = objects.label * 10 + ((objects.range - NEAR[0]) // 10).astype(np.int64).clip(0, 9)
    chosen = near & (condition == names[base])
    count = np.bincount(cell[chosen], minlength=100)
    mean = np.bincount(cell[chosen], values[chosen], minlength=100) / np.maximum(count, 1)
    known = near & (count[cell] > 0)
    return np.array(
        [values[known & (condition == n)].sum() / max(mean[cell[known & (condition == n)]].sum(), 1e-9) for n in names]
    )


def brightness(axes: Axes, found: Survey, summary: Summary) -> None:
    """Mean brightness of the images against their contrast, one point per keyframe, by condition."""
    names = list(dict.fromkeys(entry["condition"] for entry in summary["conditions"]))
    colors = matplotlib.colormaps["tab10"].colors  # type: ignore[attr-defined]
    for name, color in zip(names, colors, strict=False):
        mine = [each for each in found.sensor_data if found.condition[each.keyframe] == name]
        axes.scatter(
            [r.brightness for r in mine], [r.contrast for r in mine], s=14, alpha=0.7, color=color, linewidths=0,
            label=label(name),
        )  # fmt: skip
    axes.set_xlabel("mean of the image, 0 to 255")
    axes.set_ylabel("standard deviation")
    axes.legend(ncols=2)


def layouts(axes: Axes, found: Survey, summary: Summary) -> None:
    """Scenes of each road layout."""
    names = sorted(summary["layouts"], key=lambda name: -summary["layouts"][name])
    bars = axes.barh(
        [label(name) for name in names], [summary["layouts"][name] for name in names], color="#7d9aa8", height=0.7
    )
    axes.bar_label(bars, fontsize=8, padding=3, color="#444444")
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("scenes")


def lidar_points(axes: Axes, found: Survey, summary: Summary) -> None:
    """Mean LiDAR points of an object by distance."""
    _by_range(axes, summary, "lidar_points_by_range")
    axes.set_yscale("log")
    axes.set_ylabel("LiDAR points, mean")


def radar_points(axes: Axes, found: Survey, summary: Summary) -> None:
    """Mean radar returns of an object in a keyframe by distance."""
    _by_range(axes, summary, "radar_points_by_range")
    axes.set_ylim(bottom=0)
    axes.set_ylabel("radar returns, mean")


def _by_range(axes: Axes, summary: Summary, figure: str) -> None:
    middle = (np.array(RANGES[:-1]) + RANGES[1:]) / 2
    for name in CLASSES:
        values = np.array(summary["classes"][name][figure], float)
        values[values == 0] = np.nan  # no place on a logarithmic axis
        style = "-" if name in FIVE else ":"
        axes.plot(middle, values, style, marker="o", markersize=3, color=COLOR_OF[name], label=label(name))
    axes.set_xlabel("distance from the car, m")
    axes.legend(ncols=2)


def rcs(axes: Axes, found: Survey, summary: Summary) -> None:
    """RCS of the returns of some classes and of all returns, with nuScenes' mean and spread."""
    edges = np.arange(-30, 42, 2.0)
    values = all_returns(found, "rcs")
    axes.hist(values, edges.tolist(), density=True, color="#d8d8d2", label=f"all returns ({len(values):,})")
    for name in FIVE:
        mine = np.concatenate([np.zeros(0), *(each.rcs_of.get(name, np.zeros(0)) for each in found.sensor_data)])
        if len(mine) > 20:
            density, _ = np.histogram(mine, edges, density=True)
            axes.plot(edges[:-1] + 1, density, color=COLOR_OF[name], linewidth=1.6, label=label(name))
    mean, deviation = CRN_RCS
    top = axes.get_ylim()[1]
    axes.errorbar(mean, 1.04 * top, xerr=deviation, fmt="o", color="#333333", capsize=3, markersize=4)
    axes.annotate(
        "nuScenes, mean and std", (mean + deviation + 1, 1.04 * top), fontsize=8, va="center", color="#333333"
    )
    axes.set_ylim(0, 1.12 * top)
    axes.set_xlabel("radar cross-section, dBsm")
    axes.set_ylabel("density")
    axes.legend(loc="upper left")


def returns(axes: Axes, found: Survey, summary: Summary) -> None:
    """Radar returns of one sensor's scan."""
    counts = np.array([count for each in found.sensor_data for count in each.radar_returns] or [0])
    axes.hist(counts, bins=np.linspace(0, max(counts.max(), 10), 30).tolist(), color=STYLES["radar"].color, rwidth=0.9)
    axes.set_xlabel("returns in one scan of one radar")
    axes.set_ylabel("scans")
    axes.grid(axis="x", visible=False)
