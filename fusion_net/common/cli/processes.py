"""The processes that train one run together: the first one speaks, and the others follow it."""

import os
import signal

RANKS = ("RANK", "LOCAL_RANK", "NODE_RANK")
"""Variables with which torchrun and Lightning number the processes of one run."""


def is_first() -> bool:
    """Whether this process is the first of its run, or the only one."""
    return not any(int(os.environ.get(name, 0)) for name in RANKS)


def leave_interrupts_to_the_first() -> None:
    """Until training has handlers of its own, Ctrl-C does nothing here: the first process got it, too, and ends the others."""
    signal.signal(signal.SIGINT, lambda number, frame: None)
