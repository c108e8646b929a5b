"""Losses of the detector: box maps in the bird's-eye view, dense depth and classes in the image plane."""

import math
from typing import Literal

import torch
import torch.nn.functional as F
from beartype import beartype
from torch import Tensor

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.checks import check_not_negative
from fusion_net.data.batch import Batch, Targets
from fusion_net.models.blocks.depth_bins import DepthBins
from fusion_net.models.blocks.heading import axis_of, is_forwards
from fusion_net.models.blocks.outputs import ImagePredictions, Outputs

REGRESSED = ("offset", "height", "size", "rot", "axis", "velocity")
"""Box maps that are learned by an L1 loss, where the head has them."""

WEIGHTS = ("heatmap", *REGRESSED, "direction", "log_variance", "aux_heatmap", "depth", "log_depth", "classes")
"""Names of the weighted losses: those of the bird's-eye view, then those of the image plane."""

SYMMETRIC = ("barrier", "traffic_cone")
"""Classes whose two ends look the same: nuScenes scores barriers' headings modulo pi, and cones' not at all."""


def focal_loss(logits: Tensor, heatmap: Tensor, class_weights: list[float] | None = None) -> Tensor:
    """Penalty-reduced focal loss (CornerNet, Law & Deng 2018, eq. 1; alpha 2, beta 4) over positives, at least one.

    Logits and Gaussian heat maps in [0, 1] of one shape; the cells that are exactly 1 are the positives. ``class_weights``:
    of each class of maps (..., K, H, W), hits and misses alike, so that a score goes on to mean a probability.
    """
    positive = heatmap == 1
    probability = logits.sigmoid()
    hit = F.logsigmoid(logits) * (1 - probability) ** 2
    miss = F.logsigmoid(-logits) * probability**2 * (1 - heatmap) ** 4
    loss = torch.where(positive, hit, miss)
    if class_weights is not None:
        loss = loss * loss.new_tensor(class_weights)[:, None, None]
    return -loss.sum() / positive.sum().clamp(min=1)


def masked_l1(values: Tensor, target: Tensor) -> Tensor:
    """Mean over objects of the summed absolute error of values (M, C); NaN targets do not count."""
    known = target.isfinite()
    error = torch.where(known, values - torch.where(known, target, 0.0), 0.0).abs()
    return error.sum() / known.all(dim=1).sum().clamp(min=1)


def nearer_end(rot: Tensor, target: Tensor, symmetric: Tensor) -> Tensor:
    """Of the two equal headings, target and -target (M, 2: sin, cos of yaw), of a ``symmetric`` (M,) body the one nearer to the
    prediction ``rot``. The mean of both, which is learned where labels hold either, would be no heading at all."""
    is_turned = symmetric & ((rot.detach() * target).sum(dim=-1) < 0)
    return torch.where(is_turned[:, None], -target, target)


def binary_loss(logits: Tensor, truth: Tensor) -> Tensor:
    """Mean cross-entropy of logits (M,) and bools (M,); 0 where there are none."""
    return F.binary_cross_entropy_with_logits(logits, truth.to(logits), reduction="sum") / max(len(logits), 1)


def center_nll(maps: dict[str, Tensor], targets: Targets, *, grid: BEVGrid, radius: int) -> Tensor:
    """Gaussian negative log-likelihood of each object's centre under the centre and variance *as they are decoded*.

    At an object's own cell the error is under a cell whatever the sensors. What a tracker or a late fusion needs is the
    error of the peak that will be decoded as the object: the strongest of the (2 * radius + 1)^2 cells around it. Only the
    variances learn from it, not the centres.
    """
    sample, row, column = targets.mask.nonzero(as_tuple=True)
    if not len(sample):
        return maps["log_variance"].sum() * 0.0
    r, c, _, inside = _window(targets.mask, row, column, radius)
    label = targets.heatmap[sample, :, row, column].argmax(dim=1)
    heat = maps["heatmap"].detach()[sample[:, None], label[:, None], r, c]
    peak = heat.masked_fill(~inside, -torch.inf).argmax(dim=1)
    own = torch.arange(len(peak), device=peak.device)
    r, c = r[own, peak], c[own, peak]
    center = maps["offset"][sample, :, r, c].detach() + grid.between((row, column), (r, c))
    error = center - targets.offset[sample, :, row, column]
    log_variance = maps["log_variance"][sample, :, r, c].clamp(-8.0, 6.0)
    return (0.5 * (log_variance + error**2 * (-log_variance).exp())).sum(dim=1).mean()


