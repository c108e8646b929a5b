"""The nuScenes detection metric (Caesar et al. 2020, arXiv 1903.11027, section 3.1), vectorised.

Gives the numbers of nuscenes-devkit 1.2.0 (``detection_cvpr_2019``) for the same boxes, over any list of classes: with all
ten and the official ranges it is the official score, with fewer it is the same definition averaged over those.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.metrics.matching import TP_ERRORS, ClassMatches, match_class
from fusion_net.metrics.sample_boxes import SampleBoxes

CLASS_RANGE = {
    "car": 50.0, "truck": 50.0, "bus": 50.0, "trailer": 50.0, "construction_vehicle": 50.0, "pedestrian": 40.0,
    "motorcycle": 40.0, "bicycle": 40.0, "traffic_cone": 30.0, "barrier": 30.0,
}  # fmt: skip
"""Metres from the car within which nuScenes evaluates a class."""
UNDEFINED = {"traffic_cone": ("mAOE", "mAVE", "mAAE"), "barrier": ("mAVE", "mAAE")}
"""Errors that mean nothing for a class: they are left out of the mean over classes."""
RECALL = np.linspace(0, 1, 101)
MAX_BOXES = 500
"""Boxes that a sample may have in a result file."""


@dataclass(frozen=True)
class DetectionMetrics:
    """The score of a set of predictions over K classes and T distance thresholds."""

    classes: tuple[str, ...]
    ap: NDArray[np.float64]  # (K, T)
    errors: NDArray[np.float64]  # (K, 5) TP_ERRORS; NaN where undefined for the class
    num_gt: NDArray[np.int64]  # (K,)
    map_weight: float = 5.0

    @property
    def class_ap(self) -> NDArray[np.float64]:
        """(K,) mean over the distance thresholds."""
        return self.ap.mean(axis=1)

    @property
    def mAP(self) -> float:
        """Mean over classes; a class without labels counts 0, as nuScenes has it."""
        return float(self.class_ap.mean())

    @property
    def mean_errors(self) -> NDArray[np.float64]:
        """(5,) TP_ERRORS, mean over the classes that define them; NaN if none does."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # mean of nothing
            return np.nanmean(self.errors, axis=0)

    @property
    def NDS(self) -> float:
        """nuScenes detection score: mAP and the five errors turned into scores, mAP with half of the weight."""
        scores = np.clip(1 - np.nan_to_num(self.mean_errors, nan=1.0), 0, None)
        return float((self.map_weight * self.mAP + scores.sum()) / (self.map_weight + len(scores)))


@beartype
@dataclass(frozen=True, kw_only=True)
class DetectionMetric:
    """The definition. ``class_range`` and ``distances`` in metres; the defaults are nuScenes' own."""

    classes: list[str] = field(default_factory=lambda: list(CLASSES))
    class_range: dict[str, float] = field(default_factory=lambda: dict(CLASS_RANGE))
    distances: list[float] = field(default_factory=lambda: [0.5, 1.0, 2.0, 4.0])
    tp_distance: float = 2.0
    min_recall: float = 0.1
    min_precision: float = 0.1
    map_weight: float = 5.0

    def __post_init__(self) -> None:
        for name in self.classes:
            if name not in self.class_range:
                near = get_close_matches(name, self.class_range, n=1) or list(self.class_range)
                raise ValueError(f"metric: no class_range for the class {name!r}; known is {', '.join(near)}")
        if not self.classes or not self.distances:
            raise ValueError(f"metric: classes={self.classes}, distances={self.distances}: name at least one of each")

    @property
    def label_range(self) -> NDArray[np.float64]:
        """(K,) metres, in the order of the classes."""
        return np.array([self.class_range[name] for name in self.classes])

    def __call__(self, truth: SampleBoxes, found: SampleBoxes, num_samples: int) -> DetectionMetrics:
        """Score of predictions against labels; both filtered already (``SampleBoxes.within``), labels index ``classes``."""
        return self.summarise(self.match(truth, found, num_samples))

    def match(self, truth: SampleBoxes, found: SampleBoxes, num_samples: int) -> list[ClassMatches]:
        """Who takes whom, for each class: all that is costly, and independent of how samples are weighted."""
        return [
            match_class(
                truth[truth.boxes.label == label],
                found[found.boxes.label == label],
                num_samples=num_samples,
                distances=np.array(self.distances),
                tp_distance=self.tp_distance,
                yaw_period=np.pi if name == "barrier" else 2 * np.pi,  # a barrier looks the same from behind
            )
            for label, name in enumerate(self.classes)
        ]

    def summarise(self, matches: Sequence[ClassMatches]) -> DetectionMetrics:
        """The curves and their means."""
        errors = np.array([self._true_positive_errors(match) for match in matches])
        for row, name in enumerate(self.classes):
            errors[row, [TP_ERRORS.index(error) for error in UNDEFINED.get(name, ())]] = np.nan
        num_gt = np.array([match.num_gt.sum() for match in matches])
        ap = np.array([self.average_precision(match) for match in matches])
        return DetectionMetrics(tuple(self.classes), ap, errors, num_gt, self.map_weight)

    def average_precision(self, match: ClassMatches, copies: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """(T,) AP of one class; ``copies`` (S,) says how often each sample counts, once each if None."""
        hit, num_gt = match.hit, match.num_gt.sum()
        if copies is not None:
            hit = np.repeat(hit, copies[match.sample], axis=1)
            num_gt = match.num_gt @ copies
        ap = np.zeros(len(hit))
        if num_gt == 0 or hit.shape[1] == 0:
            return ap
        true_positives = np.cumsum(hit, axis=1)
        precision = true_positives / np.arange(1, hit.shape[1] + 1)
        first = round(100 * self.min_recall) + 1
        for t in np.flatnonzero(true_positives[:, -1]):
            at_recall = np.interp(RECALL[first:], true_positives[t] / num_gt, precision[t], right=0)
            ap[t] = np.maximum(at_recall - self.min_precision, 0).mean() / (1 - self.min_precision)
        return ap

    def _true_positive_errors(self, match: ClassMatches) -> NDArray[np.float64]:
        """(5,) errors of one class, each the mean over recalls of its running mean; 1 if ``min_recall`` is not reached."""
        num_gt, first = match.num_gt.sum(), round(100 * self.min_recall) + 1
        if num_gt == 0 or not match.is_pair.any():
            return np.ones(len(TP_ERRORS))
        recall = np.cumsum(match.is_pair) / num_gt
        score = np.interp(RECALL, recall, match.score, right=0)
        last = (
            np.flatnonzero(score)[-1] if score.any() else 0
        )  # a recall that only score 0 reaches counts as not reached
        if last < first:
            return np.ones(len(TP_ERRORS))
        running = _running_mean(match.errors[:, match.is_pair])
        at = score[first : last + 1]
        pair_score = match.score[match.is_pair][::-1]  # np.interp wants it rising
        return np.array([np.interp(at, pair_score, error[::-1]).mean() for error in running])


def _running_mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of each row (R, M) up to each place, without NaN: 0 before the first number, 1 in a row without any."""
    known = ~np.isnan(values)
    count = np.cumsum(known, axis=1)
    mean = np.cumsum(np.where(known, values, 0.0), axis=1) / np.maximum(count, 1)
    return np.where(count[:, -1:] > 0, mean, 1.0)
