"""Compilation of the loops that numpy has no words for."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from numba import njit
from numba.core import event

_compile = partial(
    njit, nogil=True, fastmath={"contract", "reassoc", "nsz", "arcp", "afn"}, error_model="numpy", no_cfunc_wrapper=True
)
"""Fast arithmetic that still knows infinity and NaN; nothing here is called from C, which would be compiled as well. A loop
touches no Python object, so other threads go on beside it: the failure lab renders its sensors side by side."""


def jit(function: Callable) -> Callable:
    """Compile for one core, cached on disk where some folder for it can be written and in memory elsewhere.

    numba's cache watches only the file of the function it compiles: after an edit to a function that is called from another
    file, delete that folder's ``__pycache__``.
    """
    return _cached(function)


def jit_as(signature: str) -> Callable[[Callable], Callable]:
    """The same when the module is imported, for these types alone."""
    return partial(_cached, signature=signature)


def _cached(function: Callable, signature: str | None = None) -> Callable:
    try:
        return _compile(signature, cache=True)(function)
    except RuntimeError:  # no folder for the cache
        return _compile(signature)(function)


@contextmanager
def compilation_announced(say: Callable[[str], Any]) -> Iterator[None]:
    """Calls ``say`` with a line when, for the first time in here, something is compiled that no cache on disk holds."""
    with event.install_listener("numba:compile", _Once(say)):
        yield


class _Once(event.Listener):
    def __init__(self, say: Callable[[str], Any]) -> None:
        self.say, self.said = say, False

    def on_start(self, event: event.Event) -> None:
        if not self.said:
            self.said = True
            self.say("compiling the ray kernels: once, about a quarter of a minute")

    def on_end(self, event: event.Event) -> None:
        pass
