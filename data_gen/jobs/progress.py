"""How far a long job is: a bar on a terminal that it has for itself, plain lines anywhere else."""

import multiprocessing
import sys
import time
from types import TracebackType

from tqdm import tqdm

EVERY = 20.0
"""Seconds between two lines."""


class Progress:
    """A context: ``update()`` after each of ``total`` units, of which the first ``done`` were there before. Jobs that a
    launcher runs side by side write lines, as their bars would overwrite each other."""

    def __init__(self, title: str, *, total: int, done: int, unit: str) -> None:
        self.title, self.total, self.done, self.unit = title, total, done, unit
        self._began, self._printed, self._first = 0.0, time.monotonic(), done
        is_alone = sys.stderr.isatty() and multiprocessing.parent_process() is None
        self._bar = tqdm(total=total, initial=done, desc=title, unit=unit, ascii=True) if is_alone else None

    def __enter__(self) -> "Progress":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def update(self) -> None:
        """One unit more."""
        self.done += 1
        now = time.monotonic()
        if not self._began:  # the first unit also took what is needed only once: it counts in no rate
            self._began, self._first = now, self.done
            if self._bar is not None:
                self._bar.initial = self._bar.n = self._bar.last_print_n = self.done
                self._bar.unpause()  # its clock begins now
                self._bar.refresh()
        elif self._bar is not None:
            self._bar.update()
        elif now - self._printed > EVERY:
            self._printed = now
            seconds = (now - self._began) / (self.done - self._first)
            pace = f"{seconds:.1f} s a {self.unit}" if seconds > 1 else f"{1 / seconds:.1f} a second"
            left = (self.total - self.done) * seconds
            self.say(f"{self.title}: {self.done}/{self.total} {self.unit}s, {pace}, {left:.0f} s left")

    def say(self, line: str) -> None:
        """Prints a line on stderr, above the bar where there is one."""
        tqdm.write(line, file=sys.stderr)
        sys.stderr.flush()
