"""How honest a late model's covariances and scores are: fitted on scenes kept from training, measured on any others."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.data.batch import Batch
from fusion_net.evaluation.scoring import GroundTruth, score
from fusion_net.metrics.matching import TP_ERRORS
from fusion_net.models.late.association import match_to_labels
from fusion_net.models.late.calibration import consistency, fit_scales
from fusion_net.models.late.covariance import along_and_across, ray_variance
from fusion_net.models.late.estimates import Estimates
from fusion_net.models.late.fuse import ASSOCIATIONS
from fusion_net.models.late.late_fusion import LateFusion
from fusion_net.models.late.merging import MERGES
from fusion_net.models.late.scores import SCORES, fit_platt
from fusion_net.models.late.sensor_calibration import MATCH_DISTANCE, SensorCalibration

HIT_DISTANCE = 2.0
"""Metres within which a box counts as right when scores are calibrated: where nuScenes' metric takes its errors."""
RANGES = ((0.0, 20.0), (20.0, 35.0), (35.0, 75.0))
"""Metres from the car; the default grid ends at 51 m ahead and 22 m aside."""


@dataclass(frozen=True)
class Judged:
    """Estimates of many samples, and of each the place and velocity (N, 2) of the label it took; NaN where it took none."""

    estimates: Estimates
    center: NDArray[np.float64]
    velocity: NDArray[np.float64]

    @property
    def error(self) -> NDArray[np.float64]:
        """(N, 2) of the place, ego axes."""
        return self.estimates.boxes.center[:, :2] - self.center

    @property
    def velocity_error(self) -> NDArray[np.float64]:
        """(N, 2) ego axes."""
        return self.estimates.boxes.velocity - self.velocity


@torch.inference_mode()
def gather(model: LateFusion, batches: Iterable[Batch]) -> tuple[dict[str, Mapping[str, Estimates]], list[Boxes]]:
    """By token each detector's estimates, with the labels that they took, and the labels in the same order. No sensor is
    dropped."""
    lists: dict[str, Mapping[str, Estimates]] = {}
    labels: list[Boxes] = []
    for batch in batches:
        lists |= zip(batch.tokens, model.estimates(model(batch), with_truth=True), strict=True)
        labels += batch.boxes
    return lists, labels


def judge(lists: Sequence[Estimates], labels: Sequence[Boxes]) -> Judged:
    """All samples' estimates as one table."""
    center, velocity = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for found, boxes in zip(lists, labels, strict=True):
        unknown = np.full((len(found), 2), np.nan)
        matched = found.truth >= 0
        place, speed = unknown.copy(), unknown
        place[matched] = boxes.center[found.truth[matched], :2]
        speed[matched] = boxes.velocity[found.truth[matched]]
        center.append(place)
        velocity.append(speed)
    return Judged(Estimates.join(list(lists)), np.concatenate(center), np.concatenate(velocity))


def calibrate(model: LateFusion, batches: Iterable[Batch]) -> None:
    """Fits each detector's variances and scores, and the prior of a box, to what ``batches`` hold: samples that no detector was
    trained on. The variances are fitted to boxes that are at least ``min_probability`` likely: those that may be merged."""
    for name, calibration in _calibrations(model).items():
        calibration.load_state_dict(SensorCalibration(name, num_classes=len(calibration.matches)).state_dict())
    lists, labels = gather(model, batches)
    hits, boxes = 0, 0
    for name, calibration in _calibrations(model).items():
        judged = judge([each[name] for each in lists.values()], labels)
        found = judged.estimates.boxes
        hit = np.linalg.norm(judged.error, axis=1) < HIT_DISTANCE  # NaN is none
        platt = fit_platt(found.score, hit)
        likely = platt(found.score) >= model.min_probability
        hits, boxes = hits + int(hit[likely].sum()), boxes + int(likely.sum())
        place, num_classes = found.center[likely, :2], len(calibration.matches)
        error = along_and_across(judged.error[likely], place)
        variance = ray_variance(found.log_variance[likely], place)
        scales = fit_scales(error, variance, found.label[likely], num_classes=num_classes)
        speed = along_and_across(judged.velocity_error[likely], place)
        velocity = fit_scales(speed, np.ones_like(speed), found.label[likely], num_classes=num_classes)
        calibration.set(place=scales, velocity=velocity, platt=platt)
    model.prior.fill_(hits / boxes if hits else 0.5)


