"""Labels of a split, and the score of predictions against them: over the configured classes on the grid, and officially."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusion_net.bev_grid import BEVGrid
from fusion_net.boxes import CLASSES, Boxes
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.data.nuscenes import NuScenes
from fusion_net.geometry import invert
from fusion_net.metrics.detection import DetectionMetric, DetectionMetrics
from fusion_net.metrics.matching import ClassMatches
from fusion_net.metrics.results import predicted
from fusion_net.metrics.sample_boxes import SampleBoxes, labelled, to_global

FOOTNOTES = (
    "mAP, NDS, errors and AP: over the configured classes; labels and predictions within the class's range of the car"
    " and on the BEV grid, labels with at least one LiDAR or radar point.",
    "official: all ten classes all around the car with nuScenes' own ranges and filters, as the devkit computes it; what"
    " lies off the grid counts as missed.",
)


class GroundTruth:
    """Labels and poses of S samples, filtered once. ``classes`` are the model's: the labels of its boxes index them.

    ``tokens`` has the samples in the order of their tree's sample table. That is the devkit's, and equal scores are ranked
    by it. Boxes are compared in the global frame.
    """

    def __init__(self, samples: Sequence[tuple[NuScenes, str]], *, classes: Sequence[str], grid: BEVGrid) -> None:
        samples = table_order(samples)
        self.tokens, self.classes, self.grid = [token for _, token in samples], list(classes), grid
        self.global_T_ego = reference_poses(samples)
        self.scenes = np.array([tree.scene(token)["token"] for tree, token in samples], dtype=np.str_)
        self.metric, self.official_metric = DetectionMetric(classes=self.classes), DetectionMetric()
        everything = labelled([tree.annotations(token, CLASSES) for tree, token in samples])
        self.labels = self._on_rig(everything.relabel(CLASSES, self.classes))
        self.official_labels = everything[self._in_range(everything, self.official_metric)]

    def table(self, found: Sequence[Boxes]) -> SampleBoxes:
        """Predictions in the ego frame, one entry a token, as one table in the global frame: what a result file holds."""
        return predicted([to_global(*pair) for pair in zip(found, self.global_T_ego, strict=True)], self.classes)

    def matches(self, found: SampleBoxes) -> list[ClassMatches]:
        """Who takes whom, over the configured classes."""
        return self.metric.match(self.labels, self._on_rig(found), len(self.tokens))

    def official(self, found: SampleBoxes) -> DetectionMetrics:
        """The devkit's score."""
        found = found.relabel(self.classes, CLASSES)
        found = found[self._in_range(found, self.official_metric)]
        return self.official_metric(self.official_labels, found, len(self.tokens))

    def _in_range(self, boxes: SampleBoxes, metric: DetectionMetric) -> NDArray[np.bool_]:
        return boxes.within(self.global_T_ego[:, :2, 3], metric.label_range)

    def _on_rig(self, boxes: SampleBoxes) -> SampleBoxes:
        """Boxes in range whose centre is on the grid."""
        ego_T_global = invert(self.global_T_ego)[boxes.sample]
        center = np.einsum("nij,nj->ni", ego_T_global[:, :3, :3], boxes.boxes.center) + ego_T_global[:, :3, 3]
        return boxes[self._in_range(boxes, self.metric) & self.grid.contains(center[:, :2])]


def ground_truth(dataset: NuScenesDataset) -> GroundTruth:
    """Labels of a dataset's split, for its classes and its grid."""
    return GroundTruth(dataset.index, classes=dataset.classes, grid=dataset.grid)


def score(truth: GroundTruth, found: Sequence[Boxes]) -> DetectionMetrics:
    """Score over the configured classes of predictions in the ego frame, one entry a token of ``truth``."""
    return truth.metric.summarise(truth.matches(truth.table(found)))


def table_order(samples: Sequence[tuple[NuScenes, str]]) -> list[tuple[NuScenes, str]]:
    """Samples tree by tree, in each by its sample table."""
    trees = list(dict.fromkeys(tree for tree, _ in samples))
    wanted = {token for _, token in samples}
    return [(tree, token) for tree in trees for token in tree.tables["sample"] if token in wanted]


def reference_poses(samples: Sequence[tuple[NuScenes, str]]) -> NDArray[np.float64]:
    """``global_T_ego`` (S, 4, 4) at the reference time of each sample."""
    return np.array([tree.global_T_ego(tree.reference(token)) for tree, token in samples]).reshape(-1, 4, 4)
