"""The nuScenes tracking metric (https://www.nuscenes.org/tracking), over any list of classes.

Gives the numbers of nuscenes-devkit 1.2.0 (``tracking_nips_2019``) for the same boxes. AMOTA and AMOTP (Weng et al. 2020,
"3D multi-object tracking: a baseline and new evaluation metrics", arXiv 1907.03961) are means over 40 recalls; the other
figures are of the one score threshold at which MOTA (CLEAR MOT, Bernardin and Stiefelhagen 2008) is highest.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.metrics.clear_mot import MATCH, MISS, SWITCH, Correspondences, Followed
from fusion_net.metrics.track_boxes import TrackBoxes
from fusion_net.metrics.track_paths import Frames, without_holes

TRACKING_CLASSES = ("bicycle", "bus", "car", "motorcycle", "pedestrian", "trailer", "truck")
"""What nuScenes tracks: of its ten classes those that move."""
FIGURES = (
    "amota", "amotp", "recall", "motar", "gt", "mota", "motp", "mt", "ml", "faf", "tp", "fp", "fn", "ids", "frag", "tid", "lgd",
)  # fmt: skip
"""By the devkit's names. mt, ml: labels followed in at least 80 % and less than 20 % of their frames; faf: false alarms per 100
frames; tid, lgd: seconds until a track is found, and of its longest gap."""
SUMMED = ("mt", "ml", "tp", "fp", "fn", "ids", "frag")
"""Figures that are added up over classes; of the others the mean is taken."""
WORST = {
    "amota": 0.0,
    "amotp": 2.0,
    "recall": 0.0,
    "motar": 0.0,
    "mota": 0.0,
    "motp": 2.0,
    "mt": 0.0,
    "faf": 500.0,
    "tp": 0.0,
}
"""Of a class that nothing was found of; amotp's also of every recall that is not reached."""
LATEST = 20.0
"""Seconds: tid and lgd of a class that nothing was found of."""
PERIOD = 0.5
"""Seconds from a keyframe to the next, as the devkit counts them."""


