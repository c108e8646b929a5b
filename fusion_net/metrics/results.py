"""The nuScenes result file: predictions as JSON that the official devkit scores, and back.

Format: https://www.nuscenes.org/object-detection. The network predicts no attributes; they follow from class and speed.
"""

import json
from collections.abc import Sequence
from pathlib import Path

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
    boxes = found.boxes
    half = boxes.yaw / 2
    rotation = np.stack([np.cos(half), np.zeros_like(half), np.zeros_like(half), np.sin(half)], axis=1)
    columns = (
        boxes.center,
        boxes.wlh,
        rotation,
        np.nan_to_num(boxes.velocity),
        boxes.label,
        boxes.score,
        found.attribute,
    )
    results: dict[str, list[dict]] = {token: [] for token in tokens}
    for row, sample in enumerate(found.sample):
        center, wlh, quaternion, velocity, label, score, attribute = (column[row].tolist() for column in columns)
        results[tokens[sample]].append(
            {
                "sample_token": tokens[sample],
                "translation": center,
                "size": wlh,
                "rotation": quaternion,
                "velocity": velocity,
                "detection_name": classes[label],
                "detection_score": score,
                "attribute_name": attribute,
            }
        )
    meta = {f"use_{name}": name in sensors for name in (*MODALITIES, "map", "external")}
    partial = path.with_name(path.name + ".part")
    partial.write_text(json.dumps({"meta": meta, "results": results}), encoding="utf-8")
    partial.replace(path)


def read_results(path: Path, *, tokens: Sequence[str], classes: Sequence[str]) -> SampleBoxes:
    """Predictions of a result file for the given samples and classes. ValueError when it is damaged or lacks a sample."""
    try:
        results = json.loads(path.read_bytes())["results"]
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is not a nuScenes result file ({error}); write it again with eval.py") from None
    missing = [token for token in tokens if token not in results]
    if missing:
        raise ValueError(
            f"{path} lacks {len(missing)} of {len(tokens)} samples, the first is {missing[0]!r}: another split?"
        )
    records = [[box for box in results[token] if box["detection_name"] in classes] for token in tokens]
    return stack(
        [_boxes(boxes, classes) for boxes in records],
        [np.array([box["attribute_name"] for box in boxes], dtype=np.str_) for boxes in records],
        [np.array([box.get("num_pts", -1) for box in boxes], np.int64) for boxes in records],
    )


def _boxes(records: list[dict], classes: Sequence[str]) -> Boxes:
    def column(name: str, width: int) -> NDArray[np.float64]:
        return np.array([record[name] for record in records], float).reshape(-1, width)

    w, x, y, z = column("rotation", 4).T
    yaw = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    label = np.array([classes.index(record["detection_name"]) for record in records], np.int64)
    score = column("detection_score", 1)[:, 0]
    boxes = column("translation", 3), column("size", 3), yaw, column("velocity", 2), label
    return Boxes(*boxes, score, np.zeros((len(records), 2)))


def _best(score: NDArray[np.float64], count: int) -> NDArray[np.int64] | slice:
    """Places of the highest scores, in the order they came in."""
    return slice(None) if len(score) <= count else np.sort(np.argsort(-score, kind="stable")[:count])
