"""What is looked at to see whether a run is well: the gradient by part, and the batch that ended it."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from fusion_net.common.atomic import replacing
from fusion_net.data.batch import Batch
from fusion_net.models.fusion_net import FusionNet


def gradient_norms(model: FusionNet) -> dict[str, Tensor]:
    """Euclidean norm of the gradient of each encoder, or detector of late fusion, by its name, of the "rest", and of "all". The
    image network is the camera's, whichever encoder it is in. A part without a gradient, because it is frozen or has no place
    in the stage, is left out."""
    grads: dict[str, list[Tensor]] = {}
    for name, parameter in model.named_parameters():
        if parameter.grad is not None:
            top, below, *_ = parts = name.split(".")
            part = "camera" if "image_network" in parts else below if top in ("encoders", "detectors") else "rest"
            grads.setdefault(part, []).append(parameter.grad)
    norms = {part: _norm(list(torch._foreach_norm(each))) for part, each in grads.items()}
    return norms | {"all": _norm(list(norms.values()))}


def _norm(norms: list[Tensor]) -> Tensor:
    return torch.linalg.vector_norm(torch.stack(norms))


def save_nonfinite(
    path: Path, batch: Batch, losses: dict[str, Tensor], model: FusionNet, *, step: int, stage: str
) -> None:
    """Writes all that the loss was computed from, as tensors, numbers and strings alone: ``torch.load(path)`` reads it with
    ``weights_only``. "batch" without its boxes and "targets" are the fields of :class:`Batch` and :class:`Targets`, with the
    sensors in ``present`` that the samples kept; "model" are the weights before the step."""
    state: dict[str, Any] = {"step": step, "stage": stage, "tokens": batch.tokens}
    state["losses"] = {name: value.detach() for name, value in losses.items()}
    state["batch"] = {f.name: getattr(batch, f.name) for f in fields(batch) if f.name not in ("targets", "boxes")}
    state["targets"] = batch.targets and {f.name: getattr(batch.targets, f.name) for f in fields(batch.targets)}
    state["model"] = model.state_dict()
    with replacing(path) as file:
        torch.save(state, file)
