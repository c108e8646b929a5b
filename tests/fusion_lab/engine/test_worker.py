"""The newest wish of each page wins, and nothing that fails stops the thread."""

import threading

import pytest

from fusion_lab.engine.worker import NewestWins

PATIENCE = 10


class Bench:
    """A worker whose work waits until it is let go."""

    def __init__(self):
        self.started, self.go, self.done = threading.Semaphore(0), threading.Semaphore(0), []
        self.worker = NewestWins()
        self.delivered = threading.Semaphore(0)

    def work(self, wish):
        self.started.release()
        assert self.go.acquire(timeout=PATIENCE)
        if wish == "bad":
            raise ValueError("a bad wish")
        return wish

    def submit(self, sender, wish, **when):
        def deliver(answer):
            self.done.append((sender, answer))
            self.delivered.release()

        self.worker.submit(sender, lambda: self.work(wish), deliver, **when)

    def finish(self, count):
        for _ in range(count):
            self.go.release()
            assert self.delivered.acquire(timeout=PATIENCE)


@pytest.fixture
def bench():
    bench = Bench()
    yield bench
    for _ in range(5):
        bench.go.release()
    bench.worker.close()


def test_of_a_hundred_wishes_the_one_at_work_and_the_newest_are_answered(bench):
    bench.submit("page", 0)
    assert bench.started.acquire(timeout=PATIENCE)
    for wish in range(1, 101):
        bench.submit("page", wish)
    bench.finish(2)
    assert bench.done == [("page", 0), ("page", 100)]


def test_a_page_that_asks_all_the_time_does_not_keep_another_waiting(bench):
    bench.submit("busy", 0)
    assert bench.started.acquire(timeout=PATIENCE)
    bench.submit("busy", 1)
    bench.submit("calm", 1)
    bench.submit("busy", 2)
    bench.finish(3)
    assert bench.done == [("busy", 0), ("busy", 2), ("calm", 1)]


def test_a_closed_page_gets_nothing(bench):
    bench.submit("open", 0)
    assert bench.started.acquire(timeout=PATIENCE)
    bench.submit("closed", 1)
    bench.worker.forget("closed")
    bench.submit("open", 1)
    bench.finish(2)
    assert bench.done == [("open", 0), ("open", 1)]


def test_what_fails_is_delivered_and_the_next_is_answered(bench):
    bench.submit("page", "bad")
    bench.finish(1)
    bench.submit("page", "good")
    bench.finish(1)
    assert isinstance(bench.done[0][1], ValueError)
    assert bench.done[1] == ("page", "good")


def test_what_is_done_ahead_waits_until_nobody_has_a_wish(bench):
    bench.submit("page", 0)
    assert bench.started.acquire(timeout=PATIENCE)
    bench.submit("page", "ahead", idle=True)
    bench.submit("other", 1)
    bench.finish(3)
    assert bench.done == [("page", 0), ("other", 1), ("page", "ahead")]


def test_a_new_wish_drops_what_its_sender_wanted_done_ahead(bench):
    bench.submit("page", 0)
    assert bench.started.acquire(timeout=PATIENCE)
    bench.submit("page", "ahead", idle=True)
    bench.submit("page", 1)
    bench.submit("other", 2)
    bench.finish(3)
    assert bench.done == [("page", 0), ("page", 1), ("other", 2)]
