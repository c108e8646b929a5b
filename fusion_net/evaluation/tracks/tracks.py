"""The tracks of one scene at one time."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.tracks.kalman import PLACE, VELOCITY, Motion
from fusion_net.models.late.estimates import Estimates


@dataclass(frozen=True)
class Tracks:
    """N tracks, GLOBAL frame. Height, size and heading of a box are those of its last detection; its place on the ground and
    velocity are those of the motion."""

    number: NDArray[np.int64]  # (N,) identity within the scene
    motion: Motion
    boxes: Boxes
    probability: NDArray[np.float64]  # (N, M) by MODALITIES, NaN where that sensor has no part in the track
    hits: NDArray[np.int64]  # (N,) detections so far
    misses: NDArray[np.int64]  # (N,) keyframes since the last one

    def __len__(self) -> int:
        return len(self.number)

    def __getitem__(self, index) -> "Tracks":
        """The tracks at an index array, mask or slice."""
        return Tracks(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    @staticmethod
    def empty() -> "Tracks":
        """No tracks."""
        motion, none = Motion(np.zeros((0, 4)), np.zeros((0, 4, 4))), np.zeros(0, np.int64)
        return Tracks(none, motion, Boxes.empty(), np.zeros((0, len(MODALITIES))), none, none)

    @staticmethod
    def join(parts: "list[Tracks]") -> "Tracks":
        """All of several lists, one after the other."""
        columns = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ("number", "probability", "hits", "misses")
        }
        boxes = {f.name: np.concatenate([getattr(part.boxes, f.name) for part in parts]) for f in fields(Boxes)}
        return Tracks(motion=Motion.join([part.motion for part in parts]), boxes=Boxes(**boxes), **columns)

    def moved(self, motion: Motion) -> "Tracks":
        """The tracks where ``motion`` has them."""
        center = np.concatenate([motion.mean[:, PLACE], self.boxes.center[:, 2:]], axis=1)
        variance = np.diagonal(motion.cov, axis1=1, axis2=2)[:, PLACE]
        boxes = replace(self.boxes, center=center, velocity=motion.mean[:, VELOCITY], log_variance=np.log(variance))
        return replace(self, motion=motion, boxes=boxes)

    @property
    def estimates(self) -> Estimates:
        """The tracks as estimates of boxes."""
        cov = self.motion.cov
        unknown = np.full(len(self), -1)
        return Estimates(self.boxes, cov[:, PLACE, PLACE], cov[:, VELOCITY, VELOCITY], self.probability, unknown)