@dataclass(frozen=True)
class TrackingMetrics:
    """The score of a set of tracks over K classes."""

    classes: tuple[str, ...]
    values: NDArray[np.float64]  # (K, len(FIGURES)); NaN where a class has no labels or a figure is not defined

    def of(self, name: str) -> dict[str, float]:
        """One figure by class."""
        return dict(zip(self.classes, self.values[:, FIGURES.index(name)].tolist(), strict=True))

    def total(self, name: str) -> float:
        """One figure over all classes that have labels: the sum of counts, the mean of the others (NaN without any)."""
        column = self.values[:, FIGURES.index(name)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # mean of nothing
            return float(np.nansum(column) if name in SUMMED else np.nanmean(column))


@beartype
@dataclass(frozen=True, kw_only=True)
class TrackingMetric:
    """The definition; the defaults are nuScenes' own. ``distance`` in metres."""

    classes: list[str] = field(default_factory=lambda: list(TRACKING_CLASSES))
    distance: float = 2.0
    min_recall: float = 0.1
    num_thresholds: int = 40

    def __call__(self, truth: TrackBoxes, found: TrackBoxes, frames: Frames) -> TrackingMetrics:
        """Score of tracks against labels; both filtered already, labels index ``classes``."""
        return self.summarise(self.correspondences(truth, found, frames))

    def correspondences(self, truth: TrackBoxes, found: TrackBoxes, frames: Frames) -> list[Correspondences]:
        """Labels and predictions of each class, ready to be asked who follows whom."""
        labels = without_holes(truth, frames, mean_scores=False)
        tracks = without_holes(found, frames, mean_scores=True)
        scene = np.sort(frames.scene)
        classes = range(len(self.classes))
        pairs = [(labels[labels.label == label], tracks[tracks.label == label]) for label in classes]
        return [Correspondences(*pair, distance=self.distance, scene=scene) for pair in pairs]

    def summarise(self, by_class: Sequence[Correspondences]) -> TrackingMetrics:
        """The figures of each class that has labels."""
        values = np.full((len(self.classes), len(FIGURES)), np.nan)
        for label, follow in enumerate(by_class):
            if follow.has_labels:
                values[label] = list(self._class_figures(follow).values())
        return TrackingMetrics(tuple(self.classes), values)

    def _class_figures(self, follow: Correspondences) -> dict[str, float]:
        """FIGURES of one class."""
        everything = follow()
        thresholds = self.thresholds(everything.score[everything.event == MATCH], len(everything.event))
        reached = thresholds[~np.isnan(thresholds)]
        if not len(reached):
            return _nothing_found(everything)
        at = {threshold: figures(follow(threshold)) for threshold in np.unique(reached).tolist()}
        curve = {name: np.array([at[threshold][name] for threshold in reached.tolist()]) for name in FIGURES[2:]}
        best = int(np.nanargmax(curve["mota"]))  # of equals that of the highest recall
        missing = self.num_thresholds - len(reached)
        motar, motp = (
            np.nan_to_num(curve["motar"], nan=WORST["amota"]),
            np.nan_to_num(curve["motp"], nan=WORST["amotp"]),
        )
        return {
            "amota": (motar.sum() + missing * WORST["amota"]) / self.num_thresholds,
            "amotp": (motp.sum() + missing * WORST["amotp"]) / self.num_thresholds,
            **{name: float(values[best]) for name, values in curve.items()},
        }

    def thresholds(self, matched: NDArray[np.float64], num_gt: int) -> NDArray[np.float64]:
        """(num_thresholds,) scores at which the recalls from 1 down to ``min_recall`` are reached; NaN where none does.
        ``matched``: scores of all matches. Switches do not count here, as in the devkit."""
        score = np.sort(matched)[::-1]
        wanted = np.linspace(self.min_recall, 1, self.num_thresholds).round(12)
        if not len(score):
            return np.full(self.num_thresholds, np.nan)
        recall = np.arange(1, len(score) + 1) / num_gt
        at = np.interp(wanted, recall, score, right=0)
        return np.where(wanted > recall[-1], np.nan, at)[::-1]


def motar(matches: int, false: int, num_gt: int) -> float:
    """MOTA at a recall, such that it can be 1 at every recall: max(0, 1 - (IDS + FP + FN - (1 - r) P) / (r P)) with the
    recall r of matches among P labels (Weng et al. 2020). NaN without a match."""
    if not matches:
        return np.nan
    recall = matches / num_gt
    wrong = num_gt - matches + false  # misses, switches, false alarms
    return max(0.0, 1 - (wrong - (1 - recall) * num_gt) / (recall * num_gt))


def figures(followed: Followed) -> dict[str, float]:
    """FIGURES of one threshold, but for amota and amotp."""
    event, num_gt = followed.event, len(followed.event)
    matches, switches = int((event == MATCH).sum()), int((event == SWITCH).sum())
    misses, false = num_gt - matches - switches, int(followed.num_found.sum()) - matches - switches
    wrong = misses + switches + false
    tracks = _Tracks(followed)
    return {
        "recall": (matches + switches) / num_gt,
        "motar": motar(matches, false, num_gt),
        "gt": num_gt,
        "mota": max(0.0, 1 - wrong / num_gt),
        "motp": followed.distance.sum() / (matches + switches) if matches + switches else np.nan,
        "mt": int((tracks.share >= 0.8).sum()),
        "ml": int((tracks.share < 0.2).sum()),
        "faf": 100 * false / followed.num_frames,
        "tp": matches,
        "fp": false,
        "fn": misses,
        "ids": switches,
        "frag": tracks.fragmentations,
        "tid": tracks.mean_of_found(tracks.delay),
        "lgd": tracks.mean_of_found(tracks.longest_gap),
    }


class _Tracks:
    """What becomes of each label's track."""

    def __init__(self, followed: Followed) -> None:
        cuts = np.flatnonzero(np.diff(followed.track)) + 1
        is_missed = np.split(followed.event == MISS, cuts)
        self.share = np.array([(~missed).sum() / len(missed) for missed in is_missed])
        self.delay = np.array([PERIOD * missed.argmin() for missed in is_missed])
        gaps = [_runs(missed) for missed in is_missed]
        self.longest_gap = np.array([PERIOD * (stop - start).max(initial=0) for start, stop in gaps])
        self.fragmentations = sum(
            int(((start > 0) & (stop < len(missed))).sum())
            for missed, (start, stop) in zip(is_missed, gaps, strict=True)
        )

    def mean_of_found(self, values: NDArray[np.float64]) -> float:
        """Over the tracks that are followed at all; NaN where none is."""
        return float(values[self.share > 0].mean()) if (self.share > 0).any() else np.nan


def _runs(is_missed: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Start and end of each run of misses."""
    change = np.diff(np.concatenate([[False], is_missed, [False]]).astype(np.int64))
    return np.flatnonzero(change == 1), np.flatnonzero(change == -1)


def _nothing_found(everything: Followed) -> dict[str, float]:
    """FIGURES of a class of which no label is followed."""
    counted = {"ml": len(np.unique(everything.track)), "gt": len(everything.event), "fn": len(everything.event)}
    late = dict.fromkeys(("tid", "lgd"), LATEST)
    known = WORST | counted | late
    return {name: known.get(name, np.nan) for name in FIGURES}