def report(model: LateFusion, batches: Iterable[Batch], truth: GroundTruth) -> dict[str, Any]:
    """What ``late_calibration.json`` holds of these samples: ``rows`` by detector, and by merging rule for the boxes that
    several detectors share, over all ranges and by range; ``rules``: what each rule is worth; ``calibration``: the factors that
    all rests on. Boxes are matched with labels as the metric does, within 4 m, and no other gate cuts the errors off."""
    lists, labels = gather(model, batches)
    rows: list[dict[str, Any]] = []
    for name in model.detectors:
        rows += _rows(name, judge([each[name] for each in lists.values()], labels), model.min_probability)
    for merge in MERGES if len(model.detectors) > 1 else ():
        pairs = zip(lists.values(), labels, strict=True)
        fused = [_merged(model.fuse(each, merge=merge), boxes) for each, boxes in pairs]
        rows += _rows(merge, judge(fused, labels), model.min_probability)
    factors = _factors(model, truth.classes)
    return {"samples": len(labels), "rows": rows, "rules": rules(model, lists, truth), "calibration": factors}


def rules(model: LateFusion, lists: Mapping[str, Mapping[str, Estimates]], truth: GroundTruth) -> list[dict[str, Any]]:
    """What each rule is worth: mAP, NDS, mATE and mAVE of all sensors, under the model's own rules, then under all but one."""
    own: dict[str, Any] = {"association": model.association, "merge": model.merge, "score": model.score}
    others: dict[str, tuple[str, ...]] = {"association": ASSOCIATIONS, "merge": MERGES, "score": SCORES}
    every = [own, *(own | {key: value} for key, values in others.items() for value in values if value != own[key])]
    rows = []
    for chosen in every:
        result = score(truth, [model.fuse(lists[token], **chosen).boxes for token in truth.tokens])
        errors = dict(zip(TP_ERRORS, result.mean_errors, strict=True))
        figures = {"mAP": result.mAP, "NDS": result.NDS, "mATE": errors["mATE"], "mAVE": errors["mAVE"]}
        rows.append(chosen | {key: None if np.isnan(value) else float(value) for key, value in figures.items()})
    return rows


def _merged(fused: Estimates, labels: Boxes) -> Estimates:
    """Those boxes of a fused list that several detectors share, with the labels that they take as a list."""
    truth = match_to_labels(fused.boxes, labels, distance=MATCH_DISTANCE)
    columns = {name: getattr(fused, name) for name in ("boxes", "cov", "velocity_cov", "probability")}
    return Estimates(**columns, truth=truth)[np.isfinite(fused.probability).sum(axis=1) > 1]


def _rows(name: str, judged: Judged, min_probability: float) -> list[dict[str, Any]]:
    """Of all ranges, then of each: the consistency of places and of velocities, and the mean standard deviations in metres that
    the covariances claim along and across the ray."""
    found = judged.estimates
    likely = np.nan_to_num(found.probability, nan=0.0).max(axis=1, initial=0.0) >= min_probability
    matched = likely & np.isfinite(judged.center).all(axis=1)
    away = np.linalg.norm(found.boxes.center[:, :2], axis=1)
    rows = []
    for low, high in ((0.0, np.inf), *RANGES):
        chosen = matched & (away >= low) & (away < high)
        sigma = _sigma(found.cov[chosen], found.boxes.center[chosen, :2])
        row: dict[str, Any] = {"of": name, "range": [low, None if high == np.inf else high]}
        row |= consistency(judged.error[chosen], found.cov[chosen]) | {
            "sigma_along": sigma[0],
            "sigma_across": sigma[1],
        }
        speeds = consistency(judged.velocity_error[chosen], found.velocity_cov[chosen])
        rows.append(row | {f"velocity_{key}": value for key, value in speeds.items()})
    return rows


def _sigma(cov: NDArray[np.float64], place: NDArray[np.float64]) -> list[float | None]:
    if not len(cov):
        return [None, None]
    along = place / np.maximum(np.linalg.norm(place, axis=1, keepdims=True), 1e-9)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return [float(np.sqrt(np.einsum("ni,nij,nj->n", axis, cov, axis)).mean()) for axis in (along, across)]


def _factors(model: LateFusion, classes: Sequence[str]) -> dict[str, Any]:
    """Of each detector the fitted factors by class, with the matches behind them, and its scaling of scores."""
    found: dict[str, Any] = {}
    for name, calibration in _calibrations(model).items():
        columns = (
            calibration.matches.tolist(),
            calibration.factor.tolist(),
            calibration.velocity_variance.sqrt().tolist(),
        )
        by_class = {
            label: {"matches": matches, "variance_factor": factor, "velocity_sigma": sigma}
            for label, matches, factor, sigma in zip(classes, *columns, strict=True)
        }
        slope, shift = calibration.platt.tolist()
        found[name] = {"classes": by_class, "score_slope": slope, "score_shift": shift}
    return found


def _calibrations(model: LateFusion) -> dict[str, SensorCalibration]:
    return {name: part for name, part in model.calibration.items() if isinstance(part, SensorCalibration)}
