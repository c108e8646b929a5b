from data_gen.jobs.progress import Progress


def test_away_from_a_terminal_lines_are_printed_now_and_then_without_counting_the_first_unit(capsys, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("data_gen.jobs.progress.time.monotonic", lambda: clock[0])
    with Progress("making", total=100, done=10, unit="scene") as progress:
        clock[0] = 40.0  # compiling
        progress.update()
        for _ in range(60):
            clock[0] += 0.5
            progress.update()
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["making: 12/100 scenes, 2.0 a second, 44 s left", "making: 53/100 scenes, 2.0 a second, 24 s left"]
