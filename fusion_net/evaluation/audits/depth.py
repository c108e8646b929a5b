"""The camera's depth against the LiDAR's: cell by cell of its feature map, and at each visible object.

Judged is the distribution that lifts the features, by its mean: what it gets wrong lands in the wrong cell of the bird's-eye
view. Abs-rel and the shares within 1.25, 1.25^2 and 1.25^3 are those of Eigen et al. 2014 (arXiv 1406.2283).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from fusion_net.common.geometry import invert, project, transform
from fusion_net.data.batch import Batch
from fusion_net.evaluation.audits.result import Audit
from fusion_net.models.encoders.camera_encoder import CameraEncoder

Array = NDArray[np.float64]

RANGES = (("0-20 m", 0.0, 20.0), ("20-35 m", 20.0, 35.0), ("35-58 m", 35.0, 58.0))
"""Metres along the optical axis."""
FEWEST_NEAR = 0.6
"""Share of the cells that have to be within 1.25. Not their mean abs-rel: a LiDAR sees drops of fog and rain as well, and what
the camera says of the road behind a drop at 2 m is no error of the camera."""
FLATTEST = 0.9
"""Entropy, as a share of the entropy of no knowledge, from which on a distribution says nothing."""
FAR_OFF = 1.25
"""An object is taken for too far, or too near, from this ratio of depths on."""
FEWEST_CELLS = 100


@dataclass(frozen=True)
class DepthCells:
    """P places of feature maps where the LiDAR, or the exact depth, says how far it is."""

    found: Array  # (P,) metres along the optical axis: mean of the distribution
    regressed: Array  # (P,) metres: the one depth at which class scores are placed; 0 where there is none
    lidar: Array  # (P,) metres of the nearest return; 0 where none
    exact: Array  # (P,) metres; 0 where none, or where the data do not say
    entropy: Array  # (P,) of the distribution, 1 for no knowledge at all
    top: Array  # (P,) probability of its likeliest bin
    token: NDArray[np.str_]  # (P,) sample
    label: NDArray[np.int64]  # (P,) class of the object there, -1 where it is not asked for an object

    def __getitem__(self, index) -> "DepthCells":
        return DepthCells(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


@torch.inference_mode()
def read_depths(camera: CameraEncoder | None, batches: Iterable[Batch]) -> tuple[DepthCells, DepthCells]:
    """Every cell with a LiDAR return or an exact depth, and one cell per visible labelled object: that of its centre. None
    of either without a camera."""
    cells, objects = [], []
    for batch in batches:
        if camera is None or not batch.images.numel():
            continue
        maps = _maps(camera, batch)
        tokens = np.repeat(np.array(batch.tokens), maps["found"][0].size)
        flat = DepthCells(
            **{name: values.reshape(-1) for name, values in maps.items()},
            token=tokens,
            label=np.full(len(tokens), -1),
        )
        cells.append(flat[(flat.lidar > 0) | (flat.exact > 0)])
        objects += [_at_objects(batch, place, maps, camera.view_transform.stride) for place in range(len(batch.boxes))]
    return _joined(cells), _joined(objects)


def _maps(camera: CameraEncoder, batch: Batch) -> dict[str, Array]:
    """The float columns of DepthCells as maps (B, N, h, w)."""
    probability, regressed = camera.depth(camera.perceive(batch), batch)
    probability = probability.double()
    centers = camera.view_transform.bins.centers().double()
    entropy = torch.special.entr(probability).sum(dim=-1) / np.log(len(centers))
    exact = torch.zeros_like(batch.lidar_depth) if batch.dense_depth is None else batch.dense_depth
    maps: dict[str, Tensor] = {
        "found": (probability * centers.to(probability.device)).sum(dim=-1),
        "regressed": regressed,
        "lidar": batch.lidar_depth,
        "exact": exact,
        "entropy": entropy,
        "top": probability.amax(dim=-1),
    }
    return {name: values.double().cpu().numpy() for name, values in maps.items()}


def _at_objects(batch: Batch, place: int, maps: Mapping[str, Array], stride: int) -> DepthCells:
    """The cells at the centres of a sample's objects, where the depth there is that of the object: nothing is in front."""
    boxes, (rows, columns) = batch.boxes[place], maps["found"].shape[2:]
    found: list[tuple[int, int, int, int]] = []  # camera, row, column, label
    for camera in range(batch.images.shape[1]):
        in_camera = transform(invert(batch.ego_T_cam[place, camera].double().cpu().numpy()), boxes.center)
        pixels, z = project(batch.cam_K[place, camera].double().cpu().numpy(), in_camera)
        column, row = np.floor(np.nan_to_num(pixels, nan=-1.0) / stride).astype(int).T
        inside = (z > 1) & (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        for k in np.flatnonzero(inside):
            at = (place, camera, row[k], column[k])
            depth = maps["exact"][at] or maps["lidar"][at]
            if depth > 0 and abs(depth - z[k]) < boxes.wlh[k].max() / 2 + 0.5:
                found.append((camera, row[k], column[k], int(boxes.label[k])))
    index = tuple(np.array([each[axis] for each in found], np.int64) for axis in range(3))
    return DepthCells(
        **{name: values[place][index] for name, values in maps.items()},
        token=np.full(len(found), batch.tokens[place]),
        label=np.array([each[3] for each in found], np.int64),
    )


def _joined(parts: Sequence[DepthCells]) -> DepthCells:
    none, no_label = np.zeros(0), np.zeros(0, np.int64)
    first = DepthCells(none, none, none, none, none, none, np.zeros(0, np.str_), no_label)
    return DepthCells(
        **{f.name: np.concatenate([getattr(part, f.name) for part in (first, *parts)]) for f in fields(DepthCells)}
    )


def depth_errors(found: Array, truth: Array) -> dict[str, float]:
    """Abs-rel, its median, the mean error in metres (positive: taken for too far), and the shares within 1.25, 1.25^2,
    1.25^3."""
    ratio = np.maximum(found / truth, truth / np.maximum(found, 1e-6))
    shares = {f"within_1.25^{k}": float((ratio < 1.25**k).mean()) for k in (1, 2, 3)}
    error = found - truth
    relative = np.abs(error) / truth
    means = {"abs_rel": float(relative.mean()), "median_abs_rel": float(np.median(relative))}
    return means | {"mean_error": float(error.mean())} | shares


def audit_depth(
    cells: DepthCells, objects: DepthCells, *, condition: Mapping[str, str], classes: Sequence[str]
) -> Audit:
    """``condition``: of each sample, by token. ``classes`` name the labels of ``objects``."""
    known = cells[cells.lidar > 0]
    explanation = (
        "Depth of the camera's features (mean of the distribution that lifts them) against the LiDAR returns in the same"
        f" 8-pixel cells. Wrong where less than {100 * FEWEST_NEAR:g} % of the cells are within 1.25 of the LiDAR's depth, or"
        f" where the mean entropy is above {FLATTEST:g} of that of no knowledge. An object counts as taken for too far from"
        " 1.25 times its depth on. In fog and rain some returns are drops: the LiDAR's error, not the camera's; the exact"
        " depth, where the data have it, tells them apart."
    )
    title = "Depth against LiDAR: does the camera put things at the right distance?"
    if len(known.lidar) < FEWEST_CELLS:
        return Audit("depth", title, f"only {len(known.lidar)} cells with a LiDAR return", None, {}, explanation)
    of_cell = np.array([condition.get(token, "") for token in known.token])
    groups = {name: known[(known.lidar >= low) & (known.lidar < high)] for name, low, high in RANGES}
    groups |= {name: known[of_cell == name] for name in sorted(set(of_cell), key=lambda n: (n != "clear", n)) if name}
    everything = _summary(known)
    numbers: dict[str, Any] = {
        "all": everything,
        "groups": {name: _summary(part) for name, part in groups.items() if len(part.lidar) >= FEWEST_CELLS},
        "regressed": depth_errors(known.regressed, known.lidar) if (known.regressed > 0).all() else None,
        "exact": _against_exact(cells),
        "objects": _objects(objects, classes),
    }
    worst = numbers["objects"]["worst"]
    example = (
        f"; a {_words(worst[0]['class'])} at {worst[0]['depth']:.0f} m was taken for {worst[0]['found']:.0f} m"
        if worst
        else ""
    )
    too_far = numbers["objects"]["too_far"]
    share = "" if too_far is None else f"; {100 * too_far:.0f} % of the visible objects are taken for too far"
    exact = numbers["exact"]
    known_better = f" ({100 * exact['within_1.25^1']:.0f} % of the exact depth)" if exact else ""
    ok = everything["within_1.25^1"] >= FEWEST_NEAR and everything["entropy"] <= FLATTEST
    return Audit(
        "depth",
        title,
        f"{100 * everything['within_1.25^1']:.0f} % within 1.25 of the LiDAR's depth{known_better}, median abs-rel"
        f" {everything['median_abs_rel']:.2f}, entropy {everything['entropy']:.2f} of no knowledge{share}{example}",
        ok,
        numbers,
        explanation,
    )


def _words(name: str) -> str:
    return name.replace("_", " ")


def _summary(cells: DepthCells) -> dict[str, float]:
    sharp = {"entropy": float(cells.entropy.mean()), "top": float(cells.top.mean()), "cells": len(cells.lidar)}
    return depth_errors(cells.found, cells.lidar) | sharp


def _against_exact(cells: DepthCells) -> dict[str, float] | None:
    """Against the exact depth, where the data have it: all cells that are no sky, as far as the bins reach."""
    known = cells[(cells.exact > 0) & (cells.exact < RANGES[-1][2])]
    return depth_errors(known.found, known.exact) if len(known.exact) else None


def _objects(objects: DepthCells, classes: Sequence[str]) -> dict[str, Any]:
    """Range errors by class, and the objects that were taken for farthest away; depths of the scatter for a picture."""
    depth = np.where(objects.exact > 0, objects.exact, objects.lidar)
    ratio = objects.found / np.maximum(depth, 1e-6)
    by_class = {}
    for label, name in enumerate(classes):
        own = objects.label == label
        if own.any():
            by_class[name] = depth_errors(objects.found[own], depth[own]) | {"objects": int(own.sum())}
    worst = [int(k) for k in np.argsort(-ratio)[:5] if ratio[k] > FAR_OFF]
    rows = [
        {"token": str(objects.token[k]), "class": classes[objects.label[k]], "depth": float(depth[k]),
         "found": float(objects.found[k])}
        for k in worst
    ]  # fmt: skip
    return {
        "by_class": by_class,
        "too_far": float((ratio > FAR_OFF).mean()) if len(ratio) else None,
        "too_near": float((ratio < 1 / FAR_OFF).mean()) if len(ratio) else None,
        "worst": rows,
        "depths": np.round(np.stack([depth, objects.found], axis=1)[:2000], 2).tolist(),
    }
