"""A run that is interrupted at any moment and resumed ends exactly as one that is not: weights, averages, optimizer, rows."""

import os
import shutil
import signal
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest
import torch
from hypothesis import HealthCheck, given
from hypothesis import settings as examples
from hypothesis import strategies as st
from lightning.pytorch.trainer import call

from fusion_net.fit import fit
from fusion_net.models.fusion_net import FusionNet
from fusion_net.training import callbacks, step_end
from fusion_net.training.module import DetectorModule
from fusion_net.training.optimizer import MuonAdamW
from tests.fixtures.training_setup import settings, write_data

STEPS = (
    "trainer.camera_steps=2", "trainer.camera_only_steps=1", "trainer.fusion_steps=6", "trainer.batch_size=2",
    "trainer.validate_every=3", "trainer.save_every=4", "modality_dropout=0.5", "trainer.dropout_from=0.2",
)  # fmt: skip
"""Two epochs of four batches and one more; validated after steps 6 and 9 in two batches, written after 4 and 8."""


class Killed(BaseException):
    """Stands for SIGKILL: nothing of ours may run on its way out but what ends open files."""


def die():
    raise Killed


def interrupt(*numbers):
    for number in numbers:
        os.kill(os.getpid(), number)


WAYS = {
    "SIGKILL": die,
    "SIGINT": lambda: interrupt(signal.SIGINT),
    "SIGTERM": lambda: interrupt(signal.SIGTERM),
    "SIGINT twice": lambda: interrupt(signal.SIGINT, signal.SIGINT),
}


@dataclass
class Moments:
    """Counts the moments of a run and does something at one of them: before and after every hook of every callback and of
    the module, every call of the network, every kernel that the optimizer moves, every write."""

    when: tuple[str, int] | None = None  # name of a moment and how many of that name come before it
    then: object = None
    seen: list[str] = field(default_factory=list)

    def mark(self, name):
        self.seen.append(name)
        if self.when == (name, self.seen.count(name) - 1):
            self.then()

    def around(self, function, name=None):
        def spied(*args, **kwargs):
            said = name or next(arg for arg in args if isinstance(arg, str))
            self.mark(f"before {said}")
            result = function(*args, **kwargs)
            self.mark(f"after {said}")
            return result

        return spied

    def half_written(self, save):
        def spied(state, file):
            self.mark("before torch.save")
            file.write(b"half a checkpoint")
            self.mark("in torch.save")
            file.seek(0)
            file.truncate()
            save(state, file)
            self.mark("after torch.save")

        return spied

    @contextmanager
    def watched(self):
        with pytest.MonkeyPatch.context() as patch:
            for name in ("_call_callback_hooks", "_call_lightning_module_hook"):
                patch.setattr(call, name, self.around(getattr(call, name)))
            for owner, name in (
                (FusionNet, "forward"), (FusionNet, "loss"), (FusionNet, "decode"), (MuonAdamW, "_step_muon"),
                (callbacks.MetricsCSV, "write"), (step_end, "score"), (torch.Tensor, "backward"),
            ):  # fmt: skip
                patch.setattr(owner, name, self.around(getattr(owner, name), name))
            patch.setattr(step_end.torch, "save", self.half_written(torch.save))
            yield self


@pytest.fixture(scope="module", autouse=True)
def setting():
    """A row of losses and gradient norms every two steps; a SIGTERM that nobody handles, before the first step, ends the
    run and not pytest."""
    before = signal.signal(signal.SIGTERM, lambda *_: die())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(callbacks.MetricsCSV.__init__, "__kwdefaults__", {"every": 2})
        patch.setattr("fusion_net.training.trainer.LOG_EVERY", 2)
        yield
    signal.signal(signal.SIGTERM, before)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_data(tmp_path_factory.mktemp("data") / "tree")


