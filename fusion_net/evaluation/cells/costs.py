"""What a detector costs: processor time by stage, bytes that go where sensors meet, parameters that hang on a sensor."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from statistics import median
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch

REPEATS = 5
"""Timed passes, after one that is not."""
FIELDS = {"camera": ("images",), "lidar": ("lidar_points",), "radar": ("radar_points",)}
"""What each sensor gives of a batch."""


@torch.inference_mode()
def stage_times(model: nn.Module, batch: Batch) -> dict[str, float]:
    """Milliseconds of processor time a sample: of each part that is called as a module, of decoding, and of all."""
    spent: dict[str, list[float]] = defaultdict(list)
    with _timing(dict(parts(model)), spent):
        for _ in range(REPEATS + 1):
            start = time.process_time()
            outputs = model(batch, present=batch.present)
            between = time.process_time()
            model.decode(outputs)  # type: ignore[operator]
            spent["decoding"].append(time.process_time() - between)
            spent["total"].append(time.process_time() - start)
    return {name: 1e3 * median(values[-REPEATS:]) / batch.size for name, values in spent.items()}


def parts(model: nn.Module) -> Iterator[tuple[str, nn.Module]]:
    """The stages of a model by name: its children, and those of its dictionaries of modules."""
    for name, child in model.named_children():
        if isinstance(child, nn.ModuleDict):
            yield from ((f"{inner} {name.rstrip('s')}", module) for inner, module in child.items())
        else:
            yield name, child


@torch.inference_mode()
def dependent_parameters(model: nn.Module, batch: Batch, sensor: str) -> tuple[int, int]:
    """How many parameters work on what ``sensor`` gives, and how many there are: those of the modules whose input changes when
    that sensor sees the scene mirrored. They have learned with it, and learn anew when it is swapped."""
    owners = {module for module in model.modules() if any(True for _ in module.parameters(recurse=False))}
    first, second = (_inputs(model, owners, each) for each in (batch, mirrored(batch, sensor)))
    changed = {module for module in owners if not np.allclose(first[module], second[module], rtol=1e-6)}
    count = sum(p.numel() for module in changed for p in module.parameters(recurse=False))
    return count, sum(p.numel() for p in model.parameters())


def mirrored(batch: Batch, sensor: str) -> Batch:
    """The batch in which left and right are exchanged for one sensor."""
    if sensor == "camera":
        return replace(batch, images=batch.images.flip(-1))
    name, sides = {"lidar": ("lidar_points", [1]), "radar": ("radar_points", [1, 5])}[sensor]
    points = getattr(batch, name).clone()
    points[:, sides] *= -1
    return replace(batch, **{name: points})


def input_bytes(batch: Batch) -> dict[str, float]:
    """Bytes a sample that each sensor gives."""
    return {name: sum(nbytes(getattr(batch, field)) for field in FIELDS[name]) / batch.size for name in MODALITIES}


def nbytes(value: Any) -> int:
    """Bytes of the tensors and arrays in nested values."""
    if isinstance(value, Tensor):
        return value.numel() * value.element_size()
    if isinstance(value, np.ndarray):
        return value.nbytes
    if isinstance(value, dict):
        return sum(map(nbytes, value.values()))
    if isinstance(value, list | tuple):
        return sum(map(nbytes, value))
    return sum(nbytes(getattr(value, f.name)) for f in fields(value)) if is_dataclass(value) else 0


@torch.inference_mode()
def merged_bytes(model: nn.Module, batch: Batch) -> dict[str, float]:
    """Bytes a sample that each sensor sends to where it first meets another one: class scores and points to a painter (early
    fusion), maps to a fuser (mid), boxes with their covariances to an association (late)."""
    found: dict[str, int] = {}

    def painted(module: nn.Module, inputs: tuple, outputs: tuple) -> None:
        predictions = outputs[1]
        scores = {} if predictions is None else {"camera": nbytes(predictions.class_logits)}
        found.update({"lidar": nbytes(inputs[0].lidar_points)} | scores)

    def fused(module: nn.Module, inputs: tuple) -> None:
        found.update({name: nbytes(bev) for name, bev in inputs[0].items() if name not in found})

    handles = [
        module.register_forward_hook(painted) for name, module in model.named_modules() if name.endswith(".painter")
    ]
    if isinstance(fuser := getattr(model, "fuser", None), nn.Module):
        handles.append(fuser.register_forward_pre_hook(fused))
    outputs = model(batch, present=batch.present)
    for handle in handles:
        handle.remove()
    if hasattr(model, "estimates"):
        for of_sample in model.estimates(outputs):  # type: ignore[operator]
            for name, estimates in of_sample.items():
                found[name] = found.get(name, 0) + nbytes(estimates)
    return {name: count / batch.size for name, count in found.items()}


@contextmanager
def _timing(modules: dict[str, nn.Module], spent: dict[str, list[float]]) -> Iterator[None]:
    handles, started = [], dict[str, float]()

    def before(name: str) -> Callable:
        return lambda module, inputs: started.__setitem__(name, time.process_time())

    def after(name: str) -> Callable:
        return lambda module, inputs, outputs: spent[name].append(time.process_time() - started[name])

    for name, module in modules.items():
        handles += [module.register_forward_pre_hook(before(name)), module.register_forward_hook(after(name))]
    try:
        yield
    finally:
        for handle in handles:
            handle.remove()


def _inputs(model: nn.Module, owners: set[nn.Module], batch: Batch) -> dict[nn.Module, list[float]]:
    """Of each module a weighted sum of its input tensors in each call."""
    sums: dict[nn.Module, list[float]] = defaultdict(list)

    def note(module: nn.Module, inputs: tuple) -> None:
        for each in (each.double().flatten() for each in inputs if isinstance(each, Tensor)):
            sums[module].append(float(each @ torch.arange(len(each)).double().cos()))

    handles = [module.register_forward_pre_hook(note) for module in owners]
    try:
        model(batch, present=batch.present)
    finally:
        for handle in handles:
            handle.remove()
    return sums
