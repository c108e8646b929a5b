"""What the detector is trained to do: box maps where objects are, and dense depth and classes in the image plane."""

from typing import Literal

import torch
import torch.nn.functional as F
from beartype import beartype
from torch import Tensor

from fusion_net.data.batch import Batch, Targets
from fusion_net.models.camera_encoder import Perception
from fusion_net.models.depth_bins import DepthBins


def focal_loss(logits: Tensor, heatmap: Tensor) -> Tensor:
    """Penalty-reduced focal loss (CornerNet, Law & Deng 2018, eq. 1; alpha 2, beta 4) over positives, at least one.

    Logits and Gaussian heat maps in [0, 1] of one shape; the cells that are exactly 1 are the positives.
    """
    positive = heatmap == 1
    probability = logits.sigmoid()
    hit = F.logsigmoid(logits) * (1 - probability) ** 2
    miss = F.logsigmoid(-logits) * probability**2 * (1 - heatmap) ** 4
    return -torch.where(positive, hit, miss).sum() / positive.sum().clamp(min=1)


def masked_l1(values: Tensor, target: Tensor) -> Tensor:
    """Mean over objects of the summed absolute error of values (M, C); NaN targets count nothing."""
    known = target.isfinite()
    error = torch.where(known, values - torch.where(known, target, 0.0), 0.0).abs()
    return error.sum() / known.all(dim=1).sum().clamp(min=1)


def center_nll(maps: dict[str, Tensor], targets: Targets, *, cell: float, reach: int, joint: bool = False) -> Tensor:
    """Gaussian negative log-likelihood of each object's centre under the centre and variance *as they are decoded*.

    At an object's own cell the error is under a cell whatever the sensors. What a tracker or a late fusion needs is the
    error of the peak that will stand for the object: the strongest of the (2 * reach + 1)^2 cells around it. With
    ``joint`` the centres learn from it too; else only the variances do.
    """
    sample, row, column = targets.mask.nonzero(as_tuple=True)
    if not len(sample):
        return maps["log_variance"].sum() * 0.0
    r, c, moved, inside = _window(targets.mask, row, column, reach)
    label = targets.heatmap[sample, :, row, column].argmax(dim=1)
    heat = maps["heatmap"].detach()[sample[:, None], label[:, None], r, c]
    peak = heat.masked_fill(~inside, -torch.inf).argmax(dim=1)
    own = torch.arange(len(peak), device=peak.device)
    r, c = r[own, peak], c[own, peak]
    center = maps["offset"][sample, :, r, c] + moved[peak] * cell
    error = (center if joint else center.detach()) - targets.offset[sample, :, row, column]
    log_variance = maps["log_variance"][sample, :, r, c].clamp(-8.0, 6.0)
    return (0.5 * (log_variance + error**2 * (-log_variance).exp())).sum(dim=1).mean()


