"""Precision by recall: what AP is the area of."""

import numpy as np
from numpy.typing import NDArray

from fusion_net.metrics.detection import RECALL
from fusion_net.metrics.matching import ClassMatches


def precision_at_recall(match: ClassMatches, distance: int) -> NDArray[np.float64]:
    """(101,) precision at each of RECALL, at the distance threshold of this index; NaN at recalls that are not reached."""
    hits = np.cumsum(match.hit[distance])
    num_gt = match.num_gt.sum()
    if not len(hits) or not hits[-1] or not num_gt:
        return np.full(len(RECALL), np.nan)
    precision = hits / np.arange(1, len(hits) + 1)
    return np.interp(RECALL, hits / num_gt, precision, right=np.nan)
