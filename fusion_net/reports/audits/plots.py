"""One picture per audit, drawn from its numbers alone."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fusion_net.common.modalities import STYLES
from fusion_net.evaluation.audits.result import Audit
from fusion_net.reports.plots import whiskers
from fusion_net.reports.tables import SHORT, name_of

Numbers = Mapping[str, Any]
SUBSET_COLORS = (
    "#22577a",
    "#4d9078",
    "#8fb8a8",
    "#c7a252",
    STYLES["camera"].color,
    STYLES["lidar"].color,
    STYLES["radar"].color,
)
"""Of the seven subsets, in the order of the drop table."""
KIND_COLORS = {"right": "#4d9078", "wrong": "#b23a48", "split": "#c7a252"}


def draw(audit: Audit, path: Path) -> bool:
    """Writes the audit's picture; False where there is nothing to draw."""
    if not audit.numbers or audit.name not in _DRAWN:
        return False
    figure = Figure(figsize=(10.5, 4.2), dpi=110, layout="constrained")
    _DRAWN[audit.name](figure, audit.numbers)
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
    figure.suptitle(audit.title, fontsize=10)
    figure.savefig(path)
    return True


def _calibration(figure: Figure, numbers: Numbers) -> None:
    """The share of points that fit over turns; the cross-correlations over turns, and over shifts."""
    curves = numbers["curves"]
    axes = figure.subplots(1, 2 + max(1, len(curves)))
    overlay = numbers["overlay"]
    if overlay:
        axes[0].plot(overlay["turns_deg"], 100 * np.array(overlay["by_turn"]), color="#333333")
        axes[0].axvline(overlay["turn_deg"], color="#b23a48", linewidth=1)
    _named(axes[0], "overlay", "turn of the LiDAR, degrees", "% of points on the exact depth")
    for color, (key, curve) in zip(("#22577a", "#c7a252", "#4d9078"), curves.items(), strict=False):
        pair = numbers["pairs"][key]
        axes[1].plot(curve["turns_deg"], curve["by_turn"], color=color, label=key)
        axes[1].axvline(
            pair["turn_deg"] + pair.get("usual", {}).get("turn_deg", 0.0), color=color, linewidth=1, linestyle=":"
        )
    axes[1].legend(frameon=False, fontsize=8)
    _named(axes[1], "views from above", "turn of the first sensor's view, degrees", "cross-correlation, of its maximum")
    for place, (key, curve) in zip(axes[2:], curves.items(), strict=False):
        ends = (curve["shifts"][0], curve["shifts"][-1])
        place.imshow(curve["by_shift"], origin="lower", extent=(*ends, *ends), cmap="magma", vmin=0, vmax=1)
        place.axhline(0, color="white", linewidth=0.5)
        place.axvline(0, color="white", linewidth=0.5)
        _named(place, f"{key}, turned to fit", "shift ahead, m", "shift to the left, m")


def _depth(figure: Figure, numbers: Numbers) -> None:
    """Found against true depth of the visible objects; share of cells that are off, and entropy, by range and condition."""
    scatter, bars = figure.subplots(1, 2, width_ratios=(1, 1.6))
    depths = np.array(numbers["objects"]["depths"]).reshape(-1, 2)
    scatter.plot(*depths.T, ".", color="#22577a", markersize=3, alpha=0.5)
    far = max(60.0, *depths.max(axis=0, initial=0.0))
    for ratio, style in ((1.0, "-"), (1.25, ":"), (0.8, ":")):
        scatter.plot([0, far], [0, ratio * far], style, color="#b23a48", linewidth=1)
    scatter.set(xlim=(0, 60), ylim=(0, 60))
    _named(
        scatter,
        "visible objects; dotted: 1.25 times too far, too near",
        "depth, m",
        "depth of the camera's features, m",
    )
    groups = {"all": numbers["all"], **numbers["groups"]}
    place = np.arange(len(groups))
    off = [1 - group["within_1.25^1"] for group in groups.values()]
    bars.bar(place - 0.2, off, 0.38, color="#22577a", label="share of cells that are off by more than 1.25")
    bars.bar(
        place + 0.2, [group["entropy"] for group in groups.values()], 0.38, color="#c7a252",
        label="entropy, of no knowledge",
    )  # fmt: skip
    bars.set_xticks(place, [name.replace("_", "\n") for name in groups], rotation=35)
    bars.legend(frameon=False, fontsize=8)
    _named(bars, "feature cells with a LiDAR return", "", "")


