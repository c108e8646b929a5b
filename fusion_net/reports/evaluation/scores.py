"""Sections about scores: the drop table, what each sensor is worth and for what, curves, groups of labels."""

from collections.abc import Mapping, Sequence
from typing import Any

from fusion_net.common.drawing import label
from fusion_net.common.modalities import STYLES
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.drop_table import SUBSETS
from fusion_net.metrics.matching import TP_ERRORS
from fusion_net.reports.page.charts import Bar, Line, bars, key, lines
from fusion_net.reports.page.html import OF_SENSORS, Cell, Heat, Html, between, card, cards, number, section, table
from fusion_net.reports.tables import NAMES, UNITS, name_of

FOUR = (NAMES[0], *NAMES[4:])
"""All sensors, and each alone: the rows that a chart of lines has room for."""
COLOR_OF = {name_of(subset): OF_SENSORS[len(subset)] for subset in SUBSETS}
COLOR_OF_LINE = {NAMES[0]: "var(--ink)", "C": "var(--camera)", "L": "var(--lidar)", "R": "var(--radar)"}
AXES = {"range": "distance from the car", "condition": "condition", "visibility": "visible part"}


def drop_table(doc: Mapping[str, Any]) -> Html:
    """The seven rows and the random guess, as bars and as tables."""
    rows = [*doc["rows"], doc["random"]]
    of_map = [
        (name_of(row["sensors"]), [Bar(row["mAP"], OF_SENSORS[len(row["sensors"])], row["mAP_ci95"])]) for row in rows
    ]
    of_nds = [(name_of(row["sensors"]), [Bar(row["NDS"], OF_SENSORS[len(row["sensors"])])]) for row in rows]
    loss = [
        (
            f"without {_rest(row['sensors'])}",
            [Bar(row["delta_mAP"], COLOR_OF[name_of(row["sensors"])], row["delta_mAP_ci95"])],
        )
        for row in doc["rows"][1:]
    ]
    heads = [f"{name} {UNITS[name]}" if name in UNITS else name for name in TP_ERRORS]
    scores = [
        [name_of(row["sensors"]), number(row["mAP"]), between(row["mAP_ci95"]), number(row["NDS"]),
         *(number(row[name], 2) for name in TP_ERRORS), number(row["mAP_official"]), number(row["NDS_official"]),
         f"{row['ms_per_sample']:.1f}" if row["sensors"] else None]
        for row in rows
    ]  # fmt: skip
    count = doc["rows"][0]["num_gt"]
    by_class: list[list[Cell]] = [
        [name_of(row["sensors"]), *(Heat(value) for value in row["AP"].values())] for row in rows
    ]
    by_class.append(["labels", *count.values()])
    delta = [[text, number(bar.value, sign=True), between(bar.interval, sign=True)] for text, (bar,) in loss]
    return section(
        "Drop table",
        "One network, scored with every subset of its sensors. C camera, L LiDAR, R radar; bars from zero, whiskers are 95 %"
        " intervals over scenes; random: boxes of the labels' own classes and sizes at random places.",
        cards(
            [
                card(
                    "mAP by sensors", bars(of_map, about="mAP of each subset of sensors, with 95 % intervals", digits=3)
                ),
                card(
                    "mAP lost without a sensor",
                    bars(loss, about="mAP of each subset minus that of all sensors", digits=3),
                    note="The difference from all sensors, on the same resamples of the scenes.",
                    figures=(["", "mAP", "95 %"], delta),
                ),
                card("NDS by sensors", bars(of_nds, about="NDS of each subset of sensors", digits=3)),
            ]
        ),
        table(["sensors", "mAP", "95 %", "NDS", *heads, "official mAP", "NDS", "ms"], scores),
        table(["AP", *map(label, count)], by_class),
        anchor="drop-table",
    )


