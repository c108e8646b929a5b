"""Claims about what each sensor is good for: the default run's drop table, and its mAP by condition."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fusion_net.reports.claims.claim import PARTLY, UNDECIDED, Claim, not_measured, verdict
from fusion_net.reports.claims.results import DEMO, Results, with_interval

EVAL = "python eval.py run=runs/demo audits=all"
WEATHER = "python eval.py run=runs/demo audits=conditions"
SAME, HARMED = 0.8, 0.67
"""Share of a sensor's mAP in clear scenes: at least that where it works, below that where it fails."""
LETTER = {"camera": "C", "LiDAR": "L", "radar": "R"}


def claims(results: Results) -> list[Claim]:
    """All of them."""
    return [*_of_the_table(results), *_of_the_weather(results)]


TABLE_CLAIMS = (
    "The union of the sensors is richer than any one or two of them",
    "The camera owns semantics: only it tells an object from its copy",
    "The LiDAR owns metric depth: without it boxes lie farther off",
    "The radar measures velocity, which the others must infer",
    "The radar is coarse in angle: it finds things and does not place them",
    "Camera alone against LiDAR (the great debate): a camera can infer what a LiDAR measures",
)


def _of_the_table(results: Results) -> list[Claim]:
    rows, doc = results.demo_rows(), results.read(DEMO, "result.json")
    if rows is None:
        return [not_measured(text, EVAL, results.shown(DEMO, "result.json")) for text in TABLE_CLAIMS]
    union, semantics, depth, velocity, angle, debate = TABLE_CLAIMS
    whole, pairs = rows["C+L+R"], [rows[name] for name in ("C+L", "C+R", "L+R")]
    best = max(pairs, key=lambda row: row["mAP"])
    alone = max((rows[name] for name in LETTER.values()), key=lambda row: row["mAP"])
    auc = {name: _decoys(doc, name) for name in ("C+L+R", "L+R", "C")}
    near = {name: np.mean([*rows[name]["AP"].values()]) for name in ("L", "R")}
    return [
        Claim(
            union, EVAL,
            f"mAP all {with_interval(whole)}, best pair {with_interval(best)}, best alone {with_interval(alone)}; one seed",
            verdict(whole["mAP_ci95"][0] > best["mAP"], whole["mAP"] > alone["mAP_ci95"][1]),
        ),
        Claim(
            semantics, EVAL,
            f"AUC of real against copy, mean over classes: all {auc['C+L+R']:.2f}, without the camera {auc['L+R']:.2f}"
            f" (0.5: a guess); one seed",
            verdict(auc["C+L+R"] > auc["L+R"] + 0.05, auc["L+R"] < 0.6),
            "By construction a copy has shape, reflectivity and radar cross-section of what it imitates.",
        ),
        Claim(
            depth, EVAL,
            f"mATE of all {whole['mATE']:.2f} m, without the LiDAR {rows['C+R']['mATE']:.2f} m, the camera alone"
            f" {rows['C']['mATE']:.2f} m; one seed",
            verdict(rows["C+R"]["mATE"] > 1.3 * whole["mATE"], rows["C"]["mATE"] > 2 * whole["mATE"]),
        ),
        Claim(
            velocity, EVAL,
            f"mAVE of all {whole['mAVE']:.1f} m/s, without the radar {rows['C+L']['mAVE']:.1f} m/s; one seed",
            verdict(rows["C+L"]["mAVE"] > 1.5 * whole["mAVE"]),
            "Only the radial part is measured; what crosses is inferred with it, too.",
        ),
        Claim(
            angle, EVAL,
            f"alone: AP {near['R']:.2f} and mATE {rows['R']['mATE']:.2f} m, the LiDAR {near['L']:.2f} and"
            f" {rows['L']['mATE']:.2f} m; one seed",
            verdict(rows["R"]["mATE"] > 1.3 * rows["L"]["mATE"], near["R"] < near["L"]),
        ),
        Claim(
            debate, EVAL,
            f"mAP of the camera alone {with_interval(rows['C'])}, the LiDAR alone {with_interval(rows['L'])}, camera and radar"
            f" {with_interval(rows['C+R'])}; one seed",
            verdict(rows["C"]["mAP"] > 0.8 * rows["L"]["mAP"]),
            "One image of 320 x 96 pixels and minutes of training; large camera-only detectors come closer.",
        ),
    ]  # fmt: skip


