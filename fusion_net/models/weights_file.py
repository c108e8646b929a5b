"""Weights to hand on: one small file that torch reads without running code, with all that explains them beside them.

``{"format", "weights": {name: tensor}, "config", "table", "manifest", "record"}``: the settings and what the run was, its drop
table, and how the data was generated that it was trained on.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from fusion_net.common.atomic import replacing

FORMAT = 1
LARGEST = 10_000_000
"""Bytes that a file of weights may have."""
PARTS = ("weights", "config", "table", "manifest", "record")


def compact(weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The same weights in as many bits as the file has room for: float32, else bfloat16. ValueError where that is too much."""
    room = LARGEST - 500_000  # for the rest
    for kind in (torch.float32, torch.bfloat16):
        kept = {name: value.to(kind) if value.is_floating_point() else value for name, value in weights.items()}
        if sum(value.numel() * value.element_size() for value in kept.values()) <= room:
            return {name: value.contiguous() for name, value in kept.items()}
    numbers = sum(value.numel() for value in weights.values()) / 1e6
    raise ValueError(f"{numbers:.1f} M weights do not fit into {LARGEST / 1e6:.0f} MB; ship a smaller model")


def write_weights(path: Path, **parts: Any) -> None:
    """Writes PARTS, all of them plain values but the weights."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        torch.save({"format": FORMAT} | {name: parts[name] for name in PARTS}, file)


def read_weights(path: Path) -> dict[str, Any]:
    """PARTS. ValueError when the file is none of these, or of another format."""
    try:
        held = torch.load(path, map_location="cpu", weights_only=True)
        is_ours = isinstance(held, dict) and {*PARTS, "format"} <= held.keys()
    except OSError:
        raise
    except Exception as error:  # torch raises many kinds for a truncated or foreign file
        raise ValueError(
            f"{path} is no readable file of weights ({type(error).__name__}); check it out again, or make it:"
            f" python eval.py run=runs/NAME ship={path}"
        ) from error
    if not is_ours or held["format"] != FORMAT:
        raise ValueError(f"{path} is no file of weights that eval.py ship=FILE writes, or of another version of it")
    return {name: held[name] for name in PARTS}


def fit_weights(model: nn.Module, weights: Mapping[str, Tensor], source: Path) -> None:
    """Loads ``weights`` into ``model``. ValueError when they belong to another model; ``source`` names them."""
    own = model.state_dict()
    unlike = {name: "is not there" for name in own if name not in weights}
    unlike |= {
        name: f"is {list(weights[name].shape)} there and {list(own[name].shape)} here"
        for name in own
        if name in weights and weights[name].shape != own[name].shape
    }
    unlike |= {name: "is not in this model" for name in weights if name not in own}
    if unlike:
        first = next(iter(unlike))
        raise ValueError(
            f"{source} is of another model: {len(unlike)} tensors differ, the first is '{first}', which {unlike[first]}"
        )
    model.load_state_dict(dict(weights))
