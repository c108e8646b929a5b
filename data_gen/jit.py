"""Compilation of the loops that numpy has no words for."""

from collections.abc import Callable
from functools import partial

from numba import njit

_compile = partial(njit, fastmath={"contract", "reassoc", "nsz", "arcp", "afn"}, error_model="numpy")
"""Fast arithmetic that still knows infinity and NaN."""


def jit(function: Callable) -> Callable:
    """Compile for one core, cached on disk where some folder for it can be written and in memory elsewhere.

    numba's cache watches only the file of the function it compiles: after an edit to a function that is called from another
    file, delete that folder's ``__pycache__``.
    """
    try:
        return _compile(cache=True)(function)
    except RuntimeError:  # no folder for the cache
        return _compile()(function)
