"""The processes that train one run together: the first one speaks, and the others follow it."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

RANKS = ("RANK", "LOCAL_RANK", "NODE_RANK")
"""Variables with which torchrun and Lightning number the processes of one run."""


def is_first() -> bool:
    """Whether this process is the first of its run, or the only one."""
    return not any(int(os.environ.get(name, 0)) for name in RANKS)


def leave_interrupts_to_the_first() -> None:
    """Until training has handlers of its own, Ctrl-C does nothing here: the first process got it, too, and ends the others."""
    signal.signal(signal.SIGINT, lambda number, frame: None)
    _let_through()


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Ctrl-C waits for ``release_interrupts``, or the end. A process that is started meanwhile begins with it held, too: it
    lives until it has a handler, and is not lost to the one that starts it half way through."""
    if (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    ):
        signal.signal(signal.SIGINT, _Held())
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # handlers are not inherited, this is
    try:
        yield
    finally:
        release_interrupts()


def release_interrupts() -> None:
    """Raises KeyboardInterrupt if one was held. Does nothing where none are."""
    _let_through()
    held = signal.getsignal(signal.SIGINT)
    if isinstance(held, _Held):
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if held.came:
            raise KeyboardInterrupt


def _let_through() -> None:
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


class _Held:
    """A handler that only notes."""

    came = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.came = True
