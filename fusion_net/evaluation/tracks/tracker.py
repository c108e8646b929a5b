"""From boxes to tracks: predict, gate and assign, update; birth and death."""

from dataclasses import dataclass, replace

import numpy as np
from beartype import beartype
from numpy.typing import NDArray

from fusion_net.evaluation.tracks.kalman import PLACE, VELOCITY, Motion
from fusion_net.evaluation.tracks.tracks import Tracks
from fusion_net.models.late.association import associate
from fusion_net.models.late.covariance import gate_of
from fusion_net.models.late.estimates import Estimates


@beartype
@dataclass(frozen=True, kw_only=True)
class Tracker:
    """Tracking by detection with counts, as AB3DMOT (Weng et al. 2020, arXiv 1907.03961) and CenterPoint (Yin et al. 2021,
    arXiv 2006.11275) do it, with the detector's own variances.

    ``acceleration`` (m^2/s^3) and ``speed`` (m/s, of what is seen first and has no velocity) by class. A detection within
    the gate (of probability ``gate``) continues a track of its class, assigned by the least sum of squared Mahalanobis
    distances. A detection of at least ``birth_score`` that no track takes begins one. A track is reported from its
    ``min_hits``-th detection on and through ``shown_misses`` keyframes without one; it ends after ``max_misses``. Its score
    is the last detection's, times ``decay`` for each keyframe since.
    """

    classes: list[str]
    acceleration: dict[str, float]
    speed: dict[str, float]
    gate: float
    birth_score: float
    min_hits: int
    max_misses: int
    shown_misses: int
    decay: float

    def __post_init__(self) -> None:
        gate_of(self.gate)
        for key in ("acceleration", "speed"):
            known = getattr(self, key)
            for name in self.classes:
                if not known.get(name, 0.0) > 0:
                    raise ValueError(
                        f"tracker: {key} of {name!r} is {known.get(name, 'not given')}; write a number above 0"
                    )
        for key, least in (("min_hits", 1), ("max_misses", 0), ("shown_misses", 0)):
            if getattr(self, key) < least:
                raise ValueError(f"tracker: {key}={getattr(self, key)} must be at least {least}")
        for key in ("birth_score", "decay"):
            if not 0 <= getattr(self, key) <= 1:
                raise ValueError(f"tracker: {key}={getattr(self, key)} must be from 0 to 1")

    def step(self, tracks: Tracks, found: Estimates, *, seconds: float, next_number: int) -> Tracks:
        """The tracks after a keyframe, ``seconds`` after the one before, in which ``found`` (GLOBAL frame) was detected.
        New ones are numbered from ``next_number`` on."""
        motion = tracks.motion.predict(seconds, self._by_label(self.acceleration, tracks.boxes.label))
        place = found.boxes.center[:, PLACE]
        pairs = associate(
            motion.mean[:, PLACE], motion.cov[:, PLACE, PLACE], place, found.cov,
            label_a=tracks.boxes.label, label_b=found.boxes.label, gate=self.gate,
        )  # fmt: skip
        own, other = pairs.T
        is_lost, is_new = np.ones(len(tracks), np.bool_), found.boxes.score >= self.birth_score
        is_lost[own] = is_new[other] = False
        lost = self._without(tracks[is_lost].moved(motion[is_lost]))
        return Tracks.join(
            [self._with(tracks[own], motion[own], found[other]), lost, self._begun(found[is_new], next_number)]
        )

    def shown(self, tracks: Tracks) -> Tracks:
        """Those that are reported."""
        return tracks[(tracks.hits >= self.min_hits) & (tracks.misses <= self.shown_misses)]

    def _with(self, tracks: Tracks, motion: Motion, found: Estimates) -> Tracks:
        """Tracks with the detection of each."""
        motion = motion.update(found.boxes.center[:, PLACE], found.cov, PLACE)
        motion = motion.update(found.boxes.velocity, found.velocity_cov, VELOCITY)
        seen = replace(
            tracks,
            boxes=found.boxes,
            probability=found.probability,
            hits=tracks.hits + 1,
            misses=np.zeros_like(tracks.misses),
        )
        return seen.moved(motion)

    def _without(self, tracks: Tracks) -> Tracks:
        """Tracks without a detection, those that have had too few left out."""
        tracks = tracks[tracks.misses < self.max_misses]
        boxes = replace(tracks.boxes, score=self.decay * tracks.boxes.score)
        return replace(tracks, boxes=boxes, probability=self.decay * tracks.probability, misses=tracks.misses + 1)

    def _begun(self, found: Estimates, next_number: int) -> Tracks:
        """A track for each detection."""
        motion = Motion.begin(
            found.boxes.center[:, PLACE], found.cov, found.boxes.velocity, found.velocity_cov,
            speed=self._by_label(self.speed, found.boxes.label),
        )  # fmt: skip
        number = next_number + np.arange(len(found))
        ones = np.ones(len(found), np.int64)
        return Tracks(number, motion, found.boxes, found.probability, ones, 0 * ones).moved(motion)

    def _by_label(self, values: dict[str, float], label: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.array([values[name] for name in self.classes])[label]
