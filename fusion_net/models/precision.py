"""Which number format convolutions run in on this device."""

from contextlib import AbstractContextManager

import torch


def resolve(wanted: str, device: str = "cpu") -> str:
    """ "bf16" or "float32". "auto" takes bf16 only where the processor multiplies it: elsewhere it is emulated and slower."""
    if wanted == "auto":
        if device == "cuda":
            return "bf16" if torch.cuda.is_bf16_supported(including_emulation=False) else "float32"
        has_bf16 = torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()
        return "bf16" if has_bf16 else "float32"
    if wanted not in ("bf16", "float32"):
        raise ValueError(f"trainer.precision={wanted}; there are auto, bf16, float32")
    return wanted


def autocast(wanted: str) -> AbstractContextManager:
    """The context that a model is evaluated in, the same as it was trained in."""
    return torch.autocast("cpu", dtype=torch.bfloat16, enabled=resolve(wanted) == "bf16")
