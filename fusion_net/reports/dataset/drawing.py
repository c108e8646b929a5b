"""What the charts of the statistics page have in common: colours, type, how a chart becomes a figure."""

from collections.abc import Callable

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fusion_net.reports.dataset.summary import Summary
from fusion_net.reports.dataset.survey import Survey

GROUPS = {
    "cars": ("#2f6690", ("car",)),
    "large vehicles": ("#e07a5f", ("truck", "bus", "trailer", "construction_vehicle")),
    "pedestrians": ("#d4a017", ("pedestrian",)),
    "two-wheelers": ("#5b9a6f", ("motorcycle", "bicycle")),
    "cones, barriers": ("#8d86a8", ("traffic_cone", "barrier")),
}
"""Colour and classes of what is drawn together."""
COLOR_OF = {name: color for color, names in GROUPS.values() for name in names}
STYLE = {
    "font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "#888888",
    "axes.grid": True, "axes.axisbelow": True, "grid.color": "#e6e6e2", "grid.linewidth": 0.8, "figure.facecolor": "white",
    "legend.frameon": False, "legend.fontsize": 8, "xtick.color": "#555555", "ytick.color": "#333333",
    "axes.labelcolor": "#555555", "axes.titlesize": 9,
}  # fmt: skip

Drawing = Callable[[Axes, Survey, Summary], None]
FIVE = ("car", "truck", "pedestrian", "bicycle", "traffic_cone")
"""Classes that stand for the rest where ten lines would hide each other."""


def draw(drawing: Drawing, found: Survey, summary: Summary, size: tuple[float, float] = (5.6, 3.3)) -> Figure:
    """A figure of ``size`` inches with one drawing."""
    with matplotlib.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=size, dpi=150, layout="constrained")
        drawing(figure.subplots(), found, summary)
    return figure


def stacked(axes: Axes, edges, counts: dict[str, list]) -> None:
    """Bars between ``edges`` (N + 1,) of each group's counts, one upon the other."""
    bottom = np.zeros(len(edges) - 1)
    for name, parts in counts.items():
        height = np.sum(parts, axis=0)
        axes.bar(
            edges[:-1], height, np.diff(edges) * 0.92, bottom=bottom, align="edge", color=GROUPS[name][0], label=name
        )
        bottom += height
    axes.grid(axis="x", visible=False)
    axes.legend()