def worth(figures: Mapping[str, Any]) -> Html:
    """The Shapley value of each sensor, and for which classes, ranges and conditions."""
    found = figures["worth"]
    overall = [
        (STYLES[s].label, [Bar(found["mAP"][s]["value"], f"var(--{s})", found["mAP"][s]["ci95"])]) for s in MODALITIES
    ]
    parts = [
        card(
            "Share of mAP",
            bars(overall, about="Shapley value of each sensor with its 95 % interval", digits=3),
            note="The three add up to the mAP of all sensors.",
            figures=(
                ["sensor", "mAP", "95 %"],
                [
                    [STYLES[s].label, number(found["mAP"][s]["value"]), between(found["mAP"][s]["ci95"])]
                    for s in MODALITIES
                ],
            ),
        )
    ]
    titles = {"class": "For which classes", "range": "At which range", "condition": "Under which conditions"}
    for axis, title in titles.items():
        parts.append(_worth_of(title, found[axis]))
    return section(
        "What each sensor is worth",
        "The exact Shapley value: a sensor's gain, averaged over all orders in which the three could be switched on, from the"
        " seven rows of the drop table. Two sensors that see the same share what they see. Below zero: the network does worse"
        " for having it.",
        cards(parts),
        anchor="worth",
    )


def _worth_of(title: str, rows: Sequence[Mapping[str, Any]]) -> Html:
    chart = [
        (label(row["name"]), [Bar(row[s], f"var(--{s})", row.get(f"{s}_ci95")) for s in MODALITIES]) for row in rows
    ]
    return card(
        title,
        key([(STYLES[s].label, f"var(--{s})") for s in MODALITIES])
        + bars(chart, about=f"Shapley value of each sensor, {title.lower()}"),
        figures=(
            ["", *(STYLES[s].label for s in MODALITIES), "labels"],
            [[label(row["name"]), *(number(row[s]) for s in MODALITIES), row["labels"]] for row in rows],
        ),
    )


def curves(figures: Mapping[str, Any], doc: Mapping[str, Any]) -> Html:
    """A panel for each class."""
    count = doc["rows"][0]["num_gt"]
    ap = {name_of(row["sensors"]): row["AP"] for row in doc["rows"]}
    panels = []
    for name, of_row in figures["curves"].items():
        recall = [i / (len(of_row[NAMES[0]]) - 1) for i in range(len(of_row[NAMES[0]]))]
        drawn = [Line(row, COLOR_OF_LINE[row], list(zip(recall, of_row[row], strict=True))) for row in FOUR]
        text = ", ".join(f"{row} {ap[row][name]:.2f}" for row in FOUR)
        chart = lines(
            drawn, about=f"Precision by recall of {label(name)}", x_label="recall", y_label="precision",
            x_range=(0.0, 1.0), top=1.0, height=180,
        )  # fmt: skip
        panels.append(card(f"{label(name)}, {count[name]} labels", chart, note=f"AP {text}"))
    return section(
        "Precision and recall",
        "With all sensors and with each alone, at 2 m between centres. A line ends at the recall that is reached. AP is the"
        " mean over 0.5, 1, 2 and 4 m.",
        key([(row, COLOR_OF_LINE[row]) for row in FOUR]),
        cards(panels),
        anchor="curves",
    )


def groups(figures: Mapping[str, Any]) -> Html:
    """mAP by range, condition and visibility of every row."""
    parts, tables = [], []
    for axis, rows in figures["groups"].items():
        if not rows:
            continue
        chart = [
            (label(each["name"]), [Bar(each["mAP"][row], COLOR_OF_LINE[row], each["ci95"][row]) for row in FOUR])
            for each in rows
        ]
        about = f"mAP by {AXES[axis]} with all sensors and with each alone"
        parts.append(card(f"By {AXES[axis]}", bars(chart, about=about)))
        tables.append(
            table(
                [AXES[axis], "labels", *NAMES, f"95 % of {NAMES[0]}"],
                [
                    [label(each["name"]), each["labels"], *(Heat(each["mAP"][row]) for row in NAMES),
                     between(each["ci95"][NAMES[0]], 2)]
                    for each in rows
                ],
            )
        )  # fmt: skip
    of_class = {name: None for each in figures["groups"]["range"] for name in each["AP"]}
    by_range = [
        [label(each["name"]), *(Heat(each["AP"][name]) if name in each["AP"] else None for name in of_class)]
        for axis in ("range", "condition")
        for each in figures["groups"][axis]
    ]
    return section(
        "By range, condition and visibility",
        "mAP over the classes that have a label there. A detection counts where the label is that it takes, a false alarm where"
        " it lies; since nobody knows how visible it would be, in every group of visibility.",
        key([(row, COLOR_OF_LINE[row]) for row in FOUR]),
        cards(parts),
        *tables,
        table([f"AP with {NAMES[0]}", *map(label, of_class)], by_range),
        anchor="groups",
    )


def _rest(sensors: Sequence[str]) -> str:
    return ", ".join(STYLES[name].letter for name in MODALITIES if name not in sensors)