def _window(mask: Tensor, row: Tensor, column: Tensor, reach: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The W = (2 * reach + 1)^2 cells around each of M cells of ``mask`` (B, Y, X): rows and columns (M, W) clamped to the
    map, steps (W, 2) along x and y, and which lie on the map (M, W)."""
    step = torch.arange(-reach, reach + 1, device=row.device)
    near_row, near_column = (x.flatten() for x in torch.meshgrid(step, step, indexing="ij"))
    r, c = row[:, None] + near_row, column[:, None] + near_column
    rows, columns = mask.shape[1:]
    inside = (r >= 0) & (r < rows) & (c >= 0) & (c < columns)
    return r.clamp(0, rows - 1), c.clamp(0, columns - 1), torch.stack([near_column, near_row], dim=1), inside


def depth_loss(logits: Tensor, depth: Tensor, weight: Tensor, bins: DepthBins) -> Tensor:
    """Cross-entropy of depth bins (B, N, D, h, w) over cells whose depth (B, N, h, w) lies in them, weighted."""
    index = bins.index(depth)
    weight = weight * (index >= 0)
    chosen = logits.log_softmax(dim=2).gather(2, index.clamp(min=0)[:, :, None])[:, :, 0]
    return -(chosen * weight).sum() / weight.sum().clamp(min=1)


@beartype
class DetectionLoss:
    """Weighted losses by name. The weights are those that a study on generated scenes found to work in minutes.

    ``depth_supervision``: "none", "lidar" (the cells that a return falls on) or "dense" (exact depth, where generated).
    The box is learnt in the cells up to ``spread`` from an object's own, since its peak may come to lie there; the variance
    at the strongest of those up to ``reach``. ``object_weight``: how much more a depth cell on an object counts: detection
    follows the depth of objects.
    """

    def __init__(
        self,
        *,
        bins: DepthBins,
        cell: float,
        depth_supervision: Literal["none", "lidar", "dense"] = "dense",
        heatmap: float = 1.0,
        offset: float = 0.5,
        height: float = 0.5,
        size: float = 0.5,
        rot: float = 0.5,
        velocity: float = 0.5,
        log_variance: float = 0.1,
        joint_variance: bool = False,
        depth: float = 0.3,
        log_depth: float = 0.3,
        classes: float = 0.5,
        object_weight: float = 4.0,
        reach: int = 3,
        spread: int = 1,
    ) -> None:
        self.bins, self.cell, self.depth_supervision = bins, cell, depth_supervision
        self.regressions = {"offset": offset, "height": height, "size": size, "rot": rot, "velocity": velocity}
        self.heatmap_weight, self.variance_weight, self.joint_variance = heatmap, log_variance, joint_variance
        self.reach, self.spread = reach, spread
        self.depth_weight, self.log_depth_weight, self.class_weight = depth, log_depth, classes
        self.object_weight = object_weight

    def __call__(self, maps: dict[str, Tensor], camera: Perception | None, batch: Batch) -> dict[str, Tensor]:
        """All terms that the batch has labels for, and their sum as "loss"."""
        terms = self.boxes(maps, batch.targets)
        if camera is not None:
            terms |= self.camera(camera, batch)
        return self.total(terms)

    @staticmethod
    def total(terms: dict[str, Tensor]) -> dict[str, Tensor]:
        """The terms with "loss", their sum."""
        return terms | {"loss": torch.stack(list(terms.values())).sum()}

    def boxes(self, maps: dict[str, Tensor], targets: Targets | None) -> dict[str, Tensor]:
        """Terms of the bird's-eye view."""
        if targets is None:
            raise ValueError("loss: the batch has no targets; the reader makes them for training and validation only")
        sample, row, column = targets.mask.nonzero(as_tuple=True)
        terms = {"loss/heatmap": self.heatmap_weight * focal_loss(maps["heatmap"], targets.heatmap)}
        r, c, moved, inside = _window(targets.mask, row, column, self.spread)
        own = (moved == 0).all(dim=1)
        inside = inside & (own | ~targets.mask[sample[:, None], r, c])  # a cell that is another object's own is its
        for name, weight in self.regressions.items():
            target = getattr(targets, name)[sample, :, row, column][:, None].expand(-1, len(own), -1)
            target = target - moved * self.cell if name == "offset" else target
            values = maps[name][sample[:, None], :, r, c]
            terms[f"loss/{name}"] = weight * masked_l1(values[inside], target[inside])
        nll = center_nll(maps, targets, cell=self.cell, reach=self.reach, joint=self.joint_variance)
        return terms | {"loss/log_variance": self.variance_weight * nll}

    def camera(self, seen: Perception, batch: Batch) -> dict[str, Tensor]:
        """Terms of the image plane; depth is supervised by LiDAR whether or not the model sees the LiDAR."""
        terms = {}
        objects = (
            torch.zeros_like(batch.lidar_depth, dtype=torch.bool) if batch.class_map is None else batch.class_map >= 0
        )
        depth = {"none": None, "lidar": batch.lidar_depth, "dense": batch.dense_depth}[self.depth_supervision]
        if depth is None and self.depth_supervision == "dense":
            raise ValueError("loss: depth_supervision=dense needs exact depth, which this data has not; use lidar")
        if depth is not None:
            weight = 1 + self.object_weight * objects
            known = weight * (depth > 0)
            error = (seen.log_depth - depth.clamp(min=0.1).log()).abs()
            terms["loss/depth"] = self.depth_weight * depth_loss(seen.depth_logits, depth, weight, self.bins)
            terms["loss/log_depth"] = self.log_depth_weight * (error * known).sum() / known.sum().clamp(min=1)
        if batch.class_map is not None:
            names = torch.arange(seen.class_logits.shape[2], device=batch.class_map.device).view(-1, 1, 1)
            one_hot = (batch.class_map[:, :, None] == names).float()
            terms["loss/classes"] = self.class_weight * focal_loss(seen.class_logits, one_hot)
        return terms or {"loss/classes": seen.class_logits.sum() * 0.0}
