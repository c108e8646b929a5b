"""How many of torch's threads find a core of their own: one fewer for each core that other programs take.

The threads of an operator meet thousands of times a second, and those that are there first wait by spinning. Where another
program takes one of two cores, two threads are slower than one by half, and by far more with small operators: the one waits
for the other, which waits for the core.
"""

import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Self

import torch

WINDOW = 2.0
"""Seconds over which the use of the cores is measured."""
AGREEING = 2
"""Windows in a row that must ask for fewer threads, or for more, before there are."""


class Usage(NamedTuple):
    """Seconds of processor time so far: of all programs on the cores that this one may use, and of this one."""

    clock: float
    everyone: float
    own: float


def threads_beside(others: float, *, cores: int, current: int, most: int) -> int:
    """Threads, of ``most``, that find a core of their own beside programs that take ``others`` cores.

    A program that wants a whole core of two gets two thirds while two threads hold on to them, and one that wants less than
    half costs less than a thread is worth: hence the fractions. Between them everything stays ``current``.
    """
    free = cores - others
    if (fewer := math.floor(free + 0.6)) < current:
        return max(fewer, 1)
    return min(max(math.floor(free + 0.3), current), most)


def usage() -> Usage | None:
    """As the kernel counts it; None where it does not say (/proc/stat of Linux). Niced programs do not count beside one that
    is not: they give way."""
    try:
        lines = Path("/proc/stat").read_text(encoding="ascii").splitlines()
        mine = {f"cpu{core}" for core in os.sched_getaffinity(0)}
        columns = (0, 1, 2, 5, 6) if os.nice(0) > 0 else (0, 2, 5, 6)  # user, nice, system, irq, softirq
        counted = [line.split()[1:] for line in lines if line.split(maxsplit=1)[0] in mine]
        ticks = sum(int(values[column]) for values in counted for column in columns)
    except (OSError, AttributeError, ValueError, IndexError):
        return None
    return Usage(time.perf_counter(), ticks / os.sysconf("SC_CLK_TCK"), time.process_time())


def taken_by_others(before: Usage, now: Usage) -> float:
    """Cores that other programs used in between, on average."""
    return max(0.0, (now.everyone - before.everyone) - (now.own - before.own)) / (now.clock - before.clock)


class ThreadsBeside:
    """Takes torch's threads away while other programs need the cores, and gives them back, at the latest at its end.

    ``with ThreadsBeside() as threads:`` with ``threads.look()`` in the loop of the work. ``watches``: false leaves torch's
    threads alone, as for work on a GPU. Loader processes count as other programs.
    """

    def __init__(self, *, watches: bool = True, measure: Callable[[], Usage | None] = usage) -> None:
        self.measure = measure
        self.most = self.current = torch.get_num_threads()
        self._before = measure() if watches and self.most > 1 else None
        self._wishes: list[int] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.restore()

    def look(self) -> str:
        """Every ``WINDOW`` seconds looks at the cores, and changes the number of threads when it was asked to repeatedly.
        Returns what to tell of a change, else nothing."""
        if self._before is None or time.perf_counter() - self._before.clock < WINDOW:
            return ""
        before, self._before = self._before, self.measure()
        if self._before is None:
            return ""
        others, cores = taken_by_others(before, self._before), len(os.sched_getaffinity(0))
        wanted = threads_beside(others, cores=cores, current=self.current, most=self.most)
        if not self._is_settled(wanted):
            return ""
        self._set(wanted)
        taken, count = f"{others:.1f} of {cores} core{'s' * (cores > 1)}", f"{wanted} thread{'s' * (wanted > 1)}"
        return f"other programs take {taken}; goes on with {count}"

    def restore(self) -> None:
        """As many threads as there were."""
        if self.current != self.most:
            self._set(self.most)

    def _is_settled(self, wanted: int) -> bool:
        """Whether the last windows all wished for a change in the direction of ``wanted``."""
        self._wishes = [*self._wishes, wanted - self.current][-AGREEING:]
        return len(self._wishes) == AGREEING and (min(self._wishes) > 0 or max(self._wishes) < 0)

    def _set(self, threads: int) -> None:
        self.current = threads
        self._wishes = []
        torch.set_num_threads(threads)
