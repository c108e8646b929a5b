"""The drop table as one bar chart."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fusion_net.reports.tables import name_of

COLORS = {3: "#22577a", 2: "#4d9078", 1: "#c7a252"}
"""By number of sensors: dark is much, light is little."""


def plot_drop_table(path: Path, doc: dict[str, Any]) -> None:
    """Bars of mAP by subset of sensors with their 95 % intervals, NDS as dots, the random guess as a dashed line."""
    rows = doc["rows"]
    place = np.arange(len(rows))
    height = np.array([row["mAP"] for row in rows])
    low, high = np.array([row["mAP_ci95"] for row in rows]).T
    figure = Figure(figsize=(7.5, 3.8), dpi=120, layout="constrained")
    axes = figure.subplots()
    whiskers = np.clip([height - low, high - height], 0, None)
    colors = [COLORS[len(row["sensors"])] for row in rows]
    axes.bar(
        place, height, width=0.66, color=colors, yerr=whiskers, capsize=4, ecolor="#333333", label="mAP, 95 % interval"
    )
    axes.plot(place + 0.24, [row["NDS"] for row in rows], "o", color="#333333", markersize=4, label="NDS")
    axes.axhline(doc["random"]["mAP"], color="#b23a48", linestyle="--", linewidth=1, label="mAP of random guesses")
    for x, value, top in zip(place, height, high, strict=True):
        axes.annotate(
            f"{value:.2f}", (x, max(value, top)), xytext=(0, 4), textcoords="offset points", ha="center", fontsize=9
        )
    axes.set_xticks(place, [name_of(row["sensors"]) for row in rows])
    axes.set_ylim(0, 1.12 * max(0.1, *high, *(row["NDS"] for row in rows)))
    axes.set_ylabel("mAP")
    axes.set_title(
        f"{doc['run']}: what each sensor is worth ({doc['num_samples']} samples of {doc['split']})", fontsize=10
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="upper right")
    figure.savefig(path)
