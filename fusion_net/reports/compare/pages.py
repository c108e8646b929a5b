"""Several runs side by side, as one HTML file and as Markdown."""

from collections.abc import Mapping, Sequence
from typing import Any

from fusion_net.common.cli.typed import retyped
from fusion_net.common.drawing import label
from fusion_net.common.modalities import STYLES
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.metrics.matching import TP_ERRORS
from fusion_net.reports.compare.runs import Evaluation, paired, settings_apart
from fusion_net.reports.evaluation.mistakes import WORDS
from fusion_net.reports.evaluation.run import CHARTS, read_curves, smooth
from fusion_net.reports.evaluation.scores import AXES
from fusion_net.reports.page.charts import Bar, Line, bars, key, lines
from fusion_net.reports.page.html import SERIES, Cell, Html, between, card, cards, escaped, number, page, section, table
from fusion_net.reports.tables import NAMES, UNITS, interval_text, of_scenes, piped

Runs = Sequence[Evaluation]
Value = tuple[float | None, Sequence[float] | None]
"""A figure and its interval, None where they are not known."""
Values = Mapping[str, Sequence[Value]]
"""By what a row of bars is of: the value of each run."""
ALL = NAMES[0]


def as_html(runs: Runs, command: str) -> str:
    """The page."""
    count, split = runs[0].doc["num_samples"], runs[0].doc["split"]
    few = "".join(f"<p>{escaped(note)}</p>" for note in of_scenes(runs[0].result["scored"]["scenes"]))
    legend = key([(run.label, _color(i)) for i, run in enumerate(runs)])
    parts = (
        ("Drop tables", "Bars from zero, 95 % intervals over scenes.", _drop_tables),
        ("Differences", f"mAP minus that of {runs[0].label}, on the same resamples of the scenes.", _differences),
        ("What each sensor is worth", "Shapley values of mAP, and of the AP of each class.", _worth),
        ("By class, range and condition", f"With {ALL}.", _parts),
        ("Precision and recall", f"With {ALL}, at 2 m between centres.", _curves),
        ("Heading, velocity, depth", f"Of what is found with {ALL}.", _poses),
        ("Error budget", "mAP that each would gain without one kind of mistake.", _budgets),
        ("Training", "Running means by step.", _training),
    )
    body = [
        f"<h1>{' · '.join(escaped(run.label) for run in runs)}</h1>",
        f"<p>{len(runs)} runs on the same {count} samples of the split &ldquo;{escaped(split)}&rdquo;.</p>{few}",
        f"<pre><code>{escaped(command)}</code></pre>",
        legend,
        _runs(runs),
        *(section(title, text, legend, made(runs)) for title, text, made in parts),
    ]
    return page(f"{len(runs)} runs compared", body)


def as_markdown(runs: Runs, command: str) -> str:
    """Scores, differences and settings."""
    head = ["run", *NAMES]
    scores = [[*head, "NDS"]]
    scores += [[run.label, *(number(run.row(n)["mAP"]) for n in NAMES), number(run.row(ALL)["NDS"])] for run in runs]
    text = [f"# {', '.join(run.label for run in runs)}", "", f"`{command}`", ""]
    text += [
        f"mAP on {runs[0].doc['num_samples']} samples of {runs[0].doc['split']}, NDS with {ALL}:",
        "",
        *piped(scores),
    ]
    text += ["", f"mAP minus that of `{runs[0].label}`, 95 % intervals on the same resamples of the scenes:", ""]
    text += [*piped([head, *_difference_rows(runs)]), ""]
    apart = [["setting", *(run.label for run in runs)], *([name, *values] for name, values in settings_apart(runs))]
    text += [*piped(apart), ""] if len(apart) > 1 else ["The runs differ in no setting.", ""]
    return "\n".join(text)


def _color(i: int) -> str:
    return SERIES[i % len(SERIES)]


def _chart(title: str, runs: Runs, values: Values, *, note: str = "", digits: int = 2) -> Html:
    """A card of grouped bars: in each row a bar for each run, and the figures below."""
    rows = [
        (name, [Bar(value, _color(i), ends) for i, (value, ends) in enumerate(of_runs)])
        for name, of_runs in values.items()
    ]
    figures: list[list[Cell]] = [[name, *(number(bar.value) for bar in group)] for name, group in rows]
    return card(
        title,
        bars(rows, about=f"{title}, a bar for each run", digits=digits),
        note=note,
        figures=(["", *(run.label for run in runs)], figures),
    )


def _runs(runs: Runs) -> Html:
    apart = settings_apart(runs)
    again = [[run.label, *(f"python {retyped(each['command'])}" for each in (run.result, run.doc))] for run in runs]
    rows: list[list[Cell]] = [[name, *values] for name, values in apart]
    return section(
        "What differs",
        "Settings, and what else is known of the runs; what is the same in all is left out."
        if apart
        else "Nothing that is known of them.",
        table(["", *(run.label for run in runs)], rows, "words") if apart else "",
        table(["run", "trained by", "scored by"], again, "words"),
        anchor="settings",
    )


def _drop_tables(runs: Runs) -> Html:
    of_map = {name: [(run.row(name)["mAP"], run.row(name)["mAP_ci95"]) for run in runs] for name in NAMES}
    of_nds = {name: [(run.row(name)["NDS"], None) for run in runs] for name in NAMES}
    heads = [f"{name} {UNITS[name]}" if name in UNITS else name for name in TP_ERRORS]
    rows: list[list[Cell]] = []
    for run in runs:
        row = run.row(ALL)
        errors = [number(row[name], 2) for name in TP_ERRORS]
        rows.append([run.label, number(row["mAP"]), between(row["mAP_ci95"]), number(row["NDS"]), *errors])
    charts = cards([_chart("mAP by sensors", runs, of_map), _chart("NDS by sensors", runs, of_nds)])
    return Html(charts + table([f"with {ALL}", "mAP", "95 %", "NDS", *heads], rows))


