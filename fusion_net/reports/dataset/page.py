"""The statistics of a data set as one HTML file that needs nothing beside it."""

import io
from collections.abc import Iterable

from matplotlib.figure import Figure

from fusion_net.common.drawing import label
from fusion_net.common.modalities import STYLES
from fusion_net.common.nuscenes_format import CLASSES, MODALITIES
from fusion_net.reports.dataset import objects, sensors
from fusion_net.reports.dataset.drawing import Drawing, draw
from fusion_net.reports.dataset.summary import Summary
from fusion_net.reports.dataset.survey import Survey
from fusion_net.reports.page.html import card, cards, escaped, facts, image, inline, page, section, table

Section = tuple[str, str, list[tuple[str, Drawing]]]

SECTIONS: list[Section] = [
    (
        "What is labelled",
        "Every box of every keyframe, the ten nuScenes detection classes.",
        [
            ("Classes", objects.classes),
            ("Where they are", objects.from_above),
            ("Distance", objects.ranges),
            ("Speed", objects.speeds),
            ("How much of them is visible", objects.visibility),
            ("How crowded it is", objects.crowd),
            ("Sizes, to scale", objects.sizes),
        ],
    ),
    (
        "Under which conditions",
        "One physical state per scene, shared by all sensors; the camera's view of it as its image's brightness and contrast.",
        [
            ("Scenes", sensors.conditions),
            ("What remains of each sensor's data in a condition", sensors.condition_effects),
            ("Images", sensors.brightness),
            ("Roads", sensors.layouts),
        ],
    ),
    (
        "What the sensors measure of an object",
        "Points and returns of the keyframe's own sweep and scans. LiDAR thins out with the square of the distance.",
        [
            ("LiDAR points of an object", sensors.lidar_points),
            ("Radar returns of an object", sensors.radar_points),
            ("Radar cross-section", sensors.rcs),
            ("Radar returns of a scan", sensors.returns),
        ],
    ),
]


def render_page(found: Survey, summary: Summary) -> str:
    """The whole page."""
    name = str(summary["root"])
    body = [
        f"<h1>{escaped(name)}</h1>",
        f"<p>{summary['scenes']:,} scenes of the split &ldquo;{escaped(summary['split'])}&rdquo; on"
        f" {_layouts(summary)}. Sensor files were opened in {summary['sensor_data']['keyframes']:,} keyframes.</p>",
        _facts(summary),
        _film(found),
    ]
    for title, text, drawings in SECTIONS:
        body.append(section(title, text, _charts(found, summary, drawings)))
    body += [
        section(
            "Compared with nuScenes",
            "Only what is published of it; its scenes are real and ours are not, so look at the shape and not at the digit.",
            table(["", "here", "nuScenes", "source"], summary["nuscenes"], "words"),
        ),
        section(
            "In figures",
            "Means over keyframes by condition, and over boxes by class.",
            table(*_condition_rows(summary)),
            table(*_class_rows(summary)),
        ),
    ]
    return page(name, body)


def _layouts(summary: Summary) -> str:
    return escaped(", ".join(f"{label(name)} ({count})" for name, count in summary["layouts"].items()))


def _facts(summary: Summary) -> str:
    channels = summary["channels"]
    tiles = [
        (f"{summary['keyframes']:,}", "keyframes"),
        (f"{summary['objects']:,}", "labelled boxes"),
        (f"{summary['objects_per_keyframe']['mean']:.1f}", "boxes per keyframe"),
        (f"{len({entry['condition'] for entry in summary['conditions']})}", "conditions"),
        (
            " + ".join(str(len(channels[name])) for name in MODALITIES),
            ", ".join(f"{STYLES[name].label}s" for name in MODALITIES),
        ),
        (_figure(summary["sensor_data"]["lidar_points"]["mean"]), "LiDAR points per sweep"),
        (_figure(summary["sensor_data"]["radar_returns_per_scan"]["mean"]), "radar returns per scan"),
    ]
    return facts(tiles)


def _film(found: Survey) -> str:
    """One image per condition and severity, the commonest condition first."""
    order = sorted(found.pictures, key=lambda kind: (-found.condition.count(kind[0]), kind))
    several = {kind[0] for kind in order if kind[1] > 1}
    shots = []
    for kind in order[:24]:
        text = label(kind[0]) + (f", severity {kind[1]}" if kind[0] in several else "")
        picture = image(found.pictures[kind], text, quality=85)
        shots.append(f"<figure>{picture}<figcaption>{escaped(text)}</figcaption></figure>")
    return f'<div class="film">{"".join(shots)}</div>'


def _charts(found: Survey, summary: Summary, drawings: Iterable[tuple[str, Drawing]]) -> str:
    drawn = []
    for title, drawing in drawings:
        size, kind = ((11.6, 1.35), "drawn wide") if drawing is objects.sizes else ((5.6, 3.3), "drawn")
        source = inline(_png(draw(drawing, found, summary, size)), "png")
        drawn.append(card(title, f'<img alt="{title}" src="{source}">', kind=kind))
    return cards(drawn, "large")


def _condition_rows(summary: Summary) -> tuple[list[str], list[list[str]]]:
    head = [
        "condition",
        "severity",
        "scenes",
        "keyframes",
        "boxes",
        "brightness",
        "contrast",
        "LiDAR points",
        "radar returns",
    ]
    names = ("brightness", "contrast", "lidar_points", "radar_returns")
    return head, [
        [
            label(entry["condition"]),
            *(f"{entry[key]:,}" for key in ("severity", "scenes", "keyframes", "objects")),
            *(_figure(entry[name]["mean"]) for name in names),
        ]
        for entry in summary["conditions"]
    ]


def _class_rows(summary: Summary) -> tuple[list[str], list[list[str]]]:
    head = [
        "class",
        "boxes",
        "moving",
        "width m",
        "length m",
        "height m",
        "LiDAR points",
        "radar returns",
        "with radar",
        "RCS dBsm",
    ]
    rows = []
    for name in CLASSES:
        entry = summary["classes"][name]
        size = [
            "-" if entry[key]["mean"] is None else f"{entry[key]['mean']:.2f} ± {entry[key]['std']:.2f}"
            for key in ("width", "length", "height")
        ]
        rows.append(
            [
                label(name), f"{entry['objects']:,}", _percent(entry["moving"]), *size,
                _figure(entry["lidar_points"]["mean"]), _figure(entry["radar_points"]["mean"], 1),
                _percent(entry["with_radar"]), _figure(entry["rcs"]["mean"], 1),
            ]
        )  # fmt: skip
    return head, rows


def _figure(value: float | None, decimals: int = 0) -> str:
    return "-" if value is None else f"{value:,.{decimals}f}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"


def _png(figure: Figure) -> bytes:
    target = io.BytesIO()
    figure.savefig(target, format="png")
    return target.getvalue()
