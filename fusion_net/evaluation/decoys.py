"""Which sensors tell an object from its decoy: generated data sets hold bodies that copy an object for all but one sensor.

A decoy is annotated under a category that is no detection class, with the key ``imitates`` naming what it copies, so the
metrics ignore it. Here the detector's scores at decoys are compared with those at real objects of the class: both standing
still, on the grid, in range and with at least one LiDAR or radar point.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import rankdata

from fusion_net.common.geometry import invert
from fusion_net.common.nuscenes_format import CATEGORY_TO_CLASS, EXACT_VELOCITY, IMITATED_CATEGORY
from fusion_net.evaluation.drop_table import SUBSETS
from fusion_net.evaluation.scoring import GroundTruth, table_order
from fusion_net.metrics.matching import ClassMatches
from fusion_net.metrics.sample_boxes import SampleBoxes
from fusion_net.nuscenes.nuscenes import NuScenes

RADIUS = {"truck": 4.0, "bus": 4.0, "trailer": 4.0, "construction_vehicle": 4.0}
"""Metres from an object's centre within which a detection is one of it; 2 where the class is not named."""
STILL = 0.2
"""m/s below which an object stands."""


@dataclass(frozen=True)
class Bodies:
    """N annotated bodies, real or not, in the GLOBAL frame."""

    label: NDArray[np.int64]  # (N,) class, or class imitated
    is_decoy: NDArray[np.bool_]  # (N,)
    is_compared: NDArray[np.bool_]  # (N,) standing, seen, on the grid and in range
    center: NDArray[np.float64]  # (N, 2)
    sample: NDArray[np.int64]  # (N,) index into the tokens of the labels

    def __getitem__(self, index) -> "Bodies":
        """The bodies at an index array or mask."""
        return Bodies(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


def audit_decoys(
    truth: GroundTruth, samples: Sequence[tuple[NuScenes, str]], tables: Sequence[SampleBoxes]
) -> list[dict[str, Any]]:
    """One entry per class that decoys imitate: counts, and for each subset of sensors (``tables`` in the order of SUBSETS)
    the AUC of real against decoy by score, and the fractions of both found above the score of the best F1. [] on data
    without decoys."""
    bodies = read_bodies(truth, samples)
    matches = [truth.matches(table) for table in tables]
    audit: list[dict[str, Any]] = []
    for label in np.unique(bodies.label[bodies.is_decoy & bodies.is_compared]).tolist():
        name, kind = truth.classes[label], bodies[bodies.label == label]
        real = ~kind.is_decoy[kind.is_compared]
        rows = []
        for sensors, table, match in zip(SUBSETS, tables, matches, strict=True):
            found = table[table.boxes.label == label]
            score = best_scores(kind, found, RADIUS.get(name, 2.0))[kind.is_compared]
            threshold = best_f1_score(match[label])
            rows.append(
                {
                    "sensors": list(sensors),
                    "AUC": auc(score[real], score[~real]),
                    "real_found": _fraction(score[real] >= threshold),
                    "decoys_found": _fraction(score[~real] >= threshold),
                }
            )
        audit.append({"imitates": name, "real": int(real.sum()), "decoys": int((~real).sum()), "rows": rows})
    return audit


def read_bodies(truth: GroundTruth, samples: Sequence[tuple[NuScenes, str]]) -> Bodies:
    """Every annotation of the samples that is of a configured class or imitates one. Empty where nothing is a decoy."""
    place = {token: index for index, (_, token) in enumerate(table_order(samples))}
    rows: list[tuple[int, bool, float, int, list[float], int]] = []
    for nusc in dict.fromkeys(nusc for nusc, _ in samples):
        category = {
            token: nusc.get("category", i["category_token"])["name"] for token, i in nusc.tables["instance"].items()
        }
        for record in nusc.tables["sample_annotation"].values():
            if (
                record["sample_token"] not in place or not {IMITATED_CATEGORY, EXACT_VELOCITY} <= record.keys()
            ):  # not generated
                continue
            name = CATEGORY_TO_CLASS.get(record[IMITATED_CATEGORY] or category[record["instance_token"]], "")
            if name in truth.classes:
                points = record["num_lidar_pts"] + record["num_radar_pts"]
                speed = float(np.hypot(*record[EXACT_VELOCITY]))
                rows.append(
                    (truth.classes.index(name), bool(record[IMITATED_CATEGORY]), speed, points, record["translation"],
                     place[record["sample_token"]])
                )  # fmt: skip
    if not any(row[1] for row in rows):
        none = np.zeros(0, np.int64)
        return Bodies(none, none > 0, none > 0, np.zeros((0, 2)), none)
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    label, is_decoy, pace, points, center, sample = columns
    global_T_ego = truth.global_T_ego[sample]
    ego_T_global = invert(global_T_ego)
    local = np.einsum("nij,nj->ni", ego_T_global[:, :2, :3], center) + ego_T_global[:, :2, 3]
    distance = np.linalg.norm(center[:, :2] - global_T_ego[:, :2, 3], axis=1)
    in_range = (distance < truth.metric.label_range[label]) & truth.grid.contains(local)
    return Bodies(label, is_decoy, in_range & (pace < STILL) & (points > 0), center[:, :2], sample)


def best_scores(bodies: Bodies, found: SampleBoxes, radius: float) -> NDArray[np.float64]:
    """(N,) highest score of the detections that belong to each body: those of its sample that are nearer to it than to
    any other, real or decoy, and within ``radius`` metres. 0 where there is none."""
    best = np.zeros(len(bodies.label))
    if not len(best) or not len(found):
        return best
    apart = 1e6  # metres between samples along a third axis: no neighbour is of another
    where = cKDTree(np.column_stack([bodies.center, apart * bodies.sample]))
    _, nearest = where.query(
        np.column_stack([found.boxes.center[:, :2], apart * found.sample]), distance_upper_bound=radius
    )
    is_near = nearest < len(best)
    np.maximum.at(best, nearest[is_near], found.boxes.score[is_near])
    return best


def auc(high: NDArray[np.float64], low: NDArray[np.float64]) -> float | None:
    """Probability that one of ``high`` (N,) exceeds one of ``low`` (M,), ties counting half (Mann and Whitney, 1947): 0.5 if
    they cannot be told apart. None where either is empty."""
    if not len(high) or not len(low):
        return None
    ranks = rankdata(np.concatenate([high, low]))[: len(high)]
    return float((ranks.mean() - (len(high) + 1) / 2) / len(low))


def best_f1_score(match: ClassMatches) -> float:
    """The score at and above which a class's detections have the best F1; infinite where none hits."""
    hits = np.cumsum(match.is_pair)
    if not len(hits) or not hits[-1]:
        return float("inf")
    f1 = 2 * hits / (np.arange(1, len(hits) + 1) + match.num_gt.sum())
    return float(match.score[np.argmax(f1)])


def _fraction(is_found: NDArray[np.bool_]) -> float | None:
    return float(is_found.mean()) if len(is_found) else None