def _differences(runs: Runs) -> Html:
    rows = []
    for name in NAMES:
        found = [paired(run, runs[0], name) for run in runs[1:]]
        rows.append((name, [Bar(each["mean"], _color(i), each["ci95"]) for i, each in enumerate(found, start=1)]))
    chart = card("mAP gained or lost", bars(rows, about=f"mAP minus that of {runs[0].label}", digits=3))
    return Html(cards([chart]) + table(["run", *NAMES], _difference_rows(runs)))


def _difference_rows(runs: Runs) -> list[list[str]]:
    rows = []
    for run in runs[1:]:
        found = [paired(run, runs[0], name) for name in NAMES]
        rows.append([run.label, *(f"{each['mean']:+.3f} {interval_text(each['ci95'], '+')}" for each in found)])
    return rows


def _worth(runs: Runs) -> Html:
    found = {s: [run.figures["worth"]["mAP"][s] for run in runs] for s in MODALITIES}
    overall = {STYLES[s].label: [(each["value"], each["ci95"]) for each in of_runs] for s, of_runs in found.items()}
    parts = [_chart("mAP", runs, overall)]
    for s in MODALITIES:
        by_class = {
            label(name): [(_named(run.figures["worth"]["class"], name).get(s), None) for run in runs]
            for name in _classes(runs)
        }
        parts.append(_chart(f"AP of the classes: {STYLES[s].label}", runs, by_class))
    return cards(parts)


def _parts(runs: Runs) -> Html:
    parts = [
        _chart(
            "AP by class", runs, {label(n): [(run.row(ALL)["AP"].get(n), None) for run in runs] for n in _classes(runs)}
        )
    ]
    for axis, rows in runs[0].figures["groups"].items():
        values = {
            f"{label(row['name'])} ({row['labels']})": [_of_group(run, axis, row["name"]) for run in runs]
            for row in rows
        }
        if values:
            parts.append(_chart(f"mAP by {AXES[axis]}", runs, values, note="In brackets: labels."))
    return cards(parts)


def _classes(runs: Runs) -> list[str]:
    return list(dict.fromkeys(name for run in runs for name in run.row(ALL)["AP"]))


def _of_group(run: Evaluation, axis: str, name: str) -> Value:
    found = _named(run.figures["groups"][axis], name)
    return (found["mAP"][ALL], found["ci95"][ALL]) if found else (None, None)


def _named(rows: Sequence[Mapping[str, Any]], name: str) -> Mapping[str, Any]:
    return next((row for row in rows if row["name"] == name), {})


def _curves(runs: Runs) -> Html:
    panels = []
    for name in runs[0].figures["curves"]:
        drawn = []
        for i, run in enumerate(runs):
            points = run.figures["curves"].get(name, {}).get(ALL, [])
            drawn.append(Line(run.label, _color(i), [(j / (len(points) - 1), y) for j, y in enumerate(points)]))
        about = f"Precision by recall of {label(name)}, a line for each run"
        chart = lines(
            drawn, about=about, x_label="recall", y_label="precision", x_range=(0.0, 1.0), top=1.0, height=180
        )
        panels.append(card(label(name), chart))
    return cards(panels)


def _poses(runs: Runs) -> Html:
    whole = [next(row for row in run.figures["pose"][ALL] if row["class"] == "all") for run in runs]

    def medians(name: str) -> list[Value]:
        return [(None, None) if row[name] is None else (row[name][1], row[name][::2]) for row in whole]

    poses = {
        "axis, degrees": medians("axis_deg"),
        "moving, m/s": medians("speed_moving"),
        "standing, m/s": medians("speed_standing"),
    }
    depth = [((run.figures["depth"] or {}).get("numbers") or {"all": {}})["all"].get("abs_rel") for run in runs]
    return cards(
        [
            _chart("Turn of the axis, velocity", runs, poses, note="Medians; the whiskers hold the middle half."),
            _chart("Facing backwards", runs, {"fraction": [(row["flips"], None) for row in whole]}, digits=3),
            _chart("Depth of the camera", runs, {"abs-rel": [(each, None) for each in depth]}, digits=3),
        ]
    )


def _budgets(runs: Runs) -> Html:
    found = [{row["kind"]: (row["gain"], row["gain_ci95"]) for row in run.figures["budget"]["budget"]} for run in runs]
    values = {text: [each[kind] for each in found] for kind, text in WORDS.items()}
    return cards([_chart("mAP gained without", runs, values, digits=3)])


def _training(runs: Runs) -> Html:
    read = [read_curves(run.metrics) for run in runs]
    parts = []
    for title, y_label, series in CHARTS:
        for name, source in series.items():
            drawn = [
                Line(run.label, _color(i), smooth(curves[source]) if title != "Validation" else curves[source])
                for i, (run, curves) in enumerate(zip(runs, read, strict=True))
                if source in curves
            ]
            if drawn and title in ("Loss", "Detection losses", "Validation"):
                heading = title if len(series) == 1 else f"{title}: {name}"
                parts.append(card(heading, lines(drawn, about=f"{heading} by step", x_label="step", y_label=y_label)))
    return cards(parts)
