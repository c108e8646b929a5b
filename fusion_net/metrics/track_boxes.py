"""Boxes with the identity of what they follow: what the tracking metric compares and a tracking result file stores."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion_net.metrics.sample_boxes import SampleBoxes, labelled
from fusion_net.nuscenes.annotations import Annotations


@dataclass(frozen=True)
class TrackBoxes:
    """N boxes of many samples (GLOBAL frame), each with the name of its track, which a sample has at most once and a track
    keeps within its scene."""

    table: SampleBoxes
    track: NDArray[np.str_]  # (N,)

    def __len__(self) -> int:
        return len(self.table)

    def __getitem__(self, index) -> "TrackBoxes":
        """The rows at an index array or mask."""
        return TrackBoxes(self.table[index], self.track[index])

    def relabel(self, source: Sequence[str], target: Sequence[str]) -> "TrackBoxes":
        """The boxes whose class is also in ``target``, with labels that index it."""
        kept = np.isin([source[label] for label in self.table.boxes.label], target)
        return replace(self[kept], table=self.table.relabel(source, target))


def labelled_tracks(annotations: Sequence[Annotations]) -> TrackBoxes:
    """Ground truth of S samples: a track is an instance."""
    return TrackBoxes(labelled(annotations), np.concatenate([np.zeros(0, "U1"), *(a.instance for a in annotations)]))
