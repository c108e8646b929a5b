"""The drop table as one bar chart."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fusion_net.reports.tables import name_of

COLORS = {3: "#22577a", 2: "#4d9078", 1: "#c7a252"}
"""By number of sensors: dark is much, light is little."""


def whiskers(heights: NDArray[np.float64], ends: Sequence[Sequence[float] | None]) -> NDArray[np.float64]:
    """(2, N) how far the intervals of N bars reach below and above their heights; NaN, which draws nothing, without one."""
    found = np.array([each or (np.nan, np.nan) for each in ends]).reshape(-1, 2).T
    return np.clip([heights - found[0], found[1] - heights], 0, None)


def plot_drop_table(path: Path, doc: dict[str, Any]) -> None:
    """Bars of mAP by subset of sensors with their 95 % intervals, NDS as dots, the random guess as a dashed line."""
    rows = doc["rows"]
    place = np.arange(len(rows))
    height = np.array([row["mAP"] for row in rows])
    figure = Figure(figsize=(7.5, 3.8), dpi=120, layout="constrained")
    axes = figure.subplots()
    errors = whiskers(height, [row["mAP_ci95"] for row in rows])
    tops = height + np.nan_to_num(errors[1])
    colors = [COLORS[len(row["sensors"])] for row in rows]
    axes.bar(
        place, height, width=0.66, color=colors, yerr=errors, capsize=4, ecolor="#333333", label="mAP, 95 % interval"
    )
    axes.plot(place + 0.24, [row["NDS"] for row in rows], "o", color="#333333", markersize=4, label="NDS")
    axes.axhline(doc["random"]["mAP"], color="#b23a48", linestyle="--", linewidth=1, label="mAP of random guesses")
    for x, value, top in zip(place, height, tops, strict=True):
        axes.annotate(f"{value:.2f}", (x, top), xytext=(0, 4), textcoords="offset points", ha="center", fontsize=9)
    axes.set_xticks(place, [name_of(row["sensors"]) for row in rows])
    axes.set_ylim(0, 1.12 * max(0.1, *tops, *(row["NDS"] for row in rows)))
    axes.set_ylabel("mAP")
    axes.set_title(
        f"{doc['run']}: what each sensor is worth ({doc['num_samples']} samples of {doc['split']})", fontsize=10
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="upper right")
    figure.savefig(path)
