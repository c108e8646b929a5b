"""Checkpoints of a run: what Lightning wrote, and the model's weights in it."""

from pathlib import Path
from typing import Any

import torch

from fusion_net.models.weights_file import fit_weights
from fusion_net.runs.sources import found_checkpoint


def load_weights(model: torch.nn.Module, checkpoint: Path) -> None:
    """Loads a checkpoint's model into ``model``. ValueError when it belongs to another model or is damaged."""
    fit_weights(model, model_weights(read_checkpoint(checkpoint)), checkpoint)


def resume_step(model: torch.nn.Module, checkpoint: Path) -> int:
    """The step that a checkpoint was written at. ValueError when it belongs to another model or is damaged."""
    state = read_checkpoint(checkpoint)
    fit_weights(model, model_weights(state), checkpoint)
    return int(state["global_step"])


def read_checkpoint(checkpoint: Path) -> dict[str, Any]:
    """What Lightning wrote. FileNotFoundError or ValueError when it is missing or damaged."""
    found_checkpoint(checkpoint)
    try:
        state = torch.load(checkpoint, map_location="cpu", weights_only=True)
        state["state_dict"].keys()
        return state
    except Exception as error:  # torch raises many kinds for a truncated or foreign file
        raise ValueError(
            f"{checkpoint} is not a readable checkpoint ({type(error).__name__}); {_instead_of(checkpoint)}"
        ) from error


def _instead_of(checkpoint: Path) -> str:
    """What to do without a checkpoint that is damaged."""
    others = [path.stem for path in sorted(checkpoint.parent.glob("*.ckpt")) if path != checkpoint]
    beside = f"checkpoint={others[0]} lies beside it, or " if others and checkpoint.suffix == ".ckpt" else ""
    return f"{beside}train the run again (overwrite=true)"


def model_weights(checkpoint_state: dict[str, Any]) -> dict[str, torch.Tensor]:
    """The averaged weights of the model in a checkpoint."""
    state = checkpoint_state["state_dict"]
    return {key.removeprefix("model."): value for key, value in state.items() if key.startswith("model.")}
