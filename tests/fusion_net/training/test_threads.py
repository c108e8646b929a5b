"""The decision about threads on given figures, and what the watch does to torch."""

from types import SimpleNamespace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.training import threads as module
from fusion_net.training.callbacks import MetricsCSV
from fusion_net.training.threads import ThreadWatch, Usage, set_threads, taken_by_others, threads_beside, usage


@pytest.mark.parametrize(
    ("others", "cores", "current", "most", "wanted"),
    [
        (0.0, 2, 2, 2, 2),
        (0.1, 2, 2, 2, 2),  # a desktop's background
        (0.67, 2, 2, 2, 1),  # one busy process, which got two thirds of its core
        (1.0, 2, 1, 2, 1),  # and the whole of it now
        (0.35, 2, 1, 2, 1),
        (0.2, 2, 1, 2, 2),  # it is gone
        (2.0, 2, 2, 2, 1),
        (9.0, 2, 1, 2, 1),  # never none
        (1.0, 8, 8, 8, 7),
        (3.0, 8, 7, 8, 5),
        (0.0, 8, 5, 8, 8),
        (1.0, 8, 4, 4, 4),  # room for both
        (0.0, 8, 4, 4, 4),  # not more than it began with
        (0.0, 1, 1, 1, 1),
    ],
)
def test_a_thread_for_each_core_that_others_leave(others, cores, current, most, wanted):
    assert threads_beside(others, cores=cores, current=current, most=most) == wanted


@given(st.floats(0, 20), st.integers(1, 16), st.data())
def test_the_decision_is_stable(others, cores, data):
    """The same measurement again asks for nothing else."""
    most = data.draw(st.integers(1, cores))
    current = data.draw(st.integers(1, most))
    wanted = threads_beside(others, cores=cores, current=current, most=most)
    assert 1 <= wanted <= most
    assert threads_beside(others, cores=cores, current=wanted, most=most) == wanted


def test_others_are_what_this_process_did_not_use():
    before, now = Usage(10.0, 100.0, 50.0), Usage(12.0, 104.0, 52.6)
    assert taken_by_others(before, now) == pytest.approx(0.7)
    assert taken_by_others(before, Usage(12.0, 103.9, 54.0)) == 0.0  # ticks are coarse


def test_a_fixed_number_is_set_and_nonsense_refused():
    threads = torch.get_num_threads()
    try:
        for given in (3, "auto", "4"):  # a command line's number, where auto could stand, is a text
            set_threads(given)
        assert torch.get_num_threads() == 4
        for wrong in (0, "two", 1.5):
            with pytest.raises(ValueError, match=r"trainer\.threads"):
                set_threads(wrong)
    finally:
        torch.set_num_threads(threads)


class Machine:
    """Two cores, on which others take ``others``, as seen every window."""

    def __init__(self, monkeypatch):
        self.others, self.seen = 0.0, Usage(0.0, 0.0, 0.0)
        monkeypatch.setattr(module.time, "perf_counter", lambda: self.seen.clock)
        monkeypatch.setattr(module.os, "sched_getaffinity", lambda _: {0, 1}, raising=False)

    def pass_time(self):
        clock, everyone, own = self.seen
        self.seen = Usage(clock + 2.0, everyone + 4.0, own + 2.0 * (2.0 - self.others))


@pytest.fixture
def machine(monkeypatch):
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    yield Machine(monkeypatch)
    torch.set_num_threads(threads)


def trainer(**changes):
    parts = {"world_size": 1, "global_step": 7, "strategy": SimpleNamespace(root_device=torch.device("cpu"))}
    return SimpleNamespace(**parts | changes)


def windows(watch, machine, others):
    """The number of threads after each window in which others took so many cores."""
    found = []
    for machine.others in others:
        machine.pass_time()
        watch.on_train_batch_end(trainer(), None, None, None, 0)
        found.append(torch.get_num_threads())
    return found


def test_threads_go_and_come_back_with_the_load(machine, tmp_path, capsys):
    watch = ThreadWatch(MetricsCSV(tmp_path / "metrics.csv"), measure=lambda: machine.seen)
    watch.on_train_start(trainer(), None)
    assert windows(watch, machine, [0.0, 0.7, 0.0, 0.7, 0.7]) == [2, 2, 2, 2, 1]  # a moment's load changes nothing
    assert windows(watch, machine, [1.0, 0.1, 1.0, 0.1, 0.0]) == [1, 1, 1, 1, 2]
    assert (tmp_path / "metrics.csv").read_text().splitlines()[1:] == ["7,threads,1", "7,threads,2"]
    assert "step 7: other programs take 0.7 of 2 cores; goes on with 1 thread (" in capsys.readouterr().out


def test_a_run_that_ends_beside_others_leaves_the_threads_as_they_were(machine, tmp_path):
    watch = ThreadWatch(MetricsCSV(tmp_path / "metrics.csv"), measure=lambda: machine.seen)
    watch.on_train_start(trainer(), None)
    assert windows(watch, machine, [0.7, 0.7]) == [2, 1]
    watch.on_exception(trainer(), None, KeyboardInterrupt())
    assert torch.get_num_threads() == 2


@pytest.mark.parametrize(
    "changes", [{"world_size": 2}, {"strategy": SimpleNamespace(root_device=torch.device("meta"))}]
)
def test_the_watch_rests_where_threads_are_not_what_a_step_waits_for(machine, tmp_path, changes):
    watch = ThreadWatch(MetricsCSV(tmp_path / "metrics.csv"), measure=lambda: machine.seen)
    watch.on_train_start(trainer(**changes), None)
    assert windows(watch, machine, [1.0, 1.0, 1.0]) == [2, 2, 2]


def test_the_watch_rests_where_the_kernel_does_not_say(machine, tmp_path):
    watch = ThreadWatch(MetricsCSV(tmp_path / "metrics.csv"), measure=lambda: None)
    watch.on_train_start(trainer(), None)
    assert windows(watch, machine, [1.0, 1.0, 1.0]) == [2, 2, 2]


def test_the_kernel_counts_this_process_among_all():
    before = usage()
    if before is None:
        pytest.skip("no /proc/stat here")
    sum(range(2_000_000))
    now = usage()
    assert now.clock > before.clock
    assert now.own > before.own
    assert now.everyone >= before.everyone
