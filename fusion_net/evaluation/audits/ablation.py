"""Does the detector use all of its sensors? The seven subsets, Shapley values of the data set and of single boxes, and what
the network listens to."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fusion_net.common.modalities import STYLES
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.audits.result import Audit
from fusion_net.evaluation.audits.shapley import shapley
from fusion_net.evaluation.bootstrap import over_scenes
from fusion_net.evaluation.drop_table import SUBSETS, DropTable
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.metrics.sample_boxes import SampleBoxes

COLLAPSE = 1 / 3
"""Share of the mAP that has to be left when one sensor is gone."""
IGNORED = 0.03
"""Share of the mAP below which a sensor's Shapley value counts as nothing."""
RADIUS = 2.0
"""Metres from a label within which a detection of its class is one of it, as the metric measures errors."""


def audit_ablation(
    table: DropTable,
    truth: GroundTruth,
    *,
    encoders: Sequence[str],
    influence: Mapping[str, Mapping[str, float]] | None = None,
) -> Audit:
    """``encoders``: the sensors that the detector was built with. ``influence``: of :func:`influence.influence`, where the
    network has one map per sensor."""
    title = "Per-modality ablation: does the detector use every sensor, and survive the loss of one?"
    explanation = (
        "mAP of every subset of the sensors. Wrong where less than a third of the mAP is left without one sensor, though the"
        f" others are sound, or where a sensor's Shapley value is below {100 * IGNORED:g} % of the mAP: such a sensor is"
        " ignored. The Shapley value is a sensor's gain averaged over all orders of switching the sensors on; the values sum"
        " to the mAP of all. Intervals are 95 % over scenes. Share: what would go with a sensor's map to first order,"
        " gradient times activation."
    )
    if len(encoders) < 2 or table.rows[0]["mAP"] <= 0:
        why = "built with one sensor alone" if len(encoders) < 2 else "finds nothing with all sensors"
        return Audit("ablation", title, f"the detector {why}", None, {}, explanation)
    verdict, ok, figures = judge_subsets(table.rows, encoders)
    spread = shapley(dict(zip(SUBSETS, table.resampled, strict=True)))
    for name, value in figures["shapley"].items():
        value["ci95"] = over_scenes(spread[name], len(set(truth.scenes)))
    numbers = {
        "subsets": [{key: row[key] for key in ("sensors", "mAP", "mAP_ci95", "NDS")} for row in table.rows],
        **figures,
        "influence": {name: dict(values) for name, values in (influence or {}).items()},
        **_boxes(truth, table.tables, encoders),
    }
    return Audit("ablation", title, verdict, ok, numbers, explanation)


def judge_subsets(rows: Sequence[Mapping[str, Any]], encoders: Sequence[str]) -> tuple[str, bool, dict[str, Any]]:
    """The verdict in words, whether nothing is wrong, and the Shapley value of each sensor with what is left without it, from
    the seven ``rows`` of a drop table in the order of SUBSETS."""
    score = {subset: float(row["mAP"]) for subset, row in zip(SUBSETS, rows, strict=True)}
    whole = score[SUBSETS[0]]
    worth = {name: float(value) for name, value in shapley(score).items()}
    left = {name: score[tuple(other for other in MODALITIES if other != name)] / whole for name in encoders}
    collapsed = [name for name in encoders if left[name] < COLLAPSE]
    faults = [f"without {STYLES[name].label} {100 * left[name]:.0f} % is left" for name in collapsed]
    faults += [f"{STYLES[name].label} is ignored" for name in encoders if worth[name] < IGNORED * whole]
    shares = ", ".join(f"{STYLES[name].label} {worth[name]:.3f}" for name in encoders)
    least = min(left, key=lambda name: left[name])
    calm = f"at the least {100 * left[least]:.0f} % is left (without {STYLES[least].label})"
    figures = {
        "shapley": {name: {"mAP": worth[name], "share": worth[name] / whole} for name in encoders},
        "left_without": left,
    }
    return f"of mAP {whole:.3f} {shares} (Shapley); {'; '.join(faults) or calm}", not faults, figures


def label_scores(truth: GroundTruth, found: SampleBoxes) -> NDArray[np.float64]:
    """(N,) of each label the highest score of the detections of its class within RADIUS, 0 where there is none."""
    best = np.zeros(len(truth.labels))
    if not len(best) or not len(found):
        return best

    def place(boxes: SampleBoxes) -> NDArray[np.float64]:
        """(N, 4): far apart where sample or class differ."""
        return np.column_stack([boxes.boxes.center[:, :2], 1e6 * boxes.sample, 1e6 * boxes.boxes.label])

    tree = cKDTree(place(found))
    for row, near in enumerate(tree.query_ball_point(place(truth.labels), RADIUS)):
        best[row] = found.boxes.score[near].max(initial=0.0)
    return best


def _boxes(truth: GroundTruth, tables: Sequence[SampleBoxes], encoders: Sequence[str]) -> dict[str, Any]:
    """Shapley values of the score at each label: their means by class, and of each sensor the box that it is worth most to."""
    scores = {subset: label_scores(truth, table) for subset, table in zip(SUBSETS, tables, strict=True)}
    worth = shapley(scores)
    label = truth.labels.boxes.label
    by_class = {
        name: {sensor: float(worth[sensor][label == k].mean()) for sensor in encoders}
        | {"labels": int((label == k).sum())}
        for k, name in enumerate(truth.classes)
        if (label == k).any()
    }
    examples = []
    for sensor in encoders:
        row = int(np.argmax(worth[sensor])) if len(label) else -1
        if row >= 0 and worth[sensor][row] > 0:
            away = float(np.linalg.norm(truth.in_ego(truth.labels[[row]])[0, :2]))
            examples.append(
                {
                    "sensor": sensor,
                    "class": truth.classes[label[row]],
                    "token": truth.tokens[truth.labels.sample[row]],
                    "distance": away,
                    "scores": {"+".join(STYLES[n].letter for n in s): float(scores[s][row]) for s in SUBSETS},
                    "shapley": {name: float(worth[name][row]) for name in encoders},
                }
            )
    return {"boxes_by_class": by_class, "boxes": examples}
