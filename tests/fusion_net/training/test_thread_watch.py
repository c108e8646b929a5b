"""The callback of a training: which runs it watches, and what it tells of a change."""

from types import SimpleNamespace

import pytest
import torch

from fusion_net.training.callbacks import MetricsCSV
from fusion_net.training.threads import ThreadWatch, set_threads


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


def trainer(**changes):
    parts = {"world_size": 1, "global_step": 7, "strategy": SimpleNamespace(root_device=torch.device("cpu"))}
    return SimpleNamespace(**parts | changes)


def windows(watch, two_cores, others):
    """The number of threads after each window in which others took so many cores."""
    found = []
    for two_cores.others in others:
        two_cores.pass_time()
        watch.on_train_batch_end(trainer(), None, None, None, 0)
        found.append(torch.get_num_threads())
    return found


def test_threads_go_and_come_back_with_the_load(two_cores, tmp_path, capsys):
    watch = ThreadWatch(MetricsCSV(tmp_path / "metrics.csv"), measure=two_cores.measure)
    watch.on_train_start(trainer(), None)
    assert windows(watch, two_cores, [0.0, 0.7, 0.0, 0.7, 0.7]) == [2, 2, 2, 2, 1]  # a moment's load changes nothing
    assert windows(watch, two_cores, [1.0, 0.1, 1.0, 0.1, 0.0]) == [1, 1, 1, 1, 2]
    assert (tmp_path / "metrics.csv").read_text().splitlines()[1:] == ["7,threads,1", "7,threads,2"]
    assert "step 7: other programs take 0.7 of 2 cores; goes on with 1 thread (" in capsys.readouterr().out


def test_a_run_that_ends_beside_others_leaves_the_threads_as_they_were(two_cores, tmp_path):
    watch = ThreadWatch(MetricsCSV(tmp_path / "metrics.csv"), measure=two_cores.measure)
    watch.on_train_start(trainer(), None)
    assert windows(watch, two_cores, [0.7, 0.7]) == [2, 1]
    watch.on_exception(trainer(), None, KeyboardInterrupt())
    assert torch.get_num_threads() == 2


@pytest.mark.parametrize(
    "changes", [{"world_size": 2}, {"strategy": SimpleNamespace(root_device=torch.device("meta"))}]
)
def test_the_watch_rests_where_threads_are_not_what_a_step_waits_for(two_cores, tmp_path, changes):
    watch = ThreadWatch(MetricsCSV(tmp_path / "metrics.csv"), measure=two_cores.measure)
    watch.on_train_start(trainer(**changes), None)
    assert windows(watch, two_cores, [1.0, 1.0, 1.0]) == [2, 2, 2]


def test_the_watch_rests_where_the_kernel_does_not_say(two_cores, tmp_path):
    watch = ThreadWatch(MetricsCSV(tmp_path / "metrics.csv"), measure=lambda: None)
    watch.on_train_start(trainer(), None)
    assert windows(watch, two_cores, [1.0, 1.0, 1.0]) == [2, 2, 2]
