"""The page of the levels of fusion: the lesson's trade-off table with a figure in every cell, and what lies behind it."""

from collections.abc import Sequence
from typing import Any

from fusion_net.common.modalities import STYLES
from fusion_net.reports.levels.detail_tables import details
from fusion_net.reports.levels.formats import difference, figure, kilobytes, percent, share
from fusion_net.reports.levels.runs import LEVELS
from fusion_net.reports.tables import aligned, piped

LESSON = {
    "Information retained": ("most", "much", "least"),
    "Robustness to misalignment": ("fragile", "moderate", "robust"),
    "Modularity / swap a sensor": ("low", "medium", "high"),
    "Graceful dropout": ("poor", "good, if trained for it", "excellent"),
    "Compute / bandwidth": ("high", "medium", "low"),
    "Where SOTA lives": ("niche", "here", "safety backup"),
}
"""The lesson's table of trade-offs, early, mid, late."""
WHY = "What differs here from the lesson's setting, and so may change an order: [levels](../../levels.md)."
NOTES = (
    "[..]: 95 % intervals, by bootstrap over the scenes; where several seeds are compared over these too. Differences are"
    " paired: the same resampled scenes on both sides.",
    "per degree, per 10 cm: least-squares slope of mAP through the sound score, mean over the sensors and axes, one sensor"
    " turned or moved at a time. break point: where the curve has lost a tenth of the sound score.",
    "share left: mAP under a fault as a share of the sound mAP of the same scenes; over amounts, sensors and axes their mean.",
    "retrain: parameters of the modules whose input changes when that sensor sees something else, as a share of all: what has"
    " learned with the sensor. merged: bytes a frame that arrive where sensors first meet.",
    "blank: the sensor is said to be there and gives a black image or no points; stale: what it gave half a second before.",
)


def as_markdown(doc: dict[str, Any]) -> str:
    """The page that is committed."""
    lines = ["# Early, mid, late: the three levels in one table", "", *_about(doc), ""]
    lines += _missing(doc)
    lines += ["## The lesson's table of trade-offs", "", *piped(trade_offs(doc)), ""]
    lines += ["![What is left of mAP under faults](levels.png)", ""]
    lines += ["## The lesson's orders", "", *piped(orders(doc)), "", WHY, ""]
    for title, text, cells in details(doc):
        lines += [
            f"## {title}",
            "",
            *([text, ""] if text else []),
            *(piped(cells) if len(cells) > 1 else ["Not measured."]),
            "",
        ]
    return "\n".join([*lines, *(f"* {note}" for note in NOTES)]) + "\n"


def as_text(doc: dict[str, Any]) -> str:
    """The two first tables for a terminal: a line for each level, and for each claim."""
    lines = _missing(doc)
    for axis, *cells in trade_offs(doc)[1:]:
        lines += [
            axis,
            *(f"  {level:<5}  {text.replace('*', '')}" for level, text in zip(LEVELS, cells, strict=True)),
            "",
        ]
    claims = [[claim, *values, word] for claim, *values, _, word in orders(doc)]
    return "\n".join([*lines, *aligned(claims)])


def trade_offs(doc: dict[str, Any]) -> list[list[str]]:
    """Six rows, three columns: in each cell the lesson's word and what was measured."""
    makers = (_information, _misalignment, _modularity, _dropout, _compute, _state_of_the_art)
    rows = []
    for (axis, words), maker in zip(LESSON.items(), makers, strict=True):
        cells = [f"*{word}*: {maker(doc, level)}" for level, word in zip(LEVELS, words, strict=True)]
        rows.append([axis, *cells])
    return [["the lesson, and measured here", *LEVELS], *rows]


def orders(doc: dict[str, Any]) -> list[list[str]]:
    """Each claim with its figures, its pairs of neighbours and its verdict."""
    rows = [["claim", *LEVELS, "neighbours", "verdict"]]
    for each in doc["orders"]:
        values = [figure(each["values"].get(level)) for level in LEVELS]
        pairs = "; ".join(
            f"{pair['pair']} {difference(pair['difference'], pair['ci95'])}" for pair in each["pairs"][:-1]
        )
        lacking = f"no figure of {', '.join(each['missing'])}" if each["verdict"] == "not measured" else ""
        rows.append([each["claim"], *values, pairs or lacking, each["verdict"]])
    return rows


