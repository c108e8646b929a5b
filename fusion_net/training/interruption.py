"""Ctrl-C and SIGTERM as a request that the training loop honours where its state is whole."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import lightning.pytorch as pl


class Interruption(pl.Callback):
    """Notes the first SIGINT or SIGTERM during training; a second one stops at once, without a new checkpoint.

    By default Python raises KeyboardInterrupt between any two instructions: inside an optimizer step, say, when half of the
    weights have moved. Handlers can be set in the main thread only; elsewhere signals do what they did.
    """

    def __init__(self) -> None:
        self.requested, self._announces = False, True

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Sets the handlers, over Lightning's own. Its teardown brings back those from before."""
        self._announces = trainer.is_global_zero
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                if signal.getsignal(number) is not signal.SIG_IGN:  # nohup, or a shell's background job
                    signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True
        if self._announces:
            os.write(
                2, b"\nstopping at the end of this step; once more stops at once and loses what came after last.ckpt\n"
            )


@contextmanager
def handlers_restored() -> Iterator[None]:
    """Brings back the handlers of SIGINT and SIGTERM from before. Lightning ignores Ctrl-C from the first one on, which an
    interrupted notebook would keep."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            for number, handler in before.items():
                signal.signal(number, handler)
