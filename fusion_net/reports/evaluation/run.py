"""Sections about the run itself: what it was and how to run it again, its training, its settings."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from fusion_net.common.cli.typed import retyped
from fusion_net.reports.page.charts import Line, key, lines
from fusion_net.reports.page.html import SERIES, Html, between, card, cards, escaped, facts, number, section, table
from fusion_net.reports.tables import NOTES, name_of

Curves = Mapping[str, list[tuple[int, float]]]
CHARTS: tuple[tuple[str, str, Mapping[str, str]], ...] = (
    ("Loss", "weighted sum", {"all": "train/loss"}),
    ("Detection losses", "weighted", {n: f"train/loss/{n}" for n in ("heatmap", "offset", "size", "rot", "velocity")}),
    ("Camera's dense losses", "weighted", {n: f"train/loss/{n}" for n in ("depth", "log_depth", "classes")}),
    (
        "Gradient norm",
        "of the weights",
        {n: f"train/gradient_norm_{n}" for n in ("camera", "lidar", "radar", "rest")},
    ),
    ("Learning rate", "", {"rate": "train/learning_rate"}),
    ("Validation", "all sensors", {"mAP": "val/mAP", "NDS": "val/NDS"}),
)
"""Title, y axis and series of each training chart; series that a run has not are left out."""
SMOOTHED = 5
"""Rows of metrics.csv over which a training curve is averaged: 100 steps."""


def what_was_run(doc: Mapping[str, Any], result: Mapping[str, Any]) -> Html:
    """Figures at a glance, the commands, and what the result depends on. ``doc``: the drop table; ``result``: as
    :mod:`fusion_net.reports.run_result` keeps it."""
    first, scored = doc["rows"][0], result["scored"]
    ends = f", 95 %: {between(first['mAP_ci95'])}" if first["mAP_ci95"] else ""
    tiles = [
        (f"{first['mAP']:.3f}", f"mAP with {name_of(first['sensors'])}{ends}"),
        (f"{first['NDS']:.3f}", "NDS"),
        (f"{scored['num_samples']:,}", f"samples of {scored['scenes']} scenes"),
        (f"{sum(first['num_gt'].values()):,}", "labels that count"),
        (f"{result['steps']:,}" if result.get("steps") else "–", "training steps"),
        (number(result.get("minutes"), 1), "minutes of training"),
    ]
    fault = doc.get("fault")
    rows = [
        ["scored", f"split {doc['split']}, checkpoint {scored['checkpoint']}"],
        ["data", ", ".join(each[:12] or "of no manifest" for each in scored["data"])],
        ["fault", f"{fault['name']}, severity {fault['severity']}" if fault else "none"],
        ["sensors of the network", name_of(result["encoders"])],
        ["seed", result["seed"]],
        ["code", f"trained at {result.get('git') or '–'}, scored at {doc['git'] or '–'}"],
        ["processor", f"{result.get('processor') or '–'}, {result.get('threads') or '–'} threads of torch"],
        ["torch", result.get("torch")],
    ]
    notes = "".join(f"<p>{escaped(note)}</p>" for note in doc["notes"] if note not in NOTES)
    return Html(
        f"{facts(tiles)}{notes}"
        + section(
            "What was run",
            "To run it again, in a checkout of the same code:",
            f"<pre><code>{escaped(chr(10).join(commands_again(doc, result)))}</code></pre>",
            table(["", ""], rows, "words"),
            anchor="run",
        )
    )


def commands_again(doc: Mapping[str, Any], result: Mapping[str, Any]) -> list[str]:
    """What to type to get the same scores: the data, the training, the evaluation. Shipped weights are scored without training
    them, which comes last. What was recorded by no command is said in a comment."""
    scored = result["scored"]
    made_by = (scored.get("made_by") or {}) | (result.get("made_by") or {})  # older runs did not note it
    training = [*_making(result.get("data") or [], made_by)]
    training += [f"python {retyped(result['command'])}"] if result.get("command") else []
    scoring = [*_making(scored["data"], scored.get("made_by") or {}), f"python {retyped(doc['command'])}"]
    if scored["checkpoint"].endswith(".pt"):
        return [*scoring, "# these weights were trained by:", *training]
    return list(dict.fromkeys([*training, *scoring]))


def _making(data: Sequence[str], made_by: Mapping[str, str]) -> Iterator[str]:
    """The command of each data set by its fingerprint, which a recorded one has not."""
    for each in data:
        if each:
            yield (
                made_by.get(each)
                or f"# here the data of manifest {each[:12]}, which is not known to be made by any command"
            )


def read_curves(path: Path) -> Curves:
    """The series of a metrics.csv, by name; {} where there is none."""
    found: dict[str, list[tuple[int, float]]] = {}
    if path.exists():
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                found.setdefault(row["name"], []).append((int(row["step"]), float(row["value"])))
    return found


def training(curves: Curves) -> Html:
    """The training curves."""
    parts = []
    for title, y_label, series in CHARTS:
        known = {name: curves[source] for name, source in series.items() if source in curves}
        if not known:
            continue
        drawn = [
            Line(name, SERIES[i], smooth(points) if title != "Validation" else points)
            for i, (name, points) in enumerate(known.items())
        ]
        legend = key([(line.name, line.color) for line in drawn]) if len(drawn) > 1 else ""
        parts.append(card(title, legend + lines(drawn, about=f"{title} by step", x_label="step", y_label=y_label)))
    text = (
        f"Means over {SMOOTHED * 20} steps. Steps of the camera alone come first."
        if parts
        else "Shipped weights and runs that were not trained here have none."
    )
    return section("Training", text, cards(parts), anchor="training")


def settings(changed: Mapping[str, Any]) -> Html:
    """In what the run differs from the default."""
    rows = [[key, str(value)] for key, value in changed.items()]
    if not rows:
        return section("Settings", "Those of the default, python train.py, in everything.", anchor="settings")
    text = "Settings that differ from the default's, python train.py; seed and place of the data apart."
    return section("Settings", text, table(["key", "value"], rows, "words"), anchor="settings")


def smooth(points: list[tuple[int, float]]) -> list[tuple[float, float | None]]:
    """Running means over SMOOTHED rows."""
    smoothed: list[tuple[float, float | None]] = []
    for i in range(len(points)):
        part = [value for _, value in points[max(0, i - SMOOTHED + 1) : i + 1]]
        smoothed.append((points[i][0], sum(part) / len(part)))
    return smoothed
