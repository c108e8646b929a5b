"""The merge point: what has been computed, and how much is handed over, before the sensors meet."""

from fusion_lab.engine.answers import Answer
from fusion_lab.views.content import Content, svg, table, text
from fusion_net.common.nuscenes_format import MODALITIES

BOX_NUMBERS = 12
"""Of a box: place, size, heading, velocity, class, score, two variances; four bytes each."""
FLOAT = 4
STAGES = ("raw data", "features", "boxes")
AT = {"early": 0, "mid": 1, "late": 2}
MEANING = {
    "early": "The most information, all of which has to lie on the right pixel: the least tolerant of a wrong calibration.",
    "mid": "Maps in one grid: small errors blur instead of mixing things up, and a missing sensor leaves zeros.",
    "late": "A few numbers for each object: sensors can be exchanged or lost, but what none of them dared to say is gone.",
}


def content(answer: Answer) -> Content:
    """The pipeline with the chosen merge point, and its figures, measured in this run."""
    ms, kilobytes = milliseconds(answer), sizes(answer)
    chosen = answer.state.merge
    rows = [
        (each, f"{ms[each]:.1f} ms", f"{sum(kilobytes[each].values()):.1f} kB",
         ", ".join(f"{name} {size:.1f}" for name, size in kilobytes[each].items()) or "nothing")
        for each in AT
    ]  # fmt: skip
    head = ("merge", "computed before", "handed over", "of which, kB")
    return Content(
        f"<p>{MEANING[chosen]}</p>{_pipeline(answer, chosen)}"
        f"{table(rows, head, 'Before the sensors meet: measured in the run that is shown')}"
        "<p>Early: the image network has run, and each LiDAR point carries its five numbers and the class scores of its"
        " pixel. Mid: one map of each sensor. Late: each sensor's own boxes; the time is that of three detectors, one after"
        " the other.</p>"
    )


def milliseconds(answer: Answer) -> dict[str, float]:
    """What has been computed before the merge, by merge point."""
    ms = answer.seen.ms
    encoders = sum(ms.get(name, 0.0) for name in MODALITIES)
    alive = sum(name in answer.seen.maps for name in MODALITIES)
    rest = ms.get("decoder", 0.0) + ms.get("head", 0.0)
    return {"early": ms.get("image", 0.0), "mid": encoders, "late": encoders + alive * rest}


def sizes(answer: Answer) -> dict[str, dict[str, float]]:
    """kB that are handed over at the merge, by merge point and sensor; of dead sensors nothing is."""
    sample, maps = answer.sample, answer.seen.maps
    has = dict(zip(MODALITIES, sample.present.tolist(), strict=True))
    painted = len(sample.lidar_points) * (sample.lidar_points.shape[1] + has["camera"] * len(answer.classes)) * FLOAT
    raw = {"camera": float(sample.images.nbytes), "lidar": float(painted), "radar": float(sample.radar_points.nbytes)}
    boxes = len(answer.shown) * BOX_NUMBERS * FLOAT
    of_sensor = {
        "early": {name: raw[name] for name in MODALITIES if has[name]},
        "mid": {name: float(maps[name].numel() * FLOAT) for name in MODALITIES if name in maps},
        "late": {name: float(boxes) for name in MODALITIES if name in maps},
    }
    return {at: {name: size / 1e3 for name, size in each.items()} for at, each in of_sensor.items()}


def _pipeline(answer: Answer, chosen: str) -> str:
    """Three lines of stages that meet at the merge point and go on as one."""
    parts, at = [], AT[chosen]
    for line, name in enumerate(MODALITIES):
        y = 30 + 44 * line
        gone = "" if answer.sample.present[line] else ' opacity="0.3"'
        for stage, words in enumerate(STAGES[: at + 1]):
            x = 10 + 130 * stage
            parts.append(f'<rect x="{x}" y="{y - 16}" width="104" height="32" rx="6" class="stage"{gone}/>')
            parts.append(text(x + 52, y + 4, f"{name} {words}" if stage == 0 else words, f'text-anchor="middle"{gone}'))
        end = 10 + 130 * at + 104
        parts.append(f'<path d="M{end} {y}L{end + 40} 74" class="flow"{gone}/>')
    x = 10 + 130 * at + 144
    parts.append(f'<circle cx="{x}" cy="74" r="10" class="merge"/>' + text(x, 134, "they meet", 'text-anchor="middle"'))
    parts.append(f'<path d="M{x + 10} 74H560" class="flow"/>' + text(560, 66, "detections", 'text-anchor="end"'))
    return svg(570, 150, "".join(parts), f"Three pipelines that meet at {chosen} fusion")
