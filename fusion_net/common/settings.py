"""Values of settings, two sets of settings compared, and code of the user's own that settings name."""

import importlib
from typing import Any

Number = float | int
"""What a setting in metres or seconds may be: YAML writes 0 for 0.0."""
WHERE_MODULES_ARE = "modules of your own are found beside train.py and in the folders that PYTHONPATH names"


def differences(old: Any, new: Any, path: str = "") -> list[str]:
    """Of two nested mappings, the dotted names that differ, each with both values."""
    if isinstance(old, dict) and isinstance(new, dict):
        return [d for key in sorted({*old, *new}) for d in differences(old.get(key), new.get(key), f"{path}.{key}")]
    return [] if old == new else [f"{path[1:]}: {old} there, {new} asked for"]


def own_object(name: str, *, where: str) -> Any:
    """What ``module.name`` names. ValueError when there is none; ``where`` is the key that names it."""
    module, _, attribute = name.rpartition(".")
    try:
        return getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"{where}={name} cannot be imported: {error}; {WHERE_MODULES_ARE}") from error
