"""Labelled tracks of a split, and the score of tracks against them: over the configured classes on the grid, and officially."""

from collections.abc import Sequence

import numpy as np

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.evaluation.scoring import GroundTruth, table_order
from fusion_net.evaluation.tracks.tracks import Tracks
from fusion_net.metrics.clear_mot import Correspondences
from fusion_net.metrics.sample_boxes import stack
from fusion_net.metrics.track_boxes import TrackBoxes, labelled_tracks
from fusion_net.metrics.track_paths import Frames
from fusion_net.metrics.tracking import TRACKING_CLASSES, TrackingMetric, TrackingMetrics
from fusion_net.nuscenes.nuscenes import NuScenes


class TrackTruth:
    """Labelled tracks of S samples, filtered once. ``classes`` are the model's: the labels of its boxes index them.

    ``tokens`` has the samples in the order of their data set's sample table, as those of ``truth``, the labels that single
    boxes are scored by. Tracks are compared in the global frame.
    """

    def __init__(self, samples: Sequence[tuple[NuScenes, str]], *, classes: Sequence[str], grid: BEVGrid) -> None:
        samples = table_order(samples)
        self.truth = GroundTruth(samples, classes=classes, grid=grid)
        self.tokens, self.classes = self.truth.tokens, self.truth.classes
        _, scene = np.unique(self.truth.scenes, return_inverse=True)
        times = np.array([nusc.get("sample", token)["timestamp"] for nusc, token in samples], np.int64)
        self.frames = Frames(scene, times)
        self.metric = TrackingMetric(classes=[name for name in TRACKING_CLASSES if name in self.classes])
        self.official_metric = TrackingMetric()
        everything = labelled_tracks([nusc.annotations(token, CLASSES) for nusc, token in samples])
        self.labels = self.on_grid(everything.relabel(CLASSES, self.classes))
        self.official_labels = self._official(everything)

    def table(self, found: Sequence[Tracks]) -> TrackBoxes:
        """Tracks, one entry a token, as one table: what a result file holds."""
        boxes = stack(
            [tracks.boxes for tracks in found],
            [np.full(len(tracks), "", np.str_) for tracks in found],
            [np.full(len(tracks), -1) for tracks in found],
        )
        number = np.concatenate([np.zeros(0, np.int64), *(tracks.number for tracks in found)])
        return TrackBoxes(boxes, number.astype(np.str_))

    def correspondences(self, found: TrackBoxes) -> list[Correspondences]:
        """Labels and tracks of each class of ``metric``, for what is on the grid."""
        return self.metric.correspondences(self.labels, self.on_grid(found), self.frames)

    def official(self, found: TrackBoxes) -> TrackingMetrics:
        """The devkit's score, of labels that index CLASSES or of the model's."""
        return self.official_metric(
            self.official_labels, self._official(found.relabel(self.classes, CLASSES)), self.frames
        )

    def on_grid(self, tracks: TrackBoxes) -> TrackBoxes:
        """Tracks whose labels index the model's classes: what of them counts, with labels that index the metric's."""
        return tracks[self.truth.counts(tracks.table)].relabel(self.classes, self.metric.classes)

    def _official(self, tracks: TrackBoxes) -> TrackBoxes:
        return tracks[self.truth.counts_officially(tracks.table)].relabel(CLASSES, TRACKING_CLASSES)
