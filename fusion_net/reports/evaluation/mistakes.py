"""Sections about what goes wrong: confusions, headings and velocities, depth, and what each kind of mistake costs."""

from collections.abc import Mapping
from typing import Any

from fusion_net.common.drawing import label
from fusion_net.reports.evaluation.scores import COLOR_OF
from fusion_net.reports.page.charts import Bar, bars
from fusion_net.reports.page.html import Cell, Heat, Html, between, card, cards, number, section, table
from fusion_net.reports.tables import NAMES

SHORT = {"construction_vehicle": "constr.", "traffic_cone": "cone", "motorcycle": "motorc.", "pedestrian": "person"}
WORDS = {
    "class": "wrong class",
    "place": "wrong place",
    "duplicate": "duplicate",
    "decoy": "at a decoy",
    "background": "background",
    "miss": "missed",
}


def confusions(figures: Mapping[str, Any]) -> Html:
    """Labels by what they are taken for; decoys and the background likewise."""
    found = figures["confusion"]
    rows: list[list[Any]] = []
    for name, row in zip(found["classes"], found["labels"], strict=True):
        rows.append([label(name), row["count"], *_shares(row), _share(row["missed"], row["count"])])
    for name, row in found["decoys"].items():
        rows.append([f"decoy of {label(name)}", row["count"], *_shares(row), _share(row["missed"], row["count"])])
    rows.append(["nothing there", None, *found["background"], None])
    return section(
        "Confusions",
        "What labels, and bodies that imitate them, are taken for with all sensors: detections above the score of their class's"
        " best F1, within 2 m. Of each row the fraction; nothing there: how many detections meet no label or decoy that was not"
        " taken before. The rightmost is right for a decoy.",
        table(["is \\ is taken for", "number", *(SHORT.get(n, label(n)) for n in found["classes"]), "nothing"], rows),
        anchor="confusions",
    )


def _shares(row: Mapping[str, Any]) -> list[Heat | None]:
    return [_share(value, row["count"]) for value in row["found"]]


def _share(value: int, count: int) -> Heat | None:
    return Heat(value / count, f"{value / count:.2f}" if value else "") if count else None


def poses(figures: Mapping[str, Any]) -> Html:
    """Heading and velocity of what is found."""
    rows = [row for row in figures["pose"][NAMES[0]] if row["class"] != "all"]
    whole = {name: next(row for row in figures["pose"][name] if row["class"] == "all") for name in NAMES}
    accent = "var(--accent)"
    parts = [
        card(
            "Turn of the axis, degrees",
            bars([(label(r["class"]), [_median(r["axis_deg"], accent)]) for r in rows if r["axis_deg"]],
                 about="Median error of the axis of a box by class", digits=1),
            note="Front and back alike: from 0 to 90. Median; the whisker holds the middle half of the boxes.",
        ),
        card(
            "Facing backwards",
            bars([(label(r["class"]), [Bar(r["flips"], "var(--bad)", text=f"{r['flips']:.0%}")])
                  for r in rows if r["flips"] is not None],
                 about="Fraction of boxes that are turned by more than 90 degrees, by class", top=0.5),
            note="Of the boxes found, those turned by more than 90 degrees. 50 %: the front is guessed.",
        ),
        card(
            "Velocity of what moves, m/s",
            bars([(label(r["class"]), [_median(r["speed_moving"], accent)]) for r in rows if r["speed_moving"]],
                 about="Median error of the velocity vector of moving objects by class"),
            note="Length of the error of the vector; labels faster than 0.5 m/s. Median and middle half.",
        ),
        card(
            "Velocity of what moves, by sensors",
            bars([(name, [_median(whole[name]["speed_moving"], COLOR_OF[name])]) for name in NAMES],
                 about="Median error of the velocity vector of moving objects by sensors"),
            note="Each row over what it finds itself: a row that finds only what is easy may look good.",
        ),
    ]  # fmt: skip
    head = [
        "",
        "found",
        "axis °",
        "middle half",
        "backwards",
        "moving",
        "velocity m/s",
        "middle half",
        "of what stands",
    ]
    cells = [_pose_row(label(row["class"]), row) for row in rows]
    cells += [_pose_row(f"all, {name}", whole[name]) for name in NAMES]
    return section(
        "Heading and velocity",
        "Of detections above the score of their class's best F1 that take a label within 2 m. The error of the axis and the"
        " boxes that face backwards are apart: their mean (mAOE) tells neither.",
        cards(parts),
        table(head, cells),
        anchor="poses",
    )


def _median(quartiles: list[float] | None, color: str) -> Bar:
    return Bar(None, color) if quartiles is None else Bar(quartiles[1], color, quartiles[::2])


def _pose_row(name: str, row: Mapping[str, Any]) -> list[Any]:
    flips = None if row["flips"] is None else f"{row['flips']:.1%}"
    axis, moving, standing = (row[key] or [None] * 3 for key in ("axis_deg", "speed_moving", "speed_standing"))
    return [
        name, row["pairs"], number(axis[1], 1), _half(axis, 1), flips, row["moving"], number(moving[1], 2),
        _half(moving, 2), number(standing[1], 2),
    ]  # fmt: skip


def _half(quartiles: list[float], digits: int) -> str:
    return "–" if quartiles[0] is None else between((quartiles[0], quartiles[2]), digits)


def budget(figures: Mapping[str, Any]) -> Html:
    """What mAP would gain without each kind of mistake."""
    found = figures["budget"]
    chart = [
        (WORDS[row["kind"]], [Bar(row["gain"], "var(--bad)", row["gain_ci95"], f"+{row['gain']:.3f}")])
        for row in found["budget"]
    ]
    classes = list(found["budget"][0]["AP"])
    rows: list[list[Cell]] = [
        [WORDS[row["kind"]], number(row["gain"], sign=True), between(row["gain_ci95"]), number(found["mAP"] + row["gain"]),
         *(Heat(row["AP"][name], f"{row['AP'][name]:+.2f}", 2 * row["AP"][name]) for name in classes)]
        for row in found["budget"]
    ]  # fmt: skip
    return section(
        "Error budget",
        f"What mAP ({found['mAP']:.3f} with all sensors) would gain if the mistakes of one kind were put right and nothing"
        " else. The parts need not sum up to what is missing, for AP is no sum. TIDE (Bolya et al. 2020, arXiv 2008.08115), by"
        " distance of centres in place of IoU: a wrong place is less than 4 m, or twice the threshold, off a label that"
        " nothing else takes.",
        cards(
            [
                card(
                    "mAP gained without",
                    bars(chart, about="mAP gained without each kind of mistake, with 95 % intervals"),
                )
            ]
        ),
        table(["without", "mAP", "95 %", "then mAP", *(SHORT.get(n, label(n)) for n in classes)], rows),
        anchor="budget",
    )
