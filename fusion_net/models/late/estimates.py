"""Boxes with the covariances of their places and velocities, and the probability that each detector gives them."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES


@dataclass(frozen=True)
class Estimates:
    """N boxes of one sample in the ego frame, as one detector or several together see them."""

    boxes: Boxes
    cov: NDArray[np.float64]  # (N, 2, 2) of the centre's x and y, m^2
    velocity_cov: NDArray[np.float64]  # (N, 2, 2) of the velocity, (m/s)^2
    probability: NDArray[np.float64]  # (N, M) by MODALITIES, NaN where that detector has no part in the box
    truth: NDArray[np.int64]  # (N,) row of the label that the box is of, for oracles and audits; -1: none, or not known

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index) -> "Estimates":
        """The estimates at an index array, mask or slice."""
        return Estimates(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    @staticmethod
    def empty() -> "Estimates":
        """No estimates."""
        return Estimates(
            Boxes.empty(), np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), np.zeros((0, len(MODALITIES))), np.zeros(0, int)
        )

    @staticmethod
    def join(parts: "list[Estimates]") -> "Estimates":
        """All of several lists, one after the other."""
        parts = parts or [Estimates.empty()]
        columns = {f.name: np.concatenate([getattr(x.boxes, f.name) for x in parts]) for f in fields(Boxes)}
        others = {f.name: np.concatenate([getattr(x, f.name) for x in parts]) for f in fields(Estimates)[1:]}
        return Estimates(boxes=Boxes(**columns), **others)
