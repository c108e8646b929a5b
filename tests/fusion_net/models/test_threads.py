"""The decision about threads on given figures, and what it does to torch."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.models.threads import ThreadsBeside, Usage, taken_by_others, threads_beside, usage


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


def windows(threads, machine, others):
    """The number of threads after each window in which others took so many cores."""
    found = []
    for machine.others in others:
        machine.pass_time()
        threads.look()
        found.append(torch.get_num_threads())
    return found


def test_threads_go_and_come_back_with_the_load(two_cores):
    with ThreadsBeside(measure=two_cores.measure) as threads:
        assert windows(threads, two_cores, [0.0, 0.7, 0.0, 0.7, 0.7]) == [
            2,
            2,
            2,
            2,
            1,
        ]  # a moment's load changes nothing
        assert windows(threads, two_cores, [1.0, 0.1, 1.0, 0.1, 0.0]) == [1, 1, 1, 1, 2]


def test_what_is_told_of_a_change(two_cores):
    with ThreadsBeside(measure=two_cores.measure) as threads:
        assert threads.look() == ""  # no window is over
        told = []
        for _ in range(3):
            two_cores.others = 0.7
            two_cores.pass_time()
            told.append(threads.look())
    assert told == ["", "other programs take 0.7 of 2 cores; goes on with 1 thread", ""]


def test_work_that_ends_or_fails_beside_others_leaves_the_threads_as_they_were(two_cores):
    threads = ThreadsBeside(measure=two_cores.measure)

    def work():
        with threads:
            assert windows(threads, two_cores, [0.7, 0.7]) == [2, 1]
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()
    assert torch.get_num_threads() == 2


@pytest.mark.parametrize("changes", [{"watches": False}, {"measure": lambda: None}])
def test_nothing_changes_on_a_gpu_or_where_the_kernel_does_not_say(two_cores, changes):
    with ThreadsBeside(**{"measure": two_cores.measure} | changes) as threads:
        assert windows(threads, two_cores, [1.0, 1.0, 1.0]) == [2, 2, 2]


def test_the_kernel_counts_this_process_among_all():
    before = usage()
    if before is None:
        pytest.skip("no /proc/stat here")
    sum(range(2_000_000))
    now = usage()
    assert now.clock > before.clock
    assert now.own > before.own
    assert now.everyone >= before.everyone
