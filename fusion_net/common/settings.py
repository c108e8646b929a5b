"""Values of settings, and two sets of settings compared."""

from typing import Any

Number = float | int
"""What a setting in metres or seconds may be: YAML writes 0 for 0.0."""


def differences(old: Any, new: Any, path: str = "") -> list[str]:
    """Of two nested mappings, the dotted names that differ, each with both values."""
    if isinstance(old, dict) and isinstance(new, dict):
        return [d for key in sorted({*old, *new}) for d in differences(old.get(key), new.get(key), f"{path}.{key}")]
    return [] if old == new else [f"{path[1:]}: {old} there, {new} asked for"]
