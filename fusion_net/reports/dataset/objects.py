"""Charts of what is labelled in a data set: classes, places, speeds, sizes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle

from fusion_net.common.drawing import label
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.reports.dataset.drawing import COLOR_OF, GROUPS, stacked
from fusion_net.reports.dataset.summary import RANGES, SPEEDS, VISIBILITY, Summary
from fusion_net.reports.dataset.survey import Survey


def classes(axes: Axes, found: Survey, summary: Summary) -> None:
    """Objects of each class as bars, labelled with number and percentage."""
    counts = [summary["classes"][name]["objects"] for name in CLASSES]
    bars = axes.barh([label(name) for name in CLASSES], counts, color=[COLOR_OF[name] for name in CLASSES], height=0.7)
    labels = [f" {count:,}  ({count / max(sum(counts), 1):.0%})" for count in counts]
    axes.bar_label(bars, labels, fontsize=8, color="#444444")
    axes.invert_yaxis()
    axes.set_xlim(0, 1.22 * max(*counts, 1))
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("labelled boxes, all keyframes")


def from_above(axes: Axes, found: Survey, summary: Summary) -> None:
    """Where objects are around the car."""
    ahead, left = found.objects.place.T
    axes.set_facecolor("#f4f3ef")
    axes.hexbin(-left, ahead, gridsize=42, extent=(-60, 60, -60, 60), mincnt=1, bins="log", cmap="YlGnBu", linewidths=0)
    for radius in (20, 40, 60):
        axes.add_patch(Circle((0, 0), radius, fill=False, color="#bbbbbb", linewidth=0.8))
    axes.plot(0, 0, "^", color="#e07a5f", markersize=7)
    axes.set_aspect("equal")
    low = min(float(ahead.min(initial=0.0)), 0.0)
    axes.set_ylim(-62 if low < -10 else -8, 62)
    axes.set_xlim(-62, 62)
    axes.set_xlabel("m to the right")
    axes.set_ylabel("m ahead")
    axes.grid(visible=False)


def ranges(axes: Axes, found: Survey, summary: Summary) -> None:
    """Objects by distance from the ego, stacked by group."""
    stacked(axes, RANGES, {name: [summary["classes"][c]["range"] for c in of] for name, (_, of) in GROUPS.items()})
    axes.set_xlabel("distance from the car, m")
    axes.set_ylabel("boxes")


def speeds(axes: Axes, found: Survey, summary: Summary) -> None:
    """Speeds of what moves, stacked by group; what is at rest is said in the title."""
    speed, of_class = found.objects.speed, found.objects.label
    edges = np.arange(0, 36, 1.5)
    moving = speed > SPEEDS[1]
    chosen = {
        name: [np.histogram(speed[moving & (of_class == CLASSES.index(c))], edges)[0] for c in of]
        for name, (_, of) in GROUPS.items()
    }
    stacked(axes, edges, chosen)
    axes.set_xlabel("speed, m/s")
    axes.set_ylabel("boxes")
    known = max(np.isfinite(speed).sum(), 1)
    axes.set_title(f"{moving.sum() / known:.0%} move faster than {SPEEDS[1]} m/s, the others stand", loc="left")


def visibility(axes: Axes, found: Survey, summary: Summary) -> None:
    """Fractions of the four visibility levels in each class."""
    rows = np.array([summary["classes"][name]["visibility"] for name in CLASSES], float)
    rows /= np.maximum(rows.sum(axis=1, keepdims=True), 1)
    left = np.zeros(len(CLASSES))
    for level, color in zip(range(1, 5), ("#d9d4c7", "#b8c4bb", "#6f9a8d", "#2d6a60"), strict=True):
        axes.barh(
            [label(name) for name in CLASSES],
            rows[:, level],
            left=left,
            color=color,
            height=0.7,
            label=VISIBILITY[level],
        )
        left += rows[:, level]
    axes.invert_yaxis()
    axes.set_xlim(0, 1)
    axes.grid(visible=False)
    axes.set_xlabel("fraction of boxes by visible part of the object")
    axes.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.45, 1.0))


def crowd(axes: Axes, found: Survey, summary: Summary) -> None:
    """How many objects a keyframe has."""
    counts = np.bincount(found.objects.keyframe, minlength=len(found.scene))
    axes.hist(counts, bins=np.arange(0, max(counts.max(), 10) + 3, 2).tolist(), color="#2f6690", rwidth=0.9)
    axes.axvline(counts.mean(), color="#e07a5f", linewidth=1.5)
    axes.annotate(
        f"mean {counts.mean():.1f}", (counts.mean(), 0.95), xycoords=("data", "axes fraction"), xytext=(6, 0),
        textcoords="offset points", color="#e07a5f", va="top",
    )  # fmt: skip
    axes.set_xlabel("objects in a keyframe")
    axes.set_ylabel("keyframes")
    axes.grid(axis="x", visible=False)


def sizes(axes: Axes, found: Survey, summary: Summary) -> None:
    """Footprints to scale, nose to the left: every size that occurs in a class, one above the other."""
    left = 0.0
    for index, name in enumerate(CLASSES):
        mine = np.unique(found.objects.wlh[found.objects.label == index].round(2), axis=0)[:40]
        room = max(float(mine[:, 1].max(initial=0.0)), 4.2)
        for width, length, _ in mine.tolist():
            corner = (left + (room - length) / 2, -width / 2)
            axes.add_patch(Rectangle(corner, length, width, facecolor=COLOR_OF[name] + "22", edgecolor=COLOR_OF[name]))
        axes.annotate(
            label(name).replace(" ", "\n"), (left + room / 2, -2.1), ha="center", va="top", fontsize=8, color="#444444"
        )
        left += room + 1.2
    axes.set_xlim(-0.5, left)
    axes.set_ylim(-4.6, 2.0)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.plot([0, 5], [-3.8, -3.8], color="#333333", linewidth=1.5)
    axes.annotate("5 m", (5.4, -3.8), va="center", fontsize=8)
