"""The tables behind the trade-offs, one a section of the page: title, text, cells with the head first."""

from collections.abc import Iterator
from typing import Any

from fusion_net.common.modalities import STYLES
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.reports.levels.formats import at, figure, kilobytes, percent, share
from fusion_net.reports.levels.runs import LEVELS
from fusion_net.reports.tables import UNITS, number

Section = tuple[str, str, list[list[str]]]
ERRORS = ("mATE", "mASE", "mAOE", "mAVE")


def details(doc: dict[str, Any]) -> Iterator[Section]:
    """All of them, in the order of the table of trade-offs."""
    yield _information(doc)
    yield _dropout(doc)
    yield _deaths(doc)
    yield _calibration(doc, "calibration", "Misalignment, for good")
    yield _calibration(doc, "shake", "Misalignment, anew in each keyframe")
    yield _clocks(doc)
    yield _speeds(doc)
    yield _corruptions(doc)
    yield from _conditions(doc)
    yield _costs(doc)
    yield _runs(doc)


def _columns(doc: dict[str, Any]) -> list[str]:
    return [level for level in LEVELS if level in doc["levels"]]


def _information(doc: dict[str, Any]) -> Section:
    head = [
        "level",
        "mAP",
        "NDS",
        *(f"{name} {UNITS[name]}" if name in UNITS else name for name in ERRORS),
        "decoy AUC",
        "seeds",
    ]
    rows = [head]
    for variant in doc["information"].get("variants", ()):
        if variant["n"]:
            score = variant["mAP"]["C+L+R"]
            spread = "" if score["sd"] is None else f" ± {score['sd']:.3f}"
            others = [number(variant[name]["mean"]) for name in ("NDS", *ERRORS, "decoy_AUC")]
            rows.append([variant["label"], f"{score['mean']:.3f}{spread}", *others, str(variant["n"])])
    return "Information: all sensors", "Mean over seeds ± standard deviation.", rows


def _dropout(doc: dict[str, Any]) -> Section:
    variants = [variant for variant in doc["information"].get("variants", ()) if variant["n"]]
    rows = [["sensors", *(variant["label"] for variant in variants)]]
    for name in variants[0]["mAP"] if variants else ():
        scores = [variant["mAP"][name] for variant in variants]
        rows.append([name, *(figure({"value": score["mean"], "ci95": score["ci95"]}) for score in scores)])
    return "Graceful dropout: sensors known to be absent", "mAP through the `present` mask.", rows


def _deaths(doc: dict[str, Any]) -> Section:
    columns = _columns(doc)
    names = list(dict.fromkeys(name for level in columns for name in doc["levels"][level]["deaths"]))
    rows = [["sensor", *columns]]
    rows += [[name, *(share(doc["levels"][level]["deaths"].get(name)) for level in columns)] for name in names]
    return "How a sensor dies", "Share of mAP left.", rows


def _calibration(doc: dict[str, Any], group: str, title: str) -> Section:
    columns = _columns(doc)
    rows = [["fault", *(f"{level}: {what}" for level in columns for what in ("slope", "break point"))]]
    for name in _curve_names(doc, group):
        is_turn = any(axis in name for axis in ("roll", "pitch", "yaw"))
        cells = []
        for level in columns:
            curve = next((each for each in doc["levels"][level]["curves"][group] if each["name"] == name), None)
            if curve is None:
                cells += ["-", "-"]
                continue
            scale = 1.0 if is_turn else 0.1
            slope = {"value": scale * curve["slope"]["value"], "ci95": [scale * end for end in curve["slope"]["ci95"]]}
            cells += [figure(slope), at(curve["break_point"], curve["amounts"][-1])]
        rows.append([name, *cells])
    text = "Slope: mAP per degree, or per 10 cm. Break point: degrees or metres at which a tenth of mAP is lost."
    return title, text if len(rows) > 1 else "", rows


def _curve_names(doc: dict[str, Any], group: str) -> list[str]:
    return list(
        dict.fromkeys(curve["name"] for level in _columns(doc) for curve in doc["levels"][level]["curves"][group])
    )


def _clocks(doc: dict[str, Any]) -> Section:
    columns = _columns(doc)
    rows = [["late sensor, compensation", "ms", *columns]]
    for name in _curve_names(doc, "clocks"):
        curves = {
            level: next((each for each in doc["levels"][level]["curves"]["clocks"] if each["name"] == name), None)
            for level in columns
        }
        amounts = next(curve["amounts"] for curve in curves.values() if curve)
        for place, amount in enumerate(amounts):
            if place:
                cells = [_point(curve, place) for curve in curves.values()]
                rows.append([name, f"{1000 * amount:g}", *cells])
    text = (
        "mAP. none: the car does not know of the delay; ego: it moves the data by its own motion; velocity: also by what the"
        " radars measure. Of a late camera only the car's own motion can be shown on recorded images."
    )
    return "Clocks", text if len(rows) > 1 else "", rows


