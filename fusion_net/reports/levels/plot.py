"""What is left of mAP under faults, the three levels beside each other."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.reports.levels.runs import LEVELS

COLORS = {"early": "#b23a48", "mid": "#22577a", "late": "#4d9078"}
MARKERS = {"early": "o", "mid": "s", "late": "^"}


def plot_levels(path: Path, doc: dict[str, Any]) -> None:
    """A row of panels a sensor: turned (mean of the axes), moved, late. mAP from zero, 95 % intervals over scenes."""
    columns = [level for level in LEVELS if level in doc["levels"]]
    figure = Figure(figsize=(10.5, 8.0), dpi=110, layout="constrained")
    panels = figure.subplots(len(MODALITIES), 3, sharey=True, squeeze=False)
    kinds = (
        ("turned, degrees", ("roll", "pitch", "yaw"), "calibration", 1.0),
        ("moved, m", ("x", "y", "z"), "calibration", 1.0),
        ("late, ms", ("none",), "clocks", 1000.0),
    )
    for row, sensor in zip(panels, MODALITIES, strict=True):
        for axes, (what, words, group, scale) in zip(row, kinds, strict=True):
            for place, level in enumerate(columns):
                own = [
                    each
                    for each in doc["levels"][level]["curves"][group]
                    if each["name"].startswith(sensor) and each["name"].split()[-1] in words
                ]
                if own:
                    _line(axes, own, level, scale, place)
            axes.set_xlabel(f"{sensor} {what}", fontsize=8)
            axes.tick_params(labelsize=7)
            axes.spines[["top", "right"]].set_visible(False)
    panels[0, 0].set_ylim(bottom=0)
    panels[0, 0].legend(frameon=False, fontsize=8)
    for row in panels:
        row[0].set_ylabel("mAP", fontsize=8)
    seeds = ", ".join(map(str, doc["cell_seeds"])) or "none"
    figure.suptitle(
        f"One faulty sensor: mAP, mean over axes, 95 % intervals over scenes ({doc['samples']}, seed {seeds})",
        fontsize=10,
    )
    figure.savefig(path)


def _line(axes: Axes, curves: list[dict[str, Any]], level: str, scale: float, place: int) -> None:
    """The mean of several curves of the same amounts, beside those of other levels by a hair."""
    amounts = scale * np.array(curves[0]["amounts"])
    score, low, high = (np.mean([curve[name] for curve in curves], axis=0) for name in ("mAP", "low", "high"))
    shift = 0.012 * (place - 1) * amounts[-1]
    whiskers = np.clip([score - low, high - score], 0, None)
    axes.errorbar(
        amounts + shift,
        score,
        yerr=whiskers,
        color=COLORS[level],
        marker=MARKERS[level],
        ms=4,
        lw=1.2,
        elinewidth=0.8,
        capsize=2,
        label=level,
    )
