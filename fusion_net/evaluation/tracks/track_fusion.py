"""Tracks of several sensors, each tracked apart, become one list: track-to-track fusion.

Tracks of one object share the noise of its motion and often a calibration and a clock, so their errors correlate although
their detections do not (Bar-Shalom 1981, "On the track-to-track correlation problem", IEEE TAC 26). How much is not known:
they are merged by covariance intersection.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.common.checks import check_probabilities
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.tracks.kalman import PLACE, Motion
from fusion_net.evaluation.tracks.tracks import Tracks
from fusion_net.models.late.association import associate
from fusion_net.models.late.covariance import gate_of, mahalanobis_squared
from fusion_net.models.late.fuse import ORDER, merge_pairs
from fusion_net.models.late.merging import covariance_intersection
from fusion_net.models.late.scores import Score, combine


@dataclass(frozen=True)
class FusedTracks:
    """N tracks and whose they are made of."""

    tracks: Tracks
    members: NDArray[np.int64]  # (N, M) by MODALITIES: number of that sensor's track, -1 for none

    @staticmethod
    def empty() -> "FusedTracks":
        """No tracks."""
        return FusedTracks(Tracks.empty(), np.zeros((0, len(MODALITIES)), np.int64))


@beartype
@dataclass(frozen=True, kw_only=True)
class TrackFusion:
    """How tracks of several sensors become one list.

    Tracks of one class that are not yet of one object join by the gate of probability ``gate`` and the best assignment.
    What was one object stays one while its members keep within the wider gate of probability ``keep_gate`` of each other.
    ``score``: one of SCORES; ``prior``: of an object before its scores are seen, for ``bayes``.
    """

    gate: float
    keep_gate: float
    score: Score
    prior: float

    def __post_init__(self) -> None:
        if gate_of(self.keep_gate) < gate_of(self.gate):
            raise ValueError(f"fusion: keep_gate={self.keep_gate} must be at least gate={self.gate}")
        check_probabilities(prior=self.prior)

    def __call__(self, before: FusedTracks, sensors: Mapping[str, Tracks], *, next_number: int) -> FusedTracks:
        """The tracks of one keyframe by sensor, any of them empty or not there, as one list. ``before``: what this gave for the
        keyframe before.

        Of two names that become one the older stays, and one that a sensor loses stays as long as another has it. New ones are
        numbered from ``next_number`` on.
        """
        fused = FusedTracks.empty()
        for sensor in ORDER:
            if sensor in sensors:
                fused = self._joined(fused, _alone(sensors[sensor], sensor, before))
        number = fused.tracks.number.copy()
        is_new = number < 0
        number[is_new] = next_number + np.arange(is_new.sum())
        boxes = replace(fused.tracks.boxes, score=combine(fused.tracks.probability, self.score, prior=self.prior))
        return replace(fused, tracks=replace(fused.tracks, number=number, boxes=boxes))

    def _joined(self, a: FusedTracks, b: FusedTracks) -> FusedTracks:
        """The list so far and one sensor's, partners merged."""
        old = self._still_together(a.tracks, b.tracks)
        parted = np.isin(b.tracks.number, a.tracks.number)
        parted[old[:, 1]] = False
        number = np.where(parted, -1, b.tracks.number)  # it left its object, which keeps the name
        b = replace(b, tracks=replace(b.tracks, number=number))
        free_a, free_b = (np.setdiff1d(np.arange(len(x.tracks)), pair) for x, pair in zip((a, b), old.T, strict=True))
        first, second = a.tracks[free_a], b.tracks[free_b]
        new = associate(
            first.motion.mean[:, PLACE], first.motion.cov[:, PLACE, PLACE],
            second.motion.mean[:, PLACE], second.motion.cov[:, PLACE, PLACE],
            label_a=first.boxes.label, label_b=second.boxes.label, gate=self.gate,
        )  # fmt: skip
        pairs = np.concatenate([old, np.stack([free_a[new[:, 0]], free_b[new[:, 1]]], axis=1)])
        left_a, left_b = (np.setdiff1d(np.arange(len(x.tracks)), p) for x, p in zip((a, b), pairs.T, strict=True))
        merged = _merged(a.tracks[pairs[:, 0]], b.tracks[pairs[:, 1]])
        both = np.maximum(a.members[pairs[:, 0]], b.members[pairs[:, 1]])
        return FusedTracks(
            Tracks.join([merged, a.tracks[left_a], b.tracks[left_b]]),
            np.concatenate([both, a.members[left_a], b.members[left_b]]),
        )

    def _still_together(self, a: Tracks, b: Tracks) -> NDArray[np.int64]:
        """(P, 2) rows of one name that are still near each other."""
        rows = np.argwhere((a.number[:, None] == b.number[None]) & (b.number[None] >= 0))
        own, other = a[rows[:, 0]].motion, b[rows[:, 1]].motion
        cov = own.cov[:, PLACE, PLACE] + other.cov[:, PLACE, PLACE]
        return rows[mahalanobis_squared((own.mean - other.mean)[:, PLACE], cov) < gate_of(self.keep_gate)]


def _alone(tracks: Tracks, sensor: str, before: FusedTracks) -> FusedTracks:
    """One sensor's tracks under the names that they had in the fused list, -1 for none."""
    column = MODALITIES.index(sensor)
    name = dict(zip(before.members[:, column].tolist(), before.tracks.number.tolist(), strict=True))
    members = np.full((len(tracks), len(MODALITIES)), -1)
    members[:, column] = tracks.number
    number = np.array([name.get(own, -1) for own in tracks.number.tolist()], np.int64)
    probability = np.full(members.shape, np.nan)
    probability[:, column] = tracks.boxes.score
    return FusedTracks(replace(tracks, number=number, probability=probability), members)


def _merged(a: Tracks, b: Tracks) -> Tracks:
    """Tracks merged with their partners, one by one: place and velocity together by covariance intersection, the rest of
    the boxes as those of detections."""
    box = merge_pairs(a.estimates, b.estimates, "covariance_intersection")
    motion = Motion(*covariance_intersection(a.motion.mean, a.motion.cov, b.motion.mean, b.motion.cov))
    number = np.where((a.number < 0) | (b.number < 0), np.maximum(a.number, b.number), np.minimum(a.number, b.number))
    hits, misses = np.maximum(a.hits, b.hits), np.minimum(a.misses, b.misses)
    return Tracks(number, motion, box.boxes, box.probability, hits, misses).moved(motion)
