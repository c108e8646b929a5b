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


PANELS = {"turned": ("turned, degrees", 1.0), "moved": ("moved, m", 1.0), "late": ("late, ms", 1000.0)}
"""Of each fault the axis, and its unit as a share of the amount's."""


def plot_levels(path: Path, doc: dict[str, Any]) -> None:
    """A row of panels a sensor: turned, moved, late. mAP from zero, 95 % intervals over scenes."""
    figure = Figure(figsize=(10.5, 8.0), dpi=110, layout="constrained")
    panels = figure.subplots(len(MODALITIES), len(PANELS), sharey=True, squeeze=False)
    for row, sensor in zip(panels, MODALITIES, strict=True):
        for axes, (fault, (label, unit)) in zip(row, PANELS.items(), strict=True):
            for place, level in enumerate(LEVELS):
                curve = doc["levels"].get(level, {}).get("panels", {}).get(f"{sensor} {fault}")
                if curve:
                    _line(axes, curve, level, unit, place)
            axes.set_xlabel(f"{sensor} {label}", fontsize=8)
            axes.tick_params(labelsize=7)
            axes.spines[["top", "right"]].set_visible(False)
        row[0].set_ylabel("mAP", fontsize=8)
    panels[0, 0].set_ylim(bottom=0)
    if panels[0, 0].lines:
        panels[0, 0].legend(frameon=False, fontsize=8)
    seeds = ", ".join(map(str, doc["cell_seeds"])) or "none"
    title = "One faulty sensor: mAP, mean over axes, 95 % intervals over scenes"
    figure.suptitle(f"{title} ({doc['samples']}, {doc['labels']} labels, seed {seeds})", fontsize=10)
    figure.savefig(path)


def _line(axes: Axes, curve: dict[str, Any], level: str, unit: float, place: int) -> None:
    """A curve, a hair beside those of the other levels."""
    amounts = unit * np.array(curve["amounts"])
    score, low, high = (np.array(curve[name]) for name in ("mAP", "low", "high"))
    axes.errorbar(
        amounts + 0.012 * (place - 1) * amounts[-1],
        score,
        yerr=np.clip([score - low, high - score], 0, None),
        color=COLORS[level],
        marker=MARKERS[level],
        ms=4,
        lw=1.2,
        elinewidth=0.8,
        capsize=2,
        label=level,
    )
