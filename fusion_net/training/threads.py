"""How many threads a training step uses: a fixed number, or one fewer for each core that other programs take."""

from collections.abc import Callable

import lightning.pytorch as pl
import torch

from fusion_net.models.threads import ThreadsBeside, Usage, usage
from fusion_net.training.callbacks import MetricsCSV


def set_threads(threads: int | str) -> None:
    """A fixed number of torch's threads; ``auto`` leaves torch's own choice for :class:`ThreadWatch` to change."""
    if threads == "auto":
        return
    if not str(threads).isdecimal() or int(threads) < 1:
        raise ValueError(f"trainer.threads={threads} is not auto or a number of threads; write trainer.threads=2")
    torch.set_num_threads(int(threads))


class ThreadWatch(pl.Callback):
    """Takes torch's threads away while other programs need the cores, and gives them back.

    Each change is a line on the terminal and a row ``threads`` in metrics.csv: sums are added up in another order by another
    number of threads, so a run in which it changed is repeated to rounding only, not to the bit. Rests where several
    processes train together and on a GPU.
    """

    def __init__(self, metrics: MetricsCSV, *, measure: Callable[[], Usage | None] = usage) -> None:
        self.metrics, self.measure = metrics, measure
        self._threads: ThreadsBeside | None = None

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Begins to measure."""
        alone = trainer.world_size == 1 and trainer.strategy.root_device.type == "cpu"
        self._threads = ThreadsBeside(watches=alone, measure=self.measure)

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        """Looks at the cores."""
        if self._threads and (change := self._threads.look()):
            self.metrics.write(trainer.global_step, {"threads": self._threads.current})
            print(f"step {trainer.global_step}: {change} (trainer.threads=auto)", flush=True)

    def on_train_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Leaves the process with the threads that it had."""
        if self._threads:
            self._threads.restore()

    def on_exception(self, trainer: pl.Trainer, pl_module: pl.LightningModule, exception: BaseException) -> None:
        """The same after an interruption."""
        self.on_train_end(trainer, pl_module)
