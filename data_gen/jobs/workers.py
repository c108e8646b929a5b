"""Jobs shared out to parallel processes that start clean, end with their parent and never outlive an error."""

import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

import cv2


def run_parallel(
    function: Callable[..., Any], arguments: list[tuple[Any, ...]], *, workers: int, done: Callable[[], Any]
) -> None:
    """Calls ``function(*each)`` in ``workers`` processes; ``done()`` after each, in any order. The first error ends it all:
    what runs is finished, nothing more begins. OSError when a process was killed.

    The first call is made here, while the processes start: what must be compiled is compiled once, not by each of them.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_start) as pool:
        with _interrupt_deferred():
            for _ in range(workers):
                pool.submit(_import, function)
        try:
            function(*arguments[0])
            done()
            for future in as_completed([pool.submit(function, *each) for each in arguments[1:]]):
                future.result()
                done()
        except BrokenProcessPool as error:
            raise OSError(
                "a worker process was killed, perhaps for want of memory; finished scenes are kept, and the same"
                " command goes on (workers=1 takes the least memory)"
            ) from error
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def limit_threads() -> None:
    """A worker is one process on one core: libraries must not start threads of their own in it."""
    cv2.setNumThreads(1)


def _import(function: Callable[..., Any]) -> None:
    """Nothing, but to be sent ``function`` imports what it needs."""


def _start() -> None:
    """One thread, and an end when the parent ends, even if that is killed: orphans would wait for work for ever."""
    limit_threads()
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


@contextmanager
def _interrupt_deferred() -> Iterator[None]:
    """Ctrl-C reaches every process of a terminal. Those started in here ignore it, for good: the parent alone decides, and
    no worker prints a traceback. The parent itself is deaf only while it starts them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