def _information(doc: dict[str, Any], level: str) -> str:
    found = [
        variant for variant in doc["information"].get("variants", ()) if variant["label"] == level and variant["n"]
    ]
    if not found:
        return "not measured"
    mAP, NDS = found[0]["mAP"]["C+L+R"], found[0]["NDS"]
    return f"mAP {figure({'value': mAP['mean'], 'ci95': mAP['ci95']})}, NDS {NDS['mean']:.3f}"


def _misalignment(doc: dict[str, Any], level: str) -> str:
    own = doc["levels"].get(level)
    if not own or own["per_degree"] is None or own["per_10cm"] is None:
        return "not measured"
    breaks = "; ".join(filter(None, (_break(own["first_break"][unit], unit) for unit in ("deg", "m"))))
    slopes = f"{own['per_degree']['value']:+.3f} mAP per degree, {own['per_10cm']['value']:+.3f} per 10 cm"
    late = f"; {share(own['left_late'])} left with a late sensor" if own["left_late"] else ""
    return f"{slopes}; breaks first: {breaks}{late}"


def _break(first: dict[str, Any] | None, unit: str) -> str:
    if first is None:
        return ""
    value = first["at"]["value"]
    return f"{first['curve']} at {value:.2g} {unit}" if value is not None else f"nothing up to {first['to']:g} {unit}"


def _modularity(doc: dict[str, Any], level: str) -> str:
    costs, own = doc["costs"].get(level), doc["levels"].get(level)
    if not costs:
        return "not measured"
    retrain = ", ".join(
        f"{STYLES[name].letter} {percent(count / costs['parameters'])}" for name, count in costs["hanging"].items()
    )
    swapped = [*(own or {}).get("swap", {}).values()]
    without = f"; another LiDAR without it {difference(swapped[0]['value'], swapped[0]['ci95'])} mAP" if swapped else ""
    return f"retrain {retrain} of the parameters{without}"


def _dropout(doc: dict[str, Any], level: str) -> str:
    own = doc["levels"].get(level, {})
    if "absent_mean" not in own:
        return "not measured"
    blank = [value["value"] for name, value in own["deaths"].items() if name.endswith("blank")]
    silent = f"; {percent(sum(blank) / len(blank))} with one silently blank" if blank else ""
    return f"{share(own['absent_mean'])} of mAP left without sensors, mean of six subsets{silent}"


def _compute(doc: dict[str, Any], level: str) -> str:
    costs = doc["costs"].get(level)
    if not costs:
        return "not measured"
    merged = sum(costs["bytes_merged"].values())
    return f"{costs['ms']['total']:.1f} ms, {kilobytes(merged) if merged else 'no'} kB merged a frame"


def _state_of_the_art(doc: dict[str, Any], level: str) -> str:
    own = doc["corruptions"].get(level)
    sound = doc["levels"].get(level)
    if not own or not sound:
        return "not measured"
    relative = "" if own["mRRA"] is None or level == "mid" else f", mRRA {percent(own['mRRA'], sign=True)}"
    return f"mRA {percent(own['mRA'])}{relative} (MultiCorrupt's, over our {len(own['RA'])} presets)"


def _missing(doc: dict[str, Any]) -> list[str]:
    lines = [*doc["gaps"], *doc["notes"]]
    return (
        [f"Missing or left out: {len(lines)}, in no figure below.", "", *(f"* {line}" for line in lines), ""]
        if lines
        else []
    )


def _about(doc: dict[str, Any]) -> Sequence[str]:
    seeds, cell_seeds = (", ".join(map(str, doc[name])) or "none" for name in ("seeds", "cell_seeds"))
    scored = doc["information"].get("scored")
    on = f"{scored['num_samples']} samples ({scored['scenes']} scenes) of {scored['split']}" if scored else "nothing"
    trained = sum(run["minutes"] or 0 for run in doc["runs"])
    count = sum(group["cells"] for group in doc["seconds"]["by_group"].values())
    commits = ", ".join(sorted({str(run["git"]) for run in doc["runs"] if run["git"]})) or "no commit"
    return [
        f"`python train.py -m +sweep=levels`, then `{doc['command']}`.",
        "",
        f"First and fourth row: seeds {seeds}, scored on {on}. Faults: seeds {cell_seeds}, scenes {doc['samples']},"
        f" {doc['labels']} labels. Training"
        f" took {trained:.0f} minutes in all, the {count} cells {doc['seconds']['total'] / 60:.0f} of processor time. Code at"
        f" {commits}.",
    ]