@pytest.fixture(scope="module")
def whole(data, tmp_path_factory):
    """An unbroken run's result and the names of its moments."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch, Moments().watched() as moments:
        patch.chdir(folder)
        fit(settings(data, "name=a", *STEPS))
    return result(folder / "runs/a"), moments.seen


def result(folder):
    """What a run leaves: its checkpoints without times, and its rows."""
    left = {"rows": (folder / "metrics.csv").read_text().splitlines()}
    for name in ("last", "best"):
        state = torch.load(folder / "checkpoints" / f"{name}.ckpt", weights_only=True)
        left[name] = {key: state[key] for key in STATE} | {"callbacks": state["callbacks"].copy()}
        left[name]["callbacks"].pop("PlanCallback")
    return left


STATE = ("global_step", "state_dict", "current_model_state", "averaging_state", "optimizer_states")


def assert_same(one, other, where=""):
    assert type(one) is type(other), where
    if isinstance(one, dict):
        assert one.keys() == other.keys(), where
        for key in one:
            assert_same(one[key], other[key], f"{where} {key}")
    elif isinstance(one, list):
        assert len(one) == len(other), where
        for place, pair in enumerate(zip(one, other, strict=True)):
            assert_same(*pair, f"{where} {place}")
    elif isinstance(one, torch.Tensor):
        assert torch.equal(one, other), where
    else:
        assert one == other, where


def assert_resumed_equals(whole, data, folder, cuts):
    shutil.rmtree(folder / "runs", ignore_errors=True)
    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]

    def begun():
        """A cut before the first batch leaves no run behind, and the same command starts it."""
        return (folder / "runs/a/config.yaml").exists()

    for way, when in cuts:
        with (
            Moments(when, WAYS[way]).watched(),
            suppress(Killed, KeyboardInterrupt),
        ):  # at the end nothing may come of it
            fit(settings(data, "name=a", f"resume={begun()}", *STEPS))
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == handlers
    fit(settings(data, "name=a", f"resume={begun()}", *STEPS))
    assert_same(result(folder / "runs/a"), whole[0])
    assert not list(folder.rglob("*.part"))


def test_the_moments_are_those_that_matter(whole):
    kinds = set(whole[1])
    for name in (
        "forward", "backward", "_step_muon", "loss", "decode", "score", "write", "on_train_batch_start", "on_fit_start",
        "on_train_batch_end", "on_before_zero_grad", "on_after_backward", "on_train_end", "on_train_start",
    ):  # fmt: skip
        assert {f"before {name}", f"after {name}"} <= kinds, name
    assert whole[1].count("in torch.save") == 3 + 2  # last.ckpt after 4, 8 and 9; best.ckpt after 6 and 9


@pytest.mark.parametrize(
    ("name", "number", "way"),
    [
        ("before backward", 4, "SIGINT"),  # batch norm has counted the batch
        ("before decode", 1, "SIGTERM"),  # in the first batch of two of the first validation
        ("in torch.save", 2, "SIGKILL"),  # of step 8's checkpoint
    ],
)
def test_the_cases_that_were_wrong(data, whole, tmp_path, monkeypatch, name, number, way):
    monkeypatch.chdir(tmp_path)
    assert_resumed_equals(whole, data, tmp_path, [(way, (name, number))])


@pytest.mark.slow
@pytest.mark.timeout(1200)
@examples(max_examples=25, derandomize=True, suppress_health_check=list(HealthCheck))
@given(draw=st.data())
def test_interrupted_at_any_moment_and_resumed_equals_unbroken(data, whole, tmp_path, monkeypatch, draw):
    monkeypatch.chdir(tmp_path)
    cuts = []
    for _ in range(draw.draw(st.integers(1, 2))):
        name = draw.draw(st.sampled_from(sorted(set(whole[1]))))
        number = draw.draw(st.integers(0, whole[1].count(name) - 1))
        cuts.append((draw.draw(st.sampled_from(sorted(WAYS))), (name, number)))
    assert_resumed_equals(whole, data, tmp_path, cuts)


def test_a_time_limit_counts_the_time_before_the_interruption(data, tmp_path, monkeypatch):
    """Every step takes a second of ten, a validation a hundred that are not charged."""
    monkeypatch.chdir(tmp_path)
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(callbacks, "time", SimpleNamespace(perf_counter=lambda: clock.now))

    def took(function, seconds):
        def later(*args):
            clock.now += seconds
            return function(*args)

        return later

    monkeypatch.setattr(DetectorModule, "training_step", took(DetectorModule.training_step, 1.0))
    monkeypatch.setattr(FusionNet, "decode", took(FusionNet.decode, 100.0))
    limited = [*STEPS, "trainer.camera_steps=100", "trainer.fusion_steps=100", f"trainer.max_minutes={10 / 60}"]
    fit(settings(data, "name=a", *limited))
    unbroken = result(tmp_path / "runs/a")
    assert unbroken["last"]["global_step"] == 10
    assert any(row.startswith("10,val/mAP") for row in unbroken["rows"])
    shutil.rmtree(tmp_path / "runs")
    with Moments(("before decode", 1), WAYS["SIGINT"]).watched(), pytest.raises(KeyboardInterrupt):
        fit(settings(data, "name=a", *limited))
    clock.now += 1000.0
    fit(settings(data, "name=a", "resume=true", *limited))
    assert_same(result(tmp_path / "runs/a"), unbroken)


def test_a_finished_run_that_is_resumed_stays_as_it_is(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fit(settings(data, "name=a", *STEPS))
    was = result(tmp_path / "runs/a")
    fit(settings(data, "name=a", "resume=true", *STEPS))
    assert_same(result(tmp_path / "runs/a"), was)


@pytest.mark.slow
def test_with_loader_processes_too(data, whole, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Moments(when=("after backward", 4), then=WAYS["SIGTERM"]).watched(), pytest.raises(KeyboardInterrupt):
        fit(settings(data, "name=a", *STEPS, "dataset.workers=2"))
    fit(settings(data, "name=a", "resume=true", *STEPS, "dataset.workers=2"))
    assert_same(result(tmp_path / "runs/a"), whole[0])
