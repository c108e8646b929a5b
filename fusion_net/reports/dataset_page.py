"""The statistics of a data set as one HTML file that needs nothing beside it."""

import base64
import html
import io
from collections.abc import Iterable

import cv2
import numpy as np
from matplotlib.figure import Figure

from fusion_net.common.drawing import label
from fusion_net.common.modalities import STYLES
from fusion_net.common.nuscenes_format import CLASSES, MODALITIES
from fusion_net.reports import dataset_page_objects as objects
from fusion_net.reports import dataset_page_sensors as sensors
from fusion_net.reports.dataset_page_style import Drawing, draw
from fusion_net.reports.dataset_summary import Summary
from fusion_net.reports.dataset_survey import Survey

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
STYLE = """
:root { --ink: #22252a; --soft: #6b7075; --line: #e3e2dc; --paper: #f7f6f2; --accent: #2f6690; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 36px 24px 64px; }
h1 { font-size: 30px; margin: 0; letter-spacing: -0.3px; } h2 { font-size: 20px; margin: 44px 0 2px; }
p { color: var(--soft); margin: 4px 0 16px; max-width: 75ch; }
.facts { display: grid; grid-template-columns: repeat(7, 1fr); gap: 10px; margin: 22px 0 26px; }
.fact { background: white; border: 1px solid var(--line); border-radius: 10px; padding: 11px 14px; }
.fact b { display: block; font-size: 24px; white-space: nowrap; font-weight: 650; color: var(--accent); }
.fact span { color: var(--soft); font-size: 13px; }
.film { display: grid; grid-template-columns: repeat(4, 1fr); gap: 10px; }
.film figure { margin: 0; background: white; border: 1px solid var(--line); border-radius: 10px; overflow: hidden; }
.film img { width: 100%; display: block; } .film figcaption { padding: 5px 10px 7px; font-size: 13px; color: var(--soft); }
.charts { display: grid; grid-template-columns: 1fr 1fr; gap: 16px; }
.chart { background: white; border: 1px solid var(--line); border-radius: 10px; padding: 12px 14px 6px; }
.wide { grid-column: 1 / -1; }
.chart h3 { font-size: 14px; margin: 0 0 6px; } .chart img { width: 100%; }
table { border-collapse: collapse; width: 100%; background: white; border: 1px solid var(--line); font-size: 13.5px; }
th, td { padding: 6px 12px; text-align: right; border-top: 1px solid var(--line); font-variant-numeric: tabular-nums; }
th { color: var(--soft); font-weight: 600; border-top: 0; } th:first-child, td:first-child { text-align: left; }
.words td, .words th { text-align: left; }
@media (max-width: 820px) { .charts { grid-template-columns: 1fr; } .film { grid-template-columns: 1fr 1fr; }
  .facts { grid-template-columns: repeat(3, 1fr); } }
"""


def render_page(found: Survey, summary: Summary) -> str:
    """The whole page."""
    name = html.escape(str(summary["root"]))
    body = [
        f"<h1>{name}</h1>",
        f"<p>{summary['scenes']:,} scenes of the split &ldquo;{html.escape(summary['split'])}&rdquo; on"
        f" {_layouts(summary)}. Sensor files were opened in {summary['sensor_data']['keyframes']:,} keyframes.</p>",
        _facts(summary),
        _film(found),
    ]
    for title, text, drawings in SECTIONS:
        body += [f"<h2>{title}</h2><p>{text}</p>", _charts(found, summary, drawings)]
    body += [
        "<h2>Compared with nuScenes</h2><p>Only what is published of it; its scenes are real and ours are not, so look at the"
        " shape and not at the digit.</p>",
        _table(["", "here", "nuScenes", "source"], summary["nuscenes"], "words"),
        "<h2>In figures</h2><p>Means over keyframes by condition, and over boxes by class.</p>",
        _table(*_condition_rows(summary)),
        "<br>",
        _table(*_class_rows(summary)),
    ]
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{name}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head>'
        f"<body><main>{''.join(body)}</main></body></html>\n"
    )


def _layouts(summary: Summary) -> str:
    return html.escape(", ".join(f"{label(name)} ({count})" for name, count in summary["layouts"].items()))


def _facts(summary: Summary) -> str:
    channels = summary["channels"]
    facts = [
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
    return f'<div class="facts">{"".join(f"<div class=fact><b>{a}</b><span>{b}</span></div>" for a, b in facts)}</div>'


def _film(found: Survey) -> str:
    """One image per condition and severity, the commonest condition first."""
    order = sorted(found.pictures, key=lambda kind: (-found.condition.count(kind[0]), kind))
    several = {kind[0] for kind in order if kind[1] > 1}
    shots = []
    for kind in order[:24]:
        text = label(kind[0]) + (f", severity {kind[1]}" if kind[0] in several else "")
        shots.append(
            f'<figure><img alt="" src="{_inline(_jpeg(found.pictures[kind]), "jpeg")}">'
            f"<figcaption>{html.escape(text)}</figcaption></figure>"
        )
    return f'<div class="film">{"".join(shots)}</div>'


def _charts(found: Survey, summary: Summary, drawings: Iterable[tuple[str, Drawing]]) -> str:
    cards = []
    for title, drawing in drawings:
        size, kind = ((11.6, 1.35), "chart wide") if drawing is objects.sizes else ((5.6, 3.3), "chart")
        source = _inline(_png(draw(drawing, found, summary, size)), "png")
        cards.append(f'<div class="{kind}"><h3>{title}</h3><img alt="{title}" src="{source}"></div>')
    return f'<div class="charts">{"".join(cards)}</div>'


def _table(head: list[str], rows: list[list[str]], kind: str = "") -> str:
    lines = ["".join(f"<th>{html.escape(cell)}</th>" for cell in head)]
    lines += ["".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in rows]
    return f'<table class="{kind}">{"".join(f"<tr>{line}</tr>" for line in lines)}</table>'


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


def _jpeg(image: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()


def _inline(data: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
