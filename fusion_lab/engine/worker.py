"""One thread that works on the newest of each page's wishes: no queue builds up behind a control that is dragged. What may be
wanted next is done while nobody waits."""

import threading
from collections.abc import Callable
from typing import Any

Waiting = dict[str, tuple[Callable[[], Any], Callable[[Any], object]]]
"""Of each sender what it wishes for and who takes the answer."""


class NewestWins:
    """Does what senders wish for in one thread, and then, still in it, delivers the answer.

    Of each sender only the newest wish waits; senders that wait are served in turn, so that nobody starves. What a sender
    submits for when the thread is idle waits until no wish does, and is dropped when the sender has a wish again. An exception
    is delivered in place of the answer.
    """

    def __init__(self) -> None:
        self._waiting, self._idle = Waiting(), Waiting()
        self._change = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="fusion lab", daemon=True)
        self._thread.start()

    def submit(
        self, sender: str, wish: Callable[[], Any], deliver: Callable[[Any], object], *, idle: bool = False
    ) -> None:
        """Hands in a wish; one of the same sender that still waits is dropped, and its place is kept."""
        with self._change:
            if not idle:
                self._idle.pop(sender, None)
            (self._idle if idle else self._waiting)[sender] = wish, deliver
            self._change.notify()

    def forget(self, sender: str) -> None:
        """Drops what waits of a sender: its page was closed."""
        with self._change:
            self._waiting.pop(sender, None)
            self._idle.pop(sender, None)

    def close(self) -> None:
        """Ends the thread when it has done what it is at; what waits is dropped."""
        with self._change:
            self._closed = True
            self._waiting.clear()
            self._idle.clear()
            self._change.notify()
        self._thread.join(timeout=10)

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._waiting or self._idle or self._closed)
                if self._closed:
                    return
                first = self._waiting or self._idle
                wish, deliver = first.pop(next(iter(first)))
            try:
                answer = wish()
            except Exception as error:  # whatever it was, the page says it and the thread goes on
                answer = error
            deliver(answer)