def _point(curve: dict[str, Any] | None, place: int) -> str:
    if curve is None or place >= len(curve["mAP"]):
        return "-"
    return figure({"value": curve["mAP"][place], "ci95": [curve["low"][place], curve["high"][place]]})


def _speeds(doc: dict[str, Any]) -> Section:
    """The largest delay alone."""
    columns = _columns(doc)
    speeds = list(dict.fromkeys(name for level in columns for name in doc["levels"][level]["clocks_by_speed"]))
    names = _curve_names(doc, "clocks")
    rows = [["late sensor, compensation", *(f"{level}: {speed}" for level in columns for speed in speeds)]]
    for name in names:
        cells = []
        for level in columns:
            for speed in speeds:
                curves = doc["levels"][level]["clocks_by_speed"].get(speed, ())
                curve = next((each for each in curves if each["name"] == name), None)
                cells.append(
                    "-" if curve is None or not curve["mAP"][0] else percent(curve["mAP"][-1] / curve["mAP"][0])
                )
        rows.append([name, *cells])
    return "Clocks by the speed of the object", "Share of mAP left at the largest delay." if names else "", rows


def _corruptions(doc: dict[str, Any]) -> Section:
    columns = [level for level in LEVELS if level in doc["corruptions"]]
    rows = [
        ["preset", *(f"{level}: RA" for level in columns), *(f"{level}: RRA" for level in columns if level != "mid")]
    ]
    names = list(dict.fromkeys(name for level in columns for name in doc["corruptions"][level]["RA"]))
    for name in names:
        own = [doc["corruptions"][level]["RA"].get(name) for level in columns]
        relative = [doc["corruptions"][level]["RRA"].get(name) for level in columns if level != "mid"]
        rows.append(
            [
                name,
                *("-" if each is None else percent(each) for each in own),
                *("-" if each is None else percent(each, sign=True) for each in relative),
            ]
        )
    text = "MultiCorrupt's figures on NDS, radar included. RA: NDS as a share of the sound one; RRA: against mid."
    return "Corruptions", text if names else "", rows


def _conditions(doc: dict[str, Any]) -> Iterator[Section]:
    columns = [level for level in LEVELS if doc["conditions"].get(level)]
    if not columns:
        yield "Conditions", "", [["condition"]]
        return
    for part in doc["conditions"][columns[0]]:
        rows = [
            [part, "labels", *columns, *(f"{level}: {STYLES[name].label}" for level in columns for name in MODALITIES)]
        ]
        for group, row in doc["conditions"][columns[0]][part].items():
            own = [doc["conditions"][level][part][group] for level in columns]
            whole = [figure({"value": each["mAP"]["C+L+R"], "ci95": each["ci95"]}) for each in own]
            alone = [number(each["mAP"][STYLES[name].letter]) for each in own for name in MODALITIES]
            rows.append([group, str(row["labels"]), *whole, *alone])
        yield f"By {part}", "mAP over the classes that have a label there; sensors alone in the last columns.", rows


def _costs(doc: dict[str, Any]) -> Section:
    columns = [level for level in LEVELS if level in doc["costs"]]
    costs = {level: doc["costs"][level] for level in columns}
    rows = [["a frame", *columns]]
    for stage in dict.fromkeys(name for own in costs.values() for name in own["ms"]):
        rows.append(
            [f"{stage}, ms", *(f"{own['ms'][stage]:.2f}" if stage in own["ms"] else "-" for own in costs.values())]
        )
    for key, what in (("bytes_in", "given by"), ("bytes_merged", "merged from")):
        for name in dict.fromkeys(name for own in costs.values() for name in own[key]):
            rows.append(
                [
                    f"{what} {name}, kB",
                    *(kilobytes(own[key][name]) if name in own[key] else "-" for own in costs.values()),
                ]
            )
    for name in MODALITIES:
        rows.append(
            [
                f"retrain for another {name}",
                *(percent(own["hanging"][name] / own["parameters"]) for own in costs.values()),
            ]
        )
    rows.append(["parameters", *(f"{own['parameters']:,}" for own in costs.values())])
    text = "Milliseconds of processor time, in batches of eight; kB of 1000 bytes; parameters to retrain as a share of all."
    return (
        "Compute and bandwidth",
        text if columns else "",
        rows,
    )


def _runs(doc: dict[str, Any]) -> Section:
    rows = [["level", "seed", "run", "steps", "minutes of training", "commit"]]
    for run in doc["runs"]:
        rows.append(
            [
                run["level"],
                str(run["seed"]),
                run["run"],
                *(str(run[name] if run[name] is not None else "-") for name in ("steps", "minutes", "git")),
            ]
        )
    return "Runs", "", rows
