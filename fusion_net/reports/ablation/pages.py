"""The comparison of variants as Markdown and for a terminal."""

from collections.abc import Callable, Sequence
from typing import Any

from fusion_net.common.cli.config_files import CONFIGS
from fusion_net.reports.tables import NAMES, UNITS, aligned, interval_text, piped

NOTES = (
    "Cells: mean over seeds ± standard deviation; n: seeds with a result. mAP by sensors given at evaluation; NDS, errors and"
    " decoy AUC with every sensor that the network has. A network built for fewer sensors has its own column only.",
    "Differences: mAP minus the reference's, over the seeds that both have, with 95 % intervals by bootstrap over seeds and"
    " scenes. Intervals of two or three seeds are rather too narrow; of one seed they know nothing of seeds.",
    "decoy AUC: how often a real object scores above a copy of it, mean over classes. minutes: training, without validation.",
)
Shape = Callable[[list[list[str]]], list[str]]


def as_markdown(doc: dict[str, Any]) -> str:
    """The page that is committed."""
    title = [f"# {doc['sweep']}", "", *about(doc), ""]
    return "\n".join([*title, *_tables(doc, piped), *(f"* {note}" for note in notes(doc))]) + "\n"


def as_text(doc: dict[str, Any]) -> str:
    """The same, aligned."""
    return "\n".join([doc["sweep"], "", *_tables(doc, aligned), *notes(doc)])


def _tables(doc: dict[str, Any], shape: Shape) -> list[str]:
    lines = [*shape(scores(doc)), ""]
    if any(variant["difference"] for variant in doc["variants"]):
        lines += [f"mAP minus that of `{doc['reference']}`:", "", *shape(differences(doc)), ""]
    if without := missing(doc):
        lines += [f"Missing: {len(without)}, in no figure above.", "", *(f"* {each}" for each in without), ""]
    return lines


def missing(doc: dict[str, Any]) -> list[str]:
    """Which seeds of which variants have no result, and why."""
    return [f"{v['label']}, seed {seed}: {why}" for v in doc["variants"] for seed, why in v["missing"].items()]


def scores(doc: dict[str, Any]) -> list[list[str]]:
    """Head and rows of the table of scores."""
    columns = ["NDS", "mAOE", "mAVE", "decoy_AUC", "minutes", "steps"]
    heads = [f"{name} {UNITS[name]}" if name in UNITS else name.replace("_", " ") for name in columns]
    cells = [["variant", *shown(doc), *heads, "n"]]
    for variant in doc["variants"]:
        scores = [_mean(variant["mAP"].get(name)) for name in shown(doc)]
        figures = [_mean(variant[name], {"minutes": 1, "steps": 0}.get(name, 3)) for name in columns]
        cells.append([variant["label"], *scores, *figures, str(variant["n"])])
    return cells


def differences(doc: dict[str, Any]) -> list[list[str]]:
    """Head and rows of the table of differences."""
    cells = [["variant", *shown(doc), "n"]]
    for variant in doc["variants"]:
        found = [variant["difference"].get(name) for name in shown(doc)]
        if any(found):
            cells.append([variant["label"], *map(_change, found), str(max(each["n"] for each in found if each))])
    return cells


def shown(doc: dict[str, Any]) -> list[str]:
    """The subsets of sensors that any variant was scored with."""
    return [name for name in NAMES if any(name in variant["mAP"] for variant in doc["variants"])]


def _mean(figure: dict[str, Any] | None, digits: int = 3) -> str:
    if figure is None or figure["mean"] is None:
        return "-"
    sd = "" if figure["sd"] is None or not digits else f" ± {figure['sd']:.{digits}f}"
    return f"{figure['mean']:.{digits}f}{sd}"


def _change(difference: dict[str, Any] | None) -> str:
    if difference is None:
        return "-"
    return f"{difference['mean']:+.3f} {interval_text(difference['ci95'], '+')}"


def about(doc: dict[str, Any]) -> Sequence[str]:
    """How it was run, and on what it was scored."""
    data, hashes = doc["scored"], ", ".join(each[:12] for each in doc["scored"]["data"])
    settings = ", ".join(f"{key}={value}" for key, value in doc["settings"].items())
    is_known = (CONFIGS / "sweep" / f"{doc['sweep']}.yaml").exists()  # else it was given on the command line
    return [
        (f"`python train.py -m +sweep={doc['sweep']}`; this" if is_known else "This") + f" page: `{doc['command']}`.",
        "",
        f"Scored on {data['num_samples']} samples ({data['scenes']} scenes) of {data['split']}, data"
        f" {hashes or 'of no manifest'}. Code at {', '.join(doc['git'])}; {', '.join(doc['processor'])}."
        + (f" In all jobs: {settings}." if settings else ""),
    ]


def notes(doc: dict[str, Any]) -> list[str]:
    """How to read it, and what is amiss."""
    found = list(NOTES)
    for name, what in (("git", "commits"), ("processor", "processors")):
        if len(doc[name]) > 1:
            found.append(f"The jobs ran at several {what}: {', '.join(doc[name])}.")
    for key, values in doc["beside"].items():
        found.append(f"**The jobs differ in more than their variant**: {key} is {' and '.join(values)}.")
    return found
