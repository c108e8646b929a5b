"""Tracks as paths without holes, as nuScenes evaluates them (``create_tracks`` of nuscenes-devkit 1.2.0).

The filter takes boxes out of the middle of a track: labels without a point, what is out of range for a moment. They are put
back on the straight line between their neighbours, for labels and predictions alike.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fusion_net.metrics.track_boxes import TrackBoxes


@dataclass(frozen=True)
class Frames:
    """The S samples that boxes index: in scenes, one after the other in time."""

    scene: NDArray[np.int64]  # (S,) number of the scene
    timestamp: NDArray[np.int64]  # (S,) microseconds

    @property
    def rank(self) -> NDArray[np.int64]:
        """(S,) place of each sample by scene and time: a scene's samples have consecutive ones."""
        rank = np.empty(len(self.scene), np.int64)
        rank[np.lexsort([self.timestamp, self.scene])] = np.arange(len(self.scene))
        return rank


@dataclass(frozen=True)
class Paths:
    """N boxes of tracks without holes, sorted by frame; of those of one frame the ones that were put in come last."""

    frame: NDArray[np.int64]  # (N,) rank of the sample
    track: NDArray[np.int64]  # (N,) number of the track, one for each scene that its name occurs in
    label: NDArray[np.int64]  # (N,)
    xy: NDArray[np.float64]  # (N, 2) metres, GLOBAL frame
    score: NDArray[np.float64]  # (N,)

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, index) -> "Paths":
        """The boxes at an index array or mask."""
        return Paths(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


def without_holes(boxes: TrackBoxes, frames: Frames, *, mean_scores: bool) -> Paths:
    """The boxes as paths. ``mean_scores``: every box of a track gets the mean of the track's scores, as predictions do.

    ValueError where a sample has a track twice.
    """
    frame = frames.rank[boxes.table.sample]
    order = np.argsort(frame, kind="stable")
    frame, boxes = frame[order], boxes[order]
    _refuse_twice(boxes, frame)
    _, name = np.unique(boxes.track, return_inverse=True)
    _, first, track = np.unique(
        frames.scene[boxes.table.sample] * len(boxes) + name, return_index=True, return_inverse=True
    )
    track = np.argsort(np.argsort(first))[track]  # numbered as they appear
    score = boxes.table.boxes.score
    if mean_scores and len(boxes):
        of_track = np.split(score[np.argsort(track, kind="stable")], np.cumsum(np.bincount(track))[:-1])
        score = np.array([scores.mean() for scores in of_track])[track]
    paths = Paths(frame, track, boxes.table.boxes.label, boxes.table.boxes.center[:, :2], score)
    return _filled(paths, frames.timestamp[np.argsort(frames.rank)])


def _filled(paths: Paths, time: NDArray[np.int64]) -> Paths:
    """The paths with what they miss between their first and last box. ``time`` (S,) of the frames, microseconds.

    The devkit gives the neighbour before the weight that belongs to the one after and the other way round, which shows in
    holes of two frames and more; so do we, to give its figures.
    """
    order = np.lexsort([paths.frame, paths.track])
    left, right = order[:-1], order[1:]
    missed = np.where(paths.track[left] == paths.track[right], paths.frame[right] - paths.frame[left] - 1, 0)
    left, right = np.repeat(left, missed), np.repeat(right, missed)
    step = np.arange(len(left)) - np.repeat(np.cumsum(missed) - missed, missed)
    frame = paths.frame[left] + 1 + step
    weight = (time[paths.frame[right]] - time[frame]) / (time[paths.frame[right]] - time[paths.frame[left]])
    between = Paths(
        frame,
        paths.track[right],
        paths.label[right],
        (1 - weight[:, None]) * paths.xy[left] + weight[:, None] * paths.xy[right],
        (1 - weight) * paths.score[left] + weight * paths.score[right],
    )
    between = between[np.argsort(between.track, kind="stable")]
    both = Paths(*(np.concatenate([getattr(p, f.name) for p in (paths, between)]) for f in fields(Paths)))
    return both[np.argsort(both.frame, kind="stable")]


def _refuse_twice(boxes: TrackBoxes, frame: NDArray[np.int64]) -> None:
    """ValueError for a track that is twice in a frame."""
    order = np.lexsort([boxes.track, frame])
    twice = (frame[order][1:] == frame[order][:-1]) & (boxes.track[order][1:] == boxes.track[order][:-1])
    if twice.any():
        name = str(boxes.track[order][1:][twice][0])
        raise ValueError(f"tracks: the track {name!r} is twice in one sample; names must differ")
