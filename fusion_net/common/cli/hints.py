"""What a ``_target_`` of the settings takes: the names of its arguments, and whole numbers as the floats that it asks for."""

import inspect
import types
from collections.abc import Mapping, Sequence
from typing import Any, Union, get_args, get_origin

from hydra._internal.utils import _locate  # hydra.utils.get_object writes to the log what it cannot find

SPECIAL = ("_target_", "_args_", "_convert_", "_partial_", "_recursive_")
"""Keys of a node that Hydra reads itself."""


def arguments(target: str) -> Mapping[str, inspect.Parameter] | None:
    """The arguments of a class or function by name; None when it cannot be imported (building it says why)."""
    try:
        return inspect.signature(_locate(target)).parameters
    except Exception:  # an import runs any code
        return None


def accepts(target: str | None, name: str) -> bool:
    """Whether a class or function takes an argument of this name. Without one (plain settings) nobody does."""
    if target is None:
        return False
    known = arguments(target)
    if known is None or name in SPECIAL:
        return True
    return name in known or any(parameter.kind == parameter.VAR_KEYWORD for parameter in known.values())


def with_floats(node: Any, hint: Any = None) -> Any:
    """Plain settings in which each whole number is a float where the constructor's hints ask for one: 1 is as good as 1.0.

    ``node``: nested dicts and lists; ``hint``: of the argument that they are passed to.
    """
    if isinstance(node, Mapping):
        if "_target_" in node:
            known = arguments(node["_target_"]) or {}
            return {k: with_floats(value, known[k].annotation if k in known else None) for k, value in node.items()}
        inner = _of_items(hint, Mapping, place=1)
        return {key: with_floats(value, inner) for key, value in node.items()}
    if isinstance(node, list | tuple):
        inner = _of_items(hint, Sequence, place=0)
        return [with_floats(value, inner) for value in node]
    is_whole = isinstance(node, int) and not isinstance(node, bool)
    return float(node) if is_whole and float in _alternatives(hint) and int not in _alternatives(hint) else node


def _alternatives(hint: Any) -> tuple[Any, ...]:
    """The members of a union; a plain hint alone."""
    return get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)


def _of_items(hint: Any, kind: type, *, place: int) -> Any:
    """The hint of what a container of this kind holds; None where the hint names no such container."""
    for each in _alternatives(hint):
        origin, inner = get_origin(each), get_args(each)
        if isinstance(origin, type) and issubclass(origin, kind) and len(inner) > place:
            return inner[place]
    return None
