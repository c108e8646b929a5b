"""What the parts of a detector return: an encoder, and the model as a whole.

Axes: B batch, N cameras, h/w image features, C channels, D depth bins, K classes, Y/X BEV rows and columns.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from torch import Tensor


@dataclass(frozen=True)
class ImagePredictions:
    """What the camera predicts in the image plane, before anything is lifted: the input of the dense losses."""

    features: Tensor  # (B, N, C, h, w)
    depth_logits: Tensor  # (B, N, D, h, w), over the bins of the image network
    class_logits: Tensor  # (B, N, K, h, w)
    log_depth: Tensor  # (B, N, h, w), log of metres along the optical axis


@dataclass(frozen=True)
class Encoded:
    """What every encoder returns: its BEV map, and the predictions that it made on the way, where it makes any."""

    bev: Tensor  # (B, C, Y, X)
    image: ImagePredictions | None = None


@dataclass(frozen=True)
class Outputs:
    """Maps of the head (see ``center_head.regressions``), and the image predictions if the camera took part.

    ``views``: in training, where there are auxiliary heads, what each encoder's own map says alone: heat map logits
    (B, K, Y, X), and the samples (B,) in which the sensor is present. ``detections``: in evaluation, where boxes take their
    speed from them, each sample's radar detections (R_b, 7).
    """

    maps: dict[str, Tensor]
    image: ImagePredictions | None = None
    views: dict[str, tuple[Tensor, Tensor]] = field(default_factory=dict)
    detections: tuple[NDArray[np.float32], ...] = ()