def _ablation(figure: Figure, numbers: Numbers) -> None:
    """mAP of the subsets; what each sensor is worth to the data set, to each class, and what the network listens to."""
    subsets, worth, classes, heard = figure.subplots(1, 4, width_ratios=(1.3, 0.7, 1.6, 0.7))
    rows = numbers["subsets"]
    _bars(subsets, [name_of(row["sensors"]) for row in rows], rows, SUBSET_COLORS)
    _named(subsets, "subsets of sensors", "", "mAP")
    shares = numbers["shapley"]
    named = [{"mAP": value["mAP"], "mAP_ci95": value["ci95"]} for value in shares.values()]
    colors = [STYLES[name].color for name in shares]
    _bars(worth, [STYLES[name].label for name in shares], named, colors)
    _named(worth, "Shapley values", "", "mAP")
    by_class = numbers["boxes_by_class"]
    place = np.arange(len(by_class))
    bottom = np.zeros(len(by_class))
    for name in shares:
        height = np.array([value[name] for value in by_class.values()])
        classes.bar(place, height, bottom=bottom, color=STYLES[name].color, label=STYLES[name].label)
        bottom += np.clip(height, 0, None)
    classes.set_xticks(place, [str(SHORT.get(name, name)) for name in by_class], rotation=60)
    classes.legend(frameon=False, fontsize=8)
    _named(classes, "of the score at a label, by class", "", "score")
    heard.bar(
        [STYLES[name].label for name in numbers["influence"]],
        [value["share"] for value in numbers["influence"].values()],
        color=[STYLES[name].color for name in numbers["influence"]],
    )
    _named(heard, "gradient x activation", "", "share")


def _conditions(figure: Figure, numbers: Numbers) -> None:
    """mAP of every subset by condition, range and visibility, with the number of labels."""
    kinds = ("condition", "range", "visibility")
    widths = [max(1, len(numbers[kind])) for kind in kinds]
    for axes, kind in zip(figure.subplots(1, 3, sharey=True, width_ratios=widths), kinds, strict=True):
        groups = numbers[kind]
        place = np.arange(len(groups))
        for k, color in enumerate(SUBSET_COLORS):
            row = [group["rows"][k] for group in groups]
            height = np.array([each["mAP"] for each in row])
            axes.bar(
                place + 0.12 * (k - 3), height, 0.12, color=color, label=name_of(row[0]["sensors"]) if row else None,
                yerr=whiskers(height, [each["mAP_ci95"] for each in row]), error_kw={"elinewidth": 0.6},
            )  # fmt: skip
        names = [f"{group['group'].replace('_', ' ')}\n{group['labels']}" for group in groups]
        axes.set_xticks(place, names, rotation=35)
        _named(axes, f"by {kind}; below: labels", "", "mAP" if kind == kinds[0] else "")
    figure.axes[-1].legend(frameon=False, fontsize=7, ncols=2, loc="upper left")


def _association(figure: Figure, numbers: Numbers) -> None:
    """Right pairs, wrong merges and splits over gates, as shares of the objects that both sensors have; below, from above, the
    sample of each pair of sensors in which most went wrong."""
    figure.set_size_inches(10.5, 7.6)
    pairs, gates = numbers["pairs"], numbers["gates"]
    rows = figure.subplots(2, max(1, len(pairs)), squeeze=False, height_ratios=(1, 1.3))
    for axes, ground, pair in zip(*rows, pairs, strict=False):
        shared = max(pair["shared"], 1)
        for kind, color in KIND_COLORS.items():
            axes.plot(100 * np.array(pair[kind]) / shared, ".-", color=color, label=kind)
        used = pair["best"] if numbers["gate"] is None else numbers["gate"]
        axes.axvline(gates.index(float(used)), color="#333333", linewidth=1, linestyle=":")
        axes.set_xticks(range(len(gates)), [f"{gate:g}" for gate in gates], fontsize=7, rotation=60)
        axes.legend(frameon=False, fontsize=8)
        title = f"{name_of(pair['sensors'])}: {pair['shared']} shared objects; dotted: judged"
        _named(axes, title, f"gate, {numbers['unit']}", "% of them")
        if pair["example"]:
            _draw_matches(ground, pair["example"], pair["sensors"])


def _draw_matches(axes: Axes, example: Numbers, sensors: Sequence[str]) -> None:
    """Both sensors' detections of one sample from above, x up and y to the left, and lines between what is or should be one."""
    for name, sensor, marker in zip(("first", "second"), sensors, "ox", strict=True):
        x, y = np.array(example[name]).reshape(-1, 2).T
        axes.plot(y, x, marker, color=STYLES[sensor].color, markersize=5, fillstyle="none", label=STYLES[sensor].label)
    for kind, color in KIND_COLORS.items():
        for x0, y0, x1, y1 in example[kind]:
            axes.plot([y0, y1], [x0, x1], color=color, linewidth=1.5)
    axes.invert_xaxis()
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
    counts = ", ".join(f"{len(example[kind])} {kind}" for kind in KIND_COLORS)
    _named(axes, f"where most went wrong: {counts}", "to the left, m", "ahead, m")


def _bars(axes: Axes, names: list[str], rows: list[dict[str, Any]], colors) -> None:
    height = np.array([row["mAP"] for row in rows])
    axes.bar(names, height, color=colors, yerr=whiskers(height, [row["mAP_ci95"] for row in rows]), capsize=3)
    axes.tick_params(axis="x", rotation=60)


def _named(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, fontsize=9)
    axes.set_xlabel(x, fontsize=8)
    axes.set_ylabel(y, fontsize=8)


_DRAWN: dict[str, Callable[[Figure, Numbers], None]] = {
    "calibration": _calibration,
    "depth": _depth,
    "ablation": _ablation,
    "conditions": _conditions,
    "association": _association,
}
