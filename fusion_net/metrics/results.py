"""The nuScenes result file: predictions as JSON that the official devkit scores, and back.

Format: https://www.nuscenes.org/object-detection. The network predicts no attributes; they follow from class and speed.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.metrics.detection import MAX_BOXES
from fusion_net.metrics.sample_boxes import SampleBoxes, stack

MOVING_SPEED = 0.5
"""m/s from which a box counts as moving: above the noise of a velocity head, below a walker's pace."""
ATTRIBUTES = {
    "car": ("vehicle.moving", "vehicle.parked"),
    "truck": ("vehicle.moving", "vehicle.parked"),
    "bus": ("vehicle.moving", "vehicle.stopped"),
    "trailer": ("vehicle.moving", "vehicle.parked"),
    "construction_vehicle": ("vehicle.moving", "vehicle.parked"),
    "pedestrian": ("pedestrian.moving", "pedestrian.standing"),
    "motorcycle": ("cycle.with_rider", "cycle.without_rider"),
    "bicycle": ("cycle.with_rider", "cycle.without_rider"),
    "traffic_cone": ("", ""),
    "barrier": ("", ""),
}
"""Attribute of a class when it moves and when it stands: the commonest in nuScenes, which is what most detectors write."""


def attributes_of(boxes: Boxes, classes: Sequence[str]) -> NDArray[np.str_]:
    """(N,) attribute names by class and speed; an unknown speed counts as standing."""
    names = np.array([ATTRIBUTES[name] for name in classes], dtype=np.str_).reshape(-1, 2)
    stands = ~(np.hypot(*boxes.velocity.T) > MOVING_SPEED)
    return names[boxes.label, stands.astype(int)]


def predicted(per_sample: Sequence[Boxes], classes: Sequence[str]) -> SampleBoxes:
    """Predictions of S samples (global frame) as the metric wants them: the best 500 of each, with attributes."""
    kept = [boxes[_best(boxes.score, MAX_BOXES)] for boxes in per_sample]
    unknown = [np.full(len(boxes), -1, np.int64) for boxes in kept]
    return stack(kept, [attributes_of(boxes, classes) for boxes in kept], unknown)


def write_results(
    path: Path,
    found: SampleBoxes,
    *,
    tokens: Sequence[str],
    classes: Sequence[str],
    sensors: Sequence[str] = MODALITIES,
) -> None:
    """Writes ``results_nusc.json``: every sample token a key, numbers exact, whole or not at all."""
    boxes, attributes = found.boxes, found.attribute.tolist()
    columns = (found.sample.tolist(), box_fields(boxes), boxes.label.tolist(), boxes.score.tolist(), attributes)
    results: dict[str, list[dict]] = {token: [] for token in tokens}
    for sample, fields, label, score, attribute in zip(*columns, strict=True):
        kind = {"detection_name": classes[label], "detection_score": score, "attribute_name": attribute}
        results[tokens[sample]].append({"sample_token": tokens[sample], **fields, **kind})
    write_result_file(path, results, sensors=sensors)


def read_results(path: Path, *, tokens: Sequence[str], classes: Sequence[str]) -> SampleBoxes:
    """Predictions of a result file for the given samples and classes. ValueError when it is damaged or lacks a sample."""
    results = read_result_file(path, tokens)
    records = [[box for box in results[token] if box["detection_name"] in classes] for token in tokens]
    return stack(
        [boxes_of(boxes, classes, kind="detection") for boxes in records],
        [np.array([box["attribute_name"] for box in boxes], dtype=np.str_) for boxes in records],
        [np.array([box.get("num_pts", -1) for box in boxes], np.int64) for boxes in records],
    )


def box_fields(boxes: Boxes) -> list[dict]:
    """What a result file of any task says of each box: translation, size, rotation and velocity, numbers exact."""
    half = boxes.yaw / 2
    rotation = np.stack([np.cos(half), np.zeros_like(half), np.zeros_like(half), np.sin(half)], axis=1)
    columns = (boxes.center, boxes.wlh, rotation, np.nan_to_num(boxes.velocity))
    names = ("translation", "size", "rotation", "velocity")
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [dict(zip(names, row, strict=True)) for row in rows]


def boxes_of(records: list[dict], classes: Sequence[str], *, kind: Literal["detection", "tracking"]) -> Boxes:
    """The boxes of one sample of a result file, whose names and scores are those of its task."""

    def column(name: str, width: int) -> NDArray[np.float64]:
        return np.array([record[name] for record in records], float).reshape(-1, width)

    w, x, y, z = column("rotation", 4).T
    yaw = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    label = np.array([classes.index(record[f"{kind}_name"]) for record in records], np.int64)
    score = column(f"{kind}_score", 1)[:, 0]
    boxes = column("translation", 3), column("size", 3), yaw, column("velocity", 2), label
    return Boxes(*boxes, score, np.zeros((len(records), 2)))


def write_result_file(path: Path, results: dict[str, list[dict]], *, sensors: Sequence[str]) -> None:
    """Writes what was found by sample token, with what it was found with; whole or not at all."""
    meta = {f"use_{name}": name in sensors for name in (*MODALITIES, "map", "external")}
    partial = path.with_name(path.name + ".part")
    partial.write_text(json.dumps({"meta": meta, "results": results}), encoding="utf-8")
    partial.replace(path)


def read_result_file(path: Path, tokens: Sequence[str]) -> dict[str, list[dict]]:
    """Boxes by sample token. ValueError when the file is damaged or lacks one of the samples."""
    try:
        results = json.loads(path.read_bytes())["results"]
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is not a nuScenes result file ({error}); write it again with eval.py") from None
    missing = [token for token in tokens if token not in results]
    if missing:
        raise ValueError(
            f"{path} lacks {len(missing)} of {len(tokens)} samples, the first is {missing[0]!r}: another split?"
        )
    return results


def _best(score: NDArray[np.float64], count: int) -> NDArray[np.int64] | slice:
    """Places of the highest scores, in the order they came in."""
    return slice(None) if len(score) <= count else np.sort(np.argsort(-score, kind="stable")[:count])
