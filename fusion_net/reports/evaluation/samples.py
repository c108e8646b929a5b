"""Samples to look at: the best, the worst and eight fixed ones, with what each subset of the sensors found."""

from dataclasses import dataclass

import numpy as np

from fusion_net.common.boxes import Boxes
from fusion_net.common.drawing import label
from fusion_net.common.modalities import STYLES
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.evaluation.drop_table import SUBSETS
from fusion_net.evaluation.strata import condition_of
from fusion_net.reports.evaluation.figures import Scored
from fusion_net.reports.page.charts import key
from fusion_net.reports.page.html import Cell, Html, escaped, image, section, table
from fusion_net.reports.tables import NAMES
from fusion_net.viz.picture_sheet import FOUND, LABEL, LIDAR, RADAR, draw_cameras, draw_ground, spread_evenly

FEWEST = 3
"""Labels of the best and of the worst sample, at least."""
FIXED = 8
HEIGHT, SMALL = 480, 200
"""Pixels of the ground's picture, and of that of one sensor alone."""
YES, NO = Html('<span class="yes">found</span>'), Html('<span class="no">·</span>')


@dataclass(frozen=True)
class Chosen:
    """A sample and why it is shown."""

    place: int  # in the dataset
    title: str


def samples(scored: Scored, dataset: NuScenesDataset) -> Html:
    """The section."""
    colors = [
        (LABEL, "labels"),
        (FOUND, "detections"),
        (LIDAR, "LiDAR"),
        (RADAR, "radar and half a second of its velocity"),
    ]
    shown = "".join(_show(scored, dataset, each) for each in choose(scored, dataset))
    return section(
        "Samples",
        "Left the cameras, above with labels and below with detections, right the same from above, the car's way up. Detections"
        " are those above the score of their class's best F1; the best and the worst sample are those by F1 with all sensors,"
        f" of those with {FEWEST} labels or more; the others are spread evenly over the split and the same for every run.",
        key([(text, f"rgb{color}") for color, text in colors]),
        shown,
        anchor="samples",
    )


def choose(scored: Scored, dataset: NuScenesDataset) -> list[Chosen]:
    """The samples in the order of the page."""
    place_of = {token: place for place, (_, token) in enumerate(dataset.index)}
    f1 = scored.points[0].f1_by_sample(len(scored.truth.tokens))
    count = np.bincount(scored.truth.labels.sample, minlength=len(f1))
    many = np.flatnonzero(count >= min(FEWEST, count.max(initial=0)))
    found = []
    if len(many):
        ranked = many[np.lexsort((-count[many], f1[many]))]  # of equals the one with more labels
        best = many[np.lexsort((-count[many], -f1[many]))][0]
        for title, sample in (("best", best), ("worst", ranked[0])):
            found.append(Chosen(place_of[scored.truth.tokens[sample]], f"The {title} sample, F1 {f1[sample]:.2f}"))
    fixed = spread_evenly(len(dataset), FIXED)
    return found + [Chosen(place, f"Sample {n} of {len(fixed)}") for n, place in enumerate(fixed, start=1)]


def _show(scored: Scored, dataset: NuScenesDataset, chosen: Chosen) -> str:
    sample, truth = dataset[chosen.place], scored.truth
    nusc, token = dataset.index[chosen.place]
    number = truth.tokens.index(token)
    scene = nusc.scene(token)
    found = [_above(scored, row, token) for row in range(len(SUBSETS))]
    title = f"{chosen.title}: {scene['name']}, {label(condition_of(scene, by_severity=True))}"
    cameras = draw_cameras(sample, found[0], dataset.classes)
    views = image(cameras, f"{title}: cameras with labels, and with detections", quality=78) if cameras.size else ""
    ground = image(draw_ground(sample, found[0], dataset.grid, height=HEIGHT), f"{title}: from above", quality=80)
    alone = "".join(
        f"<figure>{_ground_of(sample, found[row], dataset, row)}"
        f"<figcaption>{STYLES[SUBSETS[row][0]].label} alone</figcaption></figure>"
        for row in (4, 5, 6)
    )
    who = f"<details><summary>Every label, and who found it</summary>{_labels(scored, number)}</details>"
    return (
        f'<figure class="card shown"><h3>{escaped(title)}</h3><div class="sample"><div>{views}'
        f'<div class="film three">{alone}</div></div><div>{ground}{_counts(scored, number)}{who}</div></div></figure>'
    )


def _ground_of(sample, found: Boxes, dataset: NuScenesDataset, row: int) -> Html:
    picture = draw_ground(sample, found, dataset.grid, height=SMALL, sensors=SUBSETS[row])
    return image(picture, f"from above with {STYLES[SUBSETS[row][0]].label} alone", quality=72)


def _above(scored: Scored, row: int, token: str) -> Boxes:
    """Detections of a row above the scores of its best F1, in the ego frame."""
    boxes = scored.table.found[row][token]
    return boxes[boxes.score >= scored.points[row].threshold[boxes.label]]


def _counts(scored: Scored, number: int) -> Html:
    """How much each row found."""
    cells: list[list[Cell]] = [["found"], ["false"]]
    labels = int((scored.truth.labels.sample == number).sum())
    for point in scored.points:
        hits = int((point.labels.sample[point.label] == number).sum())
        cells[0].append(f"{hits} of {labels}")
        cells[1].append(int((point.found.sample == number).sum()) - hits)
    return table(["", *NAMES], cells)


def _labels(scored: Scored, number: int) -> Html:
    truth = scored.truth
    mine = np.flatnonzero(truth.labels.sample == number)
    labels = truth.labels[mine]
    distance = np.linalg.norm(truth.in_ego(labels)[:, :2], axis=1)
    is_found = np.stack([point.is_found[mine] for point in scored.points], axis=1)
    rows: list[list[Cell]] = [
        [label(truth.classes[labels.boxes.label[k]]), f"{distance[k]:.1f}", int(labels.num_pts[k]),
         *(YES if each else NO for each in is_found[k])]
        for k in np.argsort(distance)
    ]  # fmt: skip
    return table(["label", "m away", "points", *NAMES], rows)
