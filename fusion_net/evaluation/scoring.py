"""Labels of a split, and the score of predictions against them: over the configured classes on the grid, and officially."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import invert
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.metrics.box_filter import BoxFilter
from fusion_net.metrics.detection import CLASS_RANGE, DetectionMetric, DetectionMetrics
from fusion_net.metrics.matching import ClassMatches
from fusion_net.metrics.results import predicted
from fusion_net.metrics.sample_boxes import SampleBoxes, labelled, to_global
from fusion_net.nuscenes.nuscenes import NuScenes

_RANGES = ", ".join(
    f"{reach:g} m ({', '.join(name.replace('_', ' ') for name in CLASSES if CLASS_RANGE[name] == reach)})"
    for reach in sorted(set(CLASS_RANGE.values()))
)
FOOTNOTES = (
    "mAP, NDS, errors and AP: over the configured classes, for what is on the BEV grid and passes nuScenes' filter.",
    "official: what the nuScenes devkit computes from results_nusc.json: over all ten classes and all around the car, for what"
    " passes the filter; a class that has no label or that the model does not know counts 0, a label off the grid is missed.",
    f"filter: labels and predictions within {_RANGES} of the car; labels with at least one LiDAR or radar point; no bicycle"
    " or motorcycle in a bicycle rack.",
)


class GroundTruth:
    """Labels and poses of S samples, filtered once. ``classes`` are the model's: the labels of its boxes index them.
    ``visibility``: of each label, as :class:`fusion_net.nuscenes.annotations.Annotations` has it.

    ``tokens`` has the samples in the order of their data set's sample table. That is the devkit's, and equal scores are ranked
    by it. Boxes are compared in the global frame.
    """

    def __init__(self, samples: Sequence[tuple[NuScenes, str]], *, classes: Sequence[str], grid: BEVGrid) -> None:
        samples = table_order(samples)
        self.tokens, self.classes, self.grid = [token for _, token in samples], list(classes), grid
        self.global_T_ego = reference_poses(samples)
        self.scenes = np.array([nusc.scene(token)["token"] for nusc, token in samples], dtype=np.str_)
        self.metric, self.official_metric = DetectionMetric(classes=self.classes), DetectionMetric()
        self._filter = BoxFilter(self.global_T_ego[:, :2, 3], [nusc.racks(token) for nusc, token in samples])
        annotations = [nusc.annotations(token, self.classes) for nusc, token in samples]
        configured = labelled(annotations)
        counts = self.counts(configured)
        self.labels = configured[counts]
        self.visibility = np.concatenate([np.zeros(0, np.int64), *(each.visibility for each in annotations)])[counts]
        everything = labelled([nusc.annotations(token, CLASSES) for nusc, token in samples])
        self.official_labels = everything[self.counts_officially(everything)]

    def table(self, found: Sequence[Boxes]) -> SampleBoxes:
        """Predictions in the ego frame, one entry a token, as one table in the global frame: what a result file holds."""
        return predicted([to_global(*pair) for pair in zip(found, self.global_T_ego, strict=True)], self.classes)

    def matches(self, found: SampleBoxes) -> list[ClassMatches]:
        """Who takes whom, over the configured classes."""
        return self.metric.match(self.labels, self.counted(found), len(self.tokens))

    def official_matches(self, found: SampleBoxes) -> list[ClassMatches]:
        """Who takes whom, over nuScenes' ten classes, on the grid or off it."""
        found = found.relabel(self.classes, CLASSES)
        found = found[self.counts_officially(found)]
        return self.official_metric.match(self.official_labels, found, len(self.tokens))

    def official(self, found: SampleBoxes) -> DetectionMetrics:
        """The devkit's score."""
        return self.official_metric.summarise(self.official_matches(found))

    def counted(self, found: SampleBoxes) -> SampleBoxes:
        """The predictions that are scored."""
        return found[self.counts(found)]

    def in_ego(self, boxes: SampleBoxes) -> NDArray[np.float64]:
        """Centres (N, 3) in the ego frame of their sample."""
        ego_T_global = invert(self.global_T_ego)[boxes.sample]
        return np.einsum("nij,nj->ni", ego_T_global[:, :3, :3], boxes.boxes.center) + ego_T_global[:, :3, 3]

    def counts(self, boxes: SampleBoxes) -> NDArray[np.bool_]:
        """(N,) boxes of the configured classes that nuScenes counts and whose centre is on the grid."""
        return self._filter(boxes, self.metric) & self.grid.contains(self.in_ego(boxes)[:, :2])

    def counts_officially(self, boxes: SampleBoxes) -> NDArray[np.bool_]:
        """(N,) boxes of CLASSES that nuScenes counts, on the grid or off it."""
        return self._filter(boxes, self.official_metric)


def ground_truth(dataset: NuScenesDataset) -> GroundTruth:
    """Labels of a dataset's split, for its classes and its grid."""
    return GroundTruth(dataset.index, classes=dataset.classes, grid=dataset.grid)


def score(truth: GroundTruth, found: Sequence[Boxes]) -> DetectionMetrics:
    """Score over the configured classes of predictions in the ego frame, one entry a token of ``truth``."""
    return truth.metric.summarise(truth.matches(truth.table(found)))


def table_order(samples: Sequence[tuple[NuScenes, str]]) -> list[tuple[NuScenes, str]]:
    """Samples data set by data set, in each by its sample table."""
    datasets = list(dict.fromkeys(nusc for nusc, _ in samples))
    wanted = {token for _, token in samples}
    return [(nusc, token) for nusc in datasets for token in nusc.tables["sample"] if token in wanted]


def reference_poses(samples: Sequence[tuple[NuScenes, str]]) -> NDArray[np.float64]:
    """``global_T_ego`` (S, 4, 4) at the reference time of each sample."""
    return np.array([nusc.global_T_ego(nusc.reference(token)) for nusc, token in samples]).reshape(-1, 4, 4)