def _decoys(doc: dict[str, Any], sensors: str) -> float:
    """Mean AUC over the classes that have decoys."""
    from_rows = [
        row["AUC"]
        for kind in doc["decoys"]
        for row in kind["rows"]
        if "+".join(name[0].upper() for name in row["sensors"]) == sensors
    ]
    return float(np.mean(from_rows))


def _of_the_weather(results: Results) -> list[Claim]:
    """Of the lesson's table of modalities the rows night, glare and rain, snow, fog: each sensor against itself in clear
    scenes."""
    told: tuple[tuple[str, str, Sequence[str], bool], ...] = (
        ("At night the camera fails", "camera", ("night",), False),
        ("In sun glare the camera fails", "camera", ("glare",), False),
        ("Rain and fog degrade the camera", "camera", ("rain", "fog"), False),
        ("The LiDAR works in the dark", "LiDAR", ("night",), True),
        ("The LiDAR does not care about the sun", "LiDAR", ("glare",), True),
        ("Rain and fog scatter the LiDAR badly", "LiDAR", ("rain", "fog"), False),
        ("Spray scatters the LiDAR", "LiDAR", ("spray",), False),
        ("The radar works in any weather and light", "radar", ("night", "glare", "rain", "fog", "spray"), True),
    )
    audit = results.audit("conditions")
    if audit is None:
        path = results.shown(DEMO, "audits", "conditions.json")
        return [not_measured(text, WEATHER, path) for text, *_ in told]
    return [_weather(audit, text, sensor, names, works) for text, sensor, names, works in told]


def _weather(audit: dict[str, Any], text: str, sensor: str, names: Sequence[str], works: bool) -> Claim:
    groups = {group["group"]: group for group in audit["numbers"]["condition"]}
    clear = _alone(groups["clear"], sensor)
    asked = (SAME if works else HARMED) * clear["mAP"]
    judged, cells, shares = [], [], []
    for name in (name for name in names if name in groups):
        row = _alone(groups[name], sensor)
        low, high = row["mAP_ci95"]
        is_above = True if low >= asked else False if high < asked else None
        judged.append(is_above if is_above is None else is_above == works)
        cells.append(f"{name} {with_interval(row)} ({groups[name]['labels']} labels)")
        shares.append(f"{100 * row['mAP'] / max(clear['mAP'], 1e-9):.0f} % in {name}")
    measured = (
        f"mAP alone: clear {with_interval(clear)} ({groups['clear']['labels']} labels), {', '.join(cells)}; one seed"
    )
    rule = f"at least {100 * SAME:.0f} %" if works else f"less than {100 * HARMED:.0f} %"
    why = f"Left of the clear mAP: {', '.join(shares)}; asked for: {rule}, beyond the interval. Scenes and classes differ."
    return Claim(text, WEATHER, measured, _open_verdict(judged), why)


def _open_verdict(judged: Sequence[bool | None]) -> str:
    """As :func:`verdict`, of parts that may be undecided."""
    known = [part for part in judged if part is not None]
    if not known:
        return UNDECIDED
    return verdict(*known) if len(known) == len(judged) else PARTLY if any(known) else UNDECIDED


def _alone(group: dict[str, Any], sensor: str) -> dict[str, Any]:
    row: dict[str, Any] = next(
        row for row in group["rows"] if [name[0].upper() for name in row["sensors"]] == [LETTER[sensor]]
    )
    return row
