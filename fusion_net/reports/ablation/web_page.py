"""The comparison of variants as an HTML file, in the style of the other reports."""

from typing import Any

from fusion_net.reports.ablation.pages import about, differences, missing, notes, scores, shown
from fusion_net.reports.page.charts import Bar, bars
from fusion_net.reports.page.html import OF_SENSORS, Html, card, cards, escaped, page, section, table


def as_html(doc: dict[str, Any]) -> str:
    """The page."""
    variants = [variant for variant in doc["variants"] if variant["n"]]
    of_score = [_score(name, variants) for name in shown(doc)]
    of_difference = [_difference(name, variants) for name in shown(doc)]
    head, *rows = scores(doc)
    text = "Means over seeds; whiskers: 95 % over seeds and scenes."
    body = [
        f"<h1>{escaped(doc['sweep'])}</h1>",
        *(f"<p>{escaped(line.replace('`', ''))}</p>" for line in about(doc) if line),
        section(
            "mAP by sensors",
            "Means over seeds; whiskers: 95 % over seeds and scenes.",
            cards(of_score),
            table(head, rows),
        ),
    ]
    if any(of_difference):
        head, *rows = differences(doc)
        text = f"mAP minus that of {doc['reference']}, over the seeds that both have and the same scenes."
        body.append(section("Differences", text, cards(filter(None, of_difference)), table(head, rows)))
    if lines := missing(doc):
        body.append(section("Missing", "In no figure above.", "".join(f"<p>{escaped(line)}</p>" for line in lines)))
    body += [f"<p>{escaped(note.replace('*', ''))}</p>" for note in notes(doc)]
    return page(f"{doc['sweep']}: ablation", body)


def _score(name: str, variants: list[dict[str, Any]]) -> Html:
    rows = [
        (f"{each['label']} (n={each['n']})", [Bar(each["mAP"][name]["mean"], _color(name), each["mAP"][name]["ci95"])])
        for each in variants
        if name in each["mAP"]
    ]
    return card(name, bars(rows, about=f"mAP of each variant with {name}", digits=3))


def _difference(name: str, variants: list[dict[str, Any]]) -> Html | None:
    found = [(each["label"], each["difference"].get(name)) for each in variants]
    rows = [(label, [Bar(known["mean"], _color(name), known["ci95"])]) for label, known in found if known]
    return card(name, bars(rows, about=f"Difference of mAP with {name}", digits=3)) if rows else None


def _color(name: str) -> str:
    return OF_SENSORS[name.count("+") + 1]