def _window(mask: Tensor, row: Tensor, column: Tensor, radius: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The W = (2 * radius + 1)^2 cells around each of M cells of ``mask`` (B, Y, X): rows and columns (M, W) clamped to the
    map, steps (W, 2) along x and y, and which lie on the map (M, W)."""
    offsets = torch.arange(-radius, radius + 1, device=row.device)
    rows_away, columns_away = (x.flatten() for x in torch.meshgrid(offsets, offsets, indexing="ij"))
    r, c = row[:, None] + rows_away, column[:, None] + columns_away
    rows, columns = mask.shape[1:]
    inside = (r >= 0) & (r < rows) & (c >= 0) & (c < columns)
    return r.clamp(0, rows - 1), c.clamp(0, columns - 1), torch.stack([columns_away, rows_away], dim=1), inside


def depth_loss(logits: Tensor, depth: Tensor, weight: Tensor, bins: DepthBins) -> Tensor:
    """Weighted cross-entropy of depth bins (B, N, D, h, w) over feature cells whose depth (B, N, h, w) lies in the bins."""
    index = bins.index(depth)
    weight = weight * (index >= 0)
    chosen = logits.log_softmax(dim=2).gather(2, index.clamp(min=0)[:, :, None])[:, :, 0]
    return -(chosen * weight).sum() / weight.sum().clamp(min=1)


@beartype
class DetectionLoss:
    """Weighted losses by name: ``weights`` has one for each of WEIGHTS; ``classes`` are those of the heat map.

    ``depth_supervision``: "none", "lidar" (the feature cells that a return falls on) or "dense" (exact depth, where
    generated). A box is regressed in the cells up to ``box_radius`` from the object's own cell, since its peak may come to
    lie there; its variance at the strongest of the cells up to ``peak_radius``. ``object_weight``: how much more a feature
    cell on an object counts in the depth losses, since detection follows the depth of objects. ``class_weights``: how much a
    class counts in the heat maps, ``pixel_class_weights`` in the class scores of the image plane; None: as much as it is
    frequent, and in images large, of which a small network learns little of bicycles and cones.
    """

    def __init__(
        self,
        *,
        bins: DepthBins,
        grid: BEVGrid,
        classes: list[str],
        depth_supervision: Literal["none", "lidar", "dense"],
        weights: dict[str, float | int],
        object_weight: float,
        peak_radius: int,
        box_radius: int,
        class_weights: dict[str, float | int] | None = None,  # as runs were trained before there were any
        pixel_class_weights: dict[str, float | int] | None = None,
    ) -> None:
        check_weights(weights)
        check_not_negative(object_weight=object_weight, peak_radius=peak_radius, box_radius=box_radius)
        self.bins, self.grid, self.depth_supervision, self.weights = bins, grid, depth_supervision, weights
        self.object_weight, self.peak_radius, self.box_radius = object_weight, peak_radius, box_radius
        self.class_weights = _by_class("class_weights", class_weights, classes)
        self.pixel_class_weights = _by_class("pixel_class_weights", pixel_class_weights, classes)
        self.symmetric = [label for label, name in enumerate(classes) if name in SYMMETRIC]

    def __call__(self, outputs: Outputs, batch: Batch) -> dict[str, Tensor]:
        """All terms that the batch has labels for, and their sum as "loss"."""
        terms = self.box_terms(outputs.maps, batch.targets) | self.view_terms(outputs.views, batch.targets)
        if outputs.image is not None:
            terms |= self.image_terms(outputs.image, batch)
        return self.total(terms)

    @staticmethod
    def total(terms: dict[str, Tensor]) -> dict[str, Tensor]:
        """The terms with "loss", their sum."""
        return terms | {"loss": torch.stack(list(terms.values())).sum()}

    def _weighted(self, terms: dict[str, Tensor]) -> dict[str, Tensor]:
        return {f"loss/{name}": self.weights[name] * value for name, value in terms.items()}

    def box_terms(self, maps: dict[str, Tensor], targets: Targets | None) -> dict[str, Tensor]:
        """Terms of the bird's-eye view."""
        if targets is None:
            raise ValueError("loss: the batch has no targets; the reader makes them for training and validation only")
        sample, row, column = targets.mask.nonzero(as_tuple=True)
        terms = {"heatmap": focal_loss(maps["heatmap"], targets.heatmap, self.class_weights)}
        r, c, step, inside = _window(targets.mask, row, column, self.box_radius)
        to_neighbour = self.grid.between((row[:, None], column[:, None]), (r, c))
        own = (step == 0).all(dim=1)
        inside = inside & (
            own | ~targets.mask[sample[:, None], r, c]
        )  # another object's own cell is left to that object

        def around(name: str) -> Tensor:
            """A map's values (M, W, C) in the cells around each object."""
            return maps[name][sample[:, None], :, r, c]

        rot = targets.rot[sample, :, row, column]
        label = targets.heatmap[sample, :, row, column].argmax(dim=1)
        is_symmetric = torch.isin(label, label.new_tensor(self.symmetric))[:, None].expand(-1, len(own))
        for name in (name for name in REGRESSED if name in maps):
            target = axis_of(rot) if name == "axis" else getattr(targets, name)[sample, :, row, column]
            target = target[:, None].expand(-1, len(own), -1)
            target = target - to_neighbour if name == "offset" else target
            values, target = around(name)[inside], target[inside]
            target = nearer_end(values, target, is_symmetric[inside]) if name == "rot" else target
            terms[name] = masked_l1(values, target)
        if "direction" in maps:
            has_front = inside & ~is_symmetric
            forwards = is_forwards(rot)[:, None].expand(-1, len(own))
            terms["direction"] = binary_loss(around("direction")[..., 0][has_front], forwards[has_front])
        terms["log_variance"] = center_nll(maps, targets, grid=self.grid, radius=self.peak_radius)
        return self._weighted(terms)

    def view_terms(self, views: dict[str, tuple[Tensor, Tensor]], targets: Targets | None) -> dict[str, Tensor]:
        """The heat map loss of each encoder's own map, over the samples that have the sensor, as a mean over sensors."""
        if targets is None or not views:
            return {}
        each = [
            focal_loss(logits[there], targets.heatmap[there], self.class_weights) for logits, there in views.values()
        ]
        return self._weighted({"aux_heatmap": torch.stack(each).mean()})

    def image_terms(self, image: ImagePredictions, batch: Batch) -> dict[str, Tensor]:
        """Terms of the image plane; LiDAR supervises depth whether or not the model has the LiDAR as an input."""
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
            error = (image.log_depth - depth.clamp(min=0.1).log()).abs()
            terms["depth"] = depth_loss(image.depth_logits, depth, weight, self.bins)
            terms["log_depth"] = (error * known).sum() / known.sum().clamp(min=1)
        if batch.class_map is not None:
            index = torch.arange(image.class_logits.shape[2], device=batch.class_map.device).view(-1, 1, 1)
            one_hot = (batch.class_map[:, :, None] == index).float()
            terms["classes"] = focal_loss(image.class_logits, one_hot, self.pixel_class_weights)
        return self._weighted(terms or {"classes": image.class_logits.sum() * 0.0})


def check_weights(weights: dict[str, float | int]) -> None:
    """Raises ValueError unless there is a finite weight of at least 0 for each of WEIGHTS and for nothing else."""
    for name in weights:
        if name not in WEIGHTS:
            raise ValueError(f"weights: there is no loss {name!r}; choose from {', '.join(WEIGHTS)}")
    if missing := [name for name in WEIGHTS if name not in weights]:
        raise ValueError(f"weights: no weight for {', '.join(missing)}")
    for name, weight in weights.items():
        if not 0 <= weight < math.inf:
            raise ValueError(f"weights: {name}={weight} must be a finite number of at least 0")


def _by_class(name: str, weights: dict[str, float | int] | None, classes: list[str]) -> list[float] | None:
    """The weights in the order of the classes. ValueError unless each class has a positive one."""
    if weights is None:
        return None
    for label in classes:
        if not 0 < weights.get(label, 0) < math.inf:
            raise ValueError(f"losses: {name}.{label}={weights.get(label)} must be a finite number above 0")
    return [float(weights[label]) for label in classes]
