import os
import signal
import time

import pytest

from data_gen.jobs.workers import run_parallel


def note(folder, name):
    (folder / f"{name}-{os.getpid()}").touch()


def fail(folder, name):
    if name == 2:
        raise ValueError("two is bad")
    note(folder, name)
    time.sleep(0.05)


def killed(folder, name):
    if name:
        os.kill(os.getpid(), signal.SIGKILL)


def test_each_call_is_made_once_the_first_one_here(tmp_path):
    done = []
    run_parallel(note, [(tmp_path, n) for n in range(6)], workers=2, done=lambda: done.append(1))
    made = dict(path.name.split("-") for path in tmp_path.iterdir())
    assert sorted(made) == [str(n) for n in range(6)]
    assert len(done) == 6
    assert made["0"] == str(os.getpid())
    assert all(made[str(n)] != str(os.getpid()) for n in range(1, 6))


def test_an_error_ends_the_rest(tmp_path):
    with pytest.raises(ValueError, match="two is bad"):
        run_parallel(fail, [(tmp_path, n) for n in range(60)], workers=1, done=lambda: None)
    assert len(list(tmp_path.iterdir())) < 20


def test_a_killed_worker_is_one_line_that_says_how_to_go_on(tmp_path):
    with pytest.raises(OSError, match=r"a worker process was killed.*the same command goes on") as error:
        run_parallel(killed, [(tmp_path, n) for n in range(4)], workers=2, done=lambda: None)
    assert "\n" not in str(error.value)


def test_ctrl_c_works_again_afterwards(tmp_path):
    before = signal.getsignal(signal.SIGINT)
    run_parallel(note, [(tmp_path, 0), (tmp_path, 1)], workers=1, done=lambda: None)
    assert signal.getsignal(signal.SIGINT) is before
