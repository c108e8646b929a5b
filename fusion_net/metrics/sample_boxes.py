"""The boxes of many samples in one table: what the detection metric compares and the result file stores."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import transform, wrap_angle, yaw_of
from fusion_net.nuscenes.annotations import Annotations


@dataclass(frozen=True)
class SampleBoxes:
    """N boxes in the GLOBAL frame, sample by sample. Their order decides ties, as the order of a result file does."""

    boxes: Boxes  # label indexes the metric's classes
    sample: NDArray[np.int64]  # (N,) index of the sample
    attribute: NDArray[np.str_]  # (N,) name or ""
    num_pts: NDArray[np.int64]  # (N,) LiDAR and radar points of a label; -1 for predictions, which nothing is known of

    def __len__(self) -> int:
        return len(self.sample)

    def __getitem__(self, index) -> "SampleBoxes":
        """The rows at an index array, mask or slice."""
        return SampleBoxes(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def relabel(self, source: Sequence[str], target: Sequence[str]) -> "SampleBoxes":
        """The boxes whose class is also in ``target``, with labels that index it."""
        label_of = np.array([target.index(name) if name in target else -1 for name in source], np.int64)
        label = label_of[self.boxes.label] if len(source) else self.boxes.label
        kept = self[label >= 0]
        return replace(kept, boxes=replace(kept.boxes, label=label[label >= 0]))


def stack(per_sample: Sequence[Boxes], attributes: Sequence[NDArray], num_pts: Sequence[NDArray]) -> SampleBoxes:
    """One table of the boxes of S samples, with the attribute names and point counts of each."""
    rows = [len(boxes) for boxes in per_sample]
    parts = [Boxes.empty(), *per_sample]
    boxes = Boxes(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Boxes)})
    return SampleBoxes(
        boxes=boxes,
        sample=np.repeat(np.arange(len(rows)), rows),
        attribute=np.concatenate([np.zeros(0, "U1"), *attributes]).astype(np.str_),
        num_pts=np.concatenate([np.zeros(0, np.int64), *num_pts]),
    )


def labelled(annotations: Sequence[Annotations]) -> SampleBoxes:
    """Ground truth of S samples."""
    return stack([a.boxes for a in annotations], [a.attribute for a in annotations], [a.num_pts for a in annotations])


def to_global(boxes: Boxes, global_T_ego: NDArray[np.float64]) -> Boxes:
    """Boxes of an ego frame in the global frame. A box stays upright: only its heading follows the pose."""
    velocity = np.nan_to_num(boxes.velocity) @ global_T_ego[:2, :2].T
    return replace(
        boxes,
        center=transform(global_T_ego, boxes.center),
        yaw=wrap_angle(boxes.yaw + yaw_of(global_T_ego)),
        velocity=np.where(np.isnan(boxes.velocity), np.nan, velocity),
    )
