"""The report of an evaluation: one HTML file, and its figures as JSON."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from torch import nn

from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.evaluation.audits.depth import audit_depth, read_depths
from fusion_net.evaluation.strata import condition_of
from fusion_net.models.encoders.camera_encoder import CameraEncoder
from fusion_net.reports.evaluation import mistakes, run, scores
from fusion_net.reports.evaluation.audits import audits, depth, of_name
from fusion_net.reports.evaluation.figures import Scored, figures
from fusion_net.reports.evaluation.samples import samples
from fusion_net.reports.page.html import contents, escaped, page
from fusion_net.reports.run_result import rounded
from fusion_net.viz.picture_sheet import spread_evenly

REPORT, FIGURES = "report.html", "report.json"
DEPTH_SAMPLES = 40
"""Samples, spread evenly, on which the camera's depth is measured where no audit did."""
CONTENTS = (
    ("run", "Run"),
    ("drop-table", "Drop table"),
    ("worth", "Worth of a sensor"),
    ("curves", "Precision and recall"),
    ("groups", "Range and condition"),
    ("confusions", "Confusions"),
    ("poses", "Heading and velocity"),
    ("depth", "Depth"),
    ("samples", "Samples"),
    ("budget", "Error budget"),
    ("training", "Training"),
    ("settings", "Settings"),
)
"""Anchor and link of each section, in the order of the page."""


def write_report(
    folder: Path,
    *,
    scored: Scored,
    dataset: NuScenesDataset,
    model: nn.Module,
    doc: Mapping[str, Any],
    result: Mapping[str, Any],
    metrics: Path,
    resamples: int,
) -> Path:
    """Writes ``report.html`` and ``report.json`` into an evaluation's folder and returns the page's path. ``doc``, ``result``:
    what drop_table.json and result.json hold; ``metrics``: the run's metrics.csv."""
    found = rounded(figures(scored, resamples=resamples))
    section_of_audits, judged = audits(folder)
    found["depth"] = rounded(of_name(judged, "depth") or _depth(dataset, model))
    links = [*CONTENTS, *([("audits", "Audits")] if judged else [])]
    body = [
        f"<h1>{escaped(doc['run'])}</h1>",
        f"<p>Evaluated on {doc['num_samples']} samples of the split &ldquo;{escaped(doc['split'])}&rdquo;.</p>",
        contents(links),
        run.what_was_run(doc, result),
        scores.drop_table(doc),
        scores.worth(found),
        scores.curves(found, doc),
        scores.groups(found),
        mistakes.confusions(found),
        mistakes.poses(found),
        depth(found["depth"]),
        samples(scored, dataset),
        mistakes.budget(found),
        run.training(run.read_curves(metrics)),
        run.settings(result["settings"]),
        section_of_audits,
    ]
    (folder / FIGURES).write_text(json.dumps(found, allow_nan=False) + "\n", encoding="utf-8")
    path = folder / REPORT
    path.write_text(page(f"{doc['run']}: report", body), encoding="utf-8")
    return path


def _depth(dataset: NuScenesDataset, model: nn.Module) -> dict[str, Any] | None:
    """What the depth audit says of some samples. None for a network without a camera."""
    camera = next((part for part in model.modules() if isinstance(part, CameraEncoder)), None)
    if camera is None:
        return None
    places = spread_evenly(len(dataset), DEPTH_SAMPLES)
    batches = (dataset.collate([dataset[place]]) for place in places)
    scenes = {token: nusc.scene(token) for nusc, token in dataset.index}
    condition = {token: condition_of(scene) for token, scene in scenes.items()}
    return asdict(audit_depth(*read_depths(camera, batches), condition=condition, classes=dataset.classes))
