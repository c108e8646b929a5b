"""The nuScenes tracking result file: tracks as JSON that the official devkit scores, and back.

Format: https://www.nuscenes.org/tracking. Of the ten classes only the seven that nuScenes tracks are written.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.metrics.results import box_fields, boxes_of, read_result_file, write_result_file
from fusion_net.metrics.sample_boxes import stack
from fusion_net.metrics.track_boxes import TrackBoxes
from fusion_net.metrics.tracking import TRACKING_CLASSES


def write_tracks(
    path: Path,
    found: TrackBoxes,
    *,
    tokens: Sequence[str],
    classes: Sequence[str],
    sensors: Sequence[str] = MODALITIES,
) -> None:
    """Writes the tracks; their labels index ``classes``. Every sample token is a key; the file is whole or not there."""
    found = found.relabel(classes, TRACKING_CLASSES)
    boxes = found.table.boxes
    columns = (found.table.sample.tolist(), box_fields(boxes), boxes.label.tolist(), boxes.score.tolist())
    results: dict[str, list[dict]] = {token: [] for token in tokens}
    for sample, fields, label, score, track in zip(*columns, found.track.tolist(), strict=True):
        identity = {"tracking_id": track, "tracking_name": TRACKING_CLASSES[label], "tracking_score": score}
        results[tokens[sample]].append({"sample_token": tokens[sample], **fields, **identity})
    write_result_file(path, results, sensors=sensors)


def read_tracks(path: Path, *, tokens: Sequence[str], classes: Sequence[str] = TRACKING_CLASSES) -> TrackBoxes:
    """Tracks of a result file for the given samples and classes. ValueError when it is damaged or lacks a sample."""
    results = read_result_file(path, tokens)
    records = [[box for box in results[token] if box["tracking_name"] in classes] for token in tokens]
    boxes = [boxes_of(sample, classes, kind="tracking") for sample in records]
    no_attribute = [np.full(len(sample), "", dtype=np.str_) for sample in records]
    num_pts = [np.array([box.get("num_pts", -1) for box in sample], np.int64) for sample in records]
    names = np.array([box["tracking_id"] for sample in records for box in sample], dtype=np.str_)
    return TrackBoxes(stack(boxes, no_attribute, num_pts), names)
