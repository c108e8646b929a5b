"""Sections about the audits: the camera's depth always, the others where an evaluation wrote them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fusion_net.common.drawing import label
from fusion_net.reports.audits.pages import FOLDER, read_audits
from fusion_net.reports.page.charts import Bar, bars
from fusion_net.reports.page.html import Html, card, cards, escaped, image, number, section, table

WIDEST = 1100
"""Pixels of an audit's picture on the page."""


def depth(audit: Mapping[str, Any] | None) -> Html:
    """How far the camera's depth is off, by range, condition and class. None: the network has no camera, or the split none."""
    title = "Depth of the camera"
    if audit is None or not audit["numbers"]:
        why = "Not measured: the network has no camera." if audit is None else f"Not measured: {audit['verdict']}."
        return section(title, why, anchor="depth")
    numbers = audit["numbers"]
    groups = {"all": numbers["all"]} | numbers["groups"]
    by_group = [(label(name), [Bar(row["abs_rel"], "var(--camera)")]) for name, row in groups.items()]
    classes = numbers["objects"]["by_class"]
    by_class = [(label(name), [Bar(row["mean_error"], "var(--camera)")]) for name, row in classes.items()]
    rows = [
        [label(name), row["cells"], number(row["abs_rel"]), number(row["mean_error"], 2, sign=True),
         *(f"{row[f'within_1.25^{k}']:.0%}" for k in (1, 2, 3)), number(row["entropy"], 2)]
        for name, row in groups.items()
    ]  # fmt: skip
    of_class = [
        [label(name), row["objects"], number(row["abs_rel"]), number(row["mean_error"], 2, sign=True)]
        for name, row in classes.items()
    ]
    return section(
        title,
        f"{audit['verdict'][:1].upper()}{audit['verdict'][1:]}. {audit['explanation']}",
        cards(
            [
                card("Abs-rel by range and condition", bars(by_group, about="Relative error of the camera's depth")),
                card(
                    "Range error of visible objects, m",
                    bars(by_class, about="Mean error in metres of the depth at labelled objects by class"),
                    note="Positive: taken for farther away than it is.",
                    figures=(["class", "objects", "abs-rel", "error m"], of_class),
                ),
            ]
        ),
        table(["", "cells", "abs-rel", "error m", "within 1.25", "1.25²", "1.25³", "entropy"], rows),
        anchor="depth",
    )


def audits(folder: Path) -> tuple[Html, Sequence[Mapping[str, Any]]]:
    """The section of the audits that an evaluation wrote into its folder, and what they say; nothing where there are none."""
    found = read_audits(folder)
    if not found:
        return Html(""), []
    text = "Each provokes or measures one failure that a fusion network can hide."
    return section("Audits", text, cards(_card(each, folder / FOLDER) for each in found), anchor="audits"), found


def _card(audit: Mapping[str, Any], folder: Path) -> Html:
    words = {True: '<span class="yes">ok</span>', False: '<span class="no">wrong</span>', None: "not judged"}
    picture = folder / str(audit.get("picture") or "")
    shown = ""
    if picture.is_file() and (pixels := cv2.imread(str(picture))) is not None:
        if pixels.shape[1] > WIDEST:
            height = round(pixels.shape[0] * WIDEST / pixels.shape[1])
            pixels = cv2.resize(pixels, (WIDEST, height), interpolation=cv2.INTER_AREA)
        shown = image(np.asarray(pixels[..., ::-1], np.uint8), str(audit["title"]), quality=82)
    verdict = f"<p>{words[audit['ok']]}: {escaped(audit['verdict'])}</p>"
    return card(str(audit["title"]), verdict + shown, note=str(audit["explanation"]), kind="wide")


def of_name(found: Sequence[Mapping[str, Any]], name: str) -> Mapping[str, Any] | None:
    """The audit of this name, where there is one."""
    return next((each for each in found if each["name"] == name), None)
