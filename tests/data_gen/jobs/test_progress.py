import io
import re

import pytest

from data_gen.jobs.progress import Progress


@pytest.fixture
def clock(monkeypatch):
    """Seconds, by which lines and the bar go."""
    seconds = [1000.0]
    monkeypatch.setattr("data_gen.jobs.progress.time.monotonic", lambda: seconds[0])
    monkeypatch.setattr("tqdm.std.time", lambda: seconds[0])
    return seconds


def work(clock, *, first, each, units):
    with Progress("making", total=100, done=10, unit="scene") as progress:
        clock[0] += first  # compiling
        progress.update()
        for _ in range(units):
            clock[0] += each
            progress.update()


def test_away_from_a_terminal_lines_are_printed_now_and_then_without_counting_the_first_unit(capsys, clock):
    work(clock, first=40.0, each=0.5, units=60)
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["making: 12/100 scenes, 2.0 a second, 44 s left", "making: 53/100 scenes, 2.0 a second, 24 s left"]


def test_what_is_slow_is_told_in_seconds_a_unit(capsys, clock):
    work(clock, first=5.0, each=4.0, units=8)
    assert capsys.readouterr().err.splitlines() == ["making: 15/100 scenes, 4.0 s a scene, 340 s left"]


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_the_bar_of_a_terminal_shows_no_pace_until_there_is_one(clock, monkeypatch):
    screen = Terminal()
    monkeypatch.setattr("sys.stderr", screen)
    work(clock, first=40.0, each=2.0, units=3)
    paces = re.findall(r"(\d+)/100 \[[^\r]*, +(\S+)\]", screen.getvalue())
    assert paces[:2] == [("10", "?scene/s"), ("11", "?scene/s")]
    assert {pace for _, pace in paces[2:]} == {"2.00s/scene"}
    assert paces[-1][0] == "14"
