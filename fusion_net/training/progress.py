"""What a run says on the terminal: its progress, how long it will take, and whether its plan was cut."""

import multiprocessing
import sys
import time

import lightning.pytorch as pl
from tqdm import tqdm

from fusion_net.data.batch import Batch
from fusion_net.training.callbacks import PlanCallback
from fusion_net.training.forecast import VALIDATION_COST, Outlook, StepTimes, fusion_surplus, outlook
from fusion_net.training.module import DetectorModule
from fusion_net.training.plan import Stage

SHORTER = "a shorter run than the full plan, whose table is not comparable with the README's"


class TerminalProgress(pl.Callback):
    """One bar on a terminal, plain lines elsewhere; in both, as soon as the speed is known, what the whole run will take.

    The camera's own stage has faster steps than those after it: what these will take is tried once on a copy of the model, and
    corrected when they come. Stands behind ``plan`` in the list of callbacks, whose clock leaves out validations. A validation
    has ``val_batches`` batches and comes ``validate_every`` steps.
    """

    def __init__(self, plan: PlanCallback, *, validate_every: int, val_batches: int, every: int = 100) -> None:
        self.plan, self.total = plan, plan.plan.total_steps
        self.validate_every, self.val_batches, self.every = validate_every, val_batches, every
        self._bar: tqdm | None = None
        self._seen, self._since = 0, time.perf_counter()
        self._times, self._elapsed = StepTimes(), 0.0
        self._announced: Stage | None = None
        self._surplus, self._validation = 0.0, 0.0
        self._is_due, self._ended = False, 0.0

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Opens the bar."""
        is_job = multiprocessing.parent_process() is not None  # its bar would stand in that of another job of a sweep
        if trainer.is_global_zero and sys.stderr.isatty() and not is_job:
            self._bar = tqdm(
                total=self.total,
                initial=trainer.global_step,
                ascii=True,
                bar_format="{percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} steps, {elapsed}{postfix}",
            )
        self._seen, self._since, self._elapsed = trainer.global_step, time.perf_counter(), self.plan.elapsed

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx) -> None:
        """Notes how long a validation took."""
        if self._is_due:
            self._validation, self._is_due = time.perf_counter() - self._ended, False

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        """Advances the bar, or prints a line every ``every`` steps."""
        if not trainer.is_global_zero:
            return
        step, loss = trainer.global_step, float(outputs["loss"])
        self._times.add(pl_module.stage, self.plan.elapsed - self._elapsed)
        self._elapsed = self.plan.elapsed
        if self._times.median is not None and pl_module.stage != self._announced and not self.plan.is_over:
            self._announce(trainer, pl_module, batch)
        ahead = self._outlook(step)
        left = f", {_minutes(ahead.seconds)} left" if ahead else ""
        if self._bar is not None:
            self._bar.set_postfix_str(f"{pl_module.stage} loss {loss:.3f}{left}", refresh=False)
            self._bar.update(step - self._bar.n)
        elif step % self.every == 0 and step > self._seen:
            now = time.perf_counter()
            rate = (step - self._seen) * batch.size * trainer.world_size / (now - self._since)
            print(
                f"step {step}/{self.total} {pl_module.stage:11} loss {loss:7.3f}  {rate:5.1f} samples/s{left}",
                flush=True,
            )
            self._seen, self._since = step, now
        self._is_due = pl_module.stage == "fusion" and step % self.validate_every == 0
        self._ended = time.perf_counter()

    def _outlook(self, step: int) -> Outlook | None:
        """What is ahead; None until the speed is known."""
        now = self._times.median
        if now is None:
            return None
        later = now + self._surplus if self._times.stage == "camera" else now
        return outlook(
            self.plan.plan,
            {"camera": now, "camera_only": later, "fusion": later},
            step=step,
            elapsed=self.plan.elapsed,
            validate_every=self.validate_every,
            validation=self._validation or self.val_batches * later * VALIDATION_COST,
        )

    def _announce(self, trainer: pl.Trainer, pl_module: DetectorModule, batch: Batch) -> None:
        """Says how long the run takes, once a stage."""
        self._announced, step = pl_module.stage, trainer.global_step
        now = self._times.median or 0.0
        speed = f"{now:.3f} s a step"
        if pl_module.stage == "camera":
            self._surplus = fusion_surplus(
                pl_module.model,
                batch,
                freeze_camera=pl_module.freeze_camera,
                context=trainer.precision_plugin.train_step_context,
            )
            speed += f", about {now + self._surplus:.3f} in fusion"
        ahead = self._outlook(step)
        assert ahead is not None
        validations = f"{ahead.validations} validation{'s' * (ahead.validations != 1)}"
        self._say(
            f"step {step}: {_minutes(ahead.seconds)} to go for {ahead.last_step - step} steps ({speed}) and {validations}"
        )
        if ahead.last_step < self.total:
            self._say(
                f"trainer.max_minutes={self.plan.plan.max_minutes} will end it after about {ahead.last_step} of"
                f" {self.total} steps: {SHORTER}"
            )

    def _say(self, line: str) -> None:
        """A line of its own, above the bar."""
        if self._bar is not None:
            self._bar.write(line, file=sys.stdout)
        else:
            print(line, flush=True)

    def on_train_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Closes the bar, and says when time ended the run."""
        self._close()
        if trainer.is_global_zero and self.plan.is_over and trainer.global_step < self.total:
            minutes = self.plan.plan.max_minutes
            print(
                f"stopped by trainer.max_minutes={minutes} after {trainer.global_step} of {self.total} steps: {SHORTER}",
                flush=True,
            )

    def on_exception(self, trainer: pl.Trainer, pl_module: pl.LightningModule, exception: BaseException) -> None:
        """Closes the bar, so that what is said next has a line of its own."""
        self._close()

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()


def _minutes(seconds: float) -> str:
    """A time for people: 40 s, 9.4 min, 75 min."""
    return f"{seconds:.0f} s" if seconds < 60 else f"{seconds / 60:.{1 if seconds < 600 else 0}f} min"
