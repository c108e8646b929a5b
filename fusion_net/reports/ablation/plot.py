"""The comparison of variants as a chart: a panel for each subset of sensors, a bar for each variant."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fusion_net.reports.plots import COLORS, whiskers
from fusion_net.reports.tables import NAMES


def plot_ablation(path: Path, doc: dict[str, Any]) -> None:
    """Bars of mAP from zero, with 95 % intervals over seeds and scenes, and a dot for each seed."""
    variants = [variant for variant in doc["variants"] if variant["n"]]
    names = [name for name in NAMES if any(name in variant["mAP"] for variant in variants)]
    place = np.arange(len(variants))[::-1]
    label = max(len(variant["label"]) for variant in variants)
    figure = Figure(
        figsize=(1.0 + 0.075 * label + 1.6 * len(names), 1.1 + 0.34 * len(variants)), dpi=110, layout="constrained"
    )
    panels = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, names, strict=True):
        top = 0.0
        for y, variant in zip(place, variants, strict=True):
            score = variant["mAP"].get(name)
            if score is None:
                continue
            errors = whiskers(np.array([score["mean"]]), [score["ci95"]])
            color = COLORS[name.count("+") + 1]
            axes.barh(y, score["mean"], height=0.66, color=color, xerr=errors, capsize=3, ecolor="#333333")
            axes.plot(score["values"], [y] * len(score["values"]), "o", color="white", markeredgecolor="#333333", ms=3)
            top = max(top, score["mean"] + float(np.nan_to_num(errors[1, 0])), *score["values"])
        axes.set_xlim(0, 1.08 * max(top, 0.01))
        axes.set_title(name, fontsize=9)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_yticks(place, [f"{variant['label']} (n={variant['n']})" for variant in variants], fontsize=8)
    figure.supxlabel("mAP; bars from zero, 95 % intervals over seeds and scenes, dots: seeds", fontsize=8)
    figure.suptitle(doc["sweep"], fontsize=10)
    figure.savefig(path)
