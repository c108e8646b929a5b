"""What a run says about its length, on given step times."""

from types import SimpleNamespace

import pytest

from fusion_net.training import progress
from fusion_net.training.forecast import STARTING, STEADY
from fusion_net.training.plan import TrainingPlan
from fusion_net.training.progress import TerminalProgress

STEP = {"camera": 0.1, "camera_only": 0.2, "fusion": 0.3}


def said(capsys, monkeypatch, *, max_minutes=None, expected_surplus=0.15, **steps):
    """The lines of a run that is walked through with those times for a step."""
    monkeypatch.setattr(progress, "fusion_surplus", lambda *_, **__: expected_surplus)
    plan = TrainingPlan(
        steps={"camera": 100, "camera_only": 50, "fusion": 200} | steps,
        max_lr=1e-3,
        warmup_fraction=0.15,
        stage_fractions={"camera": 0.25, "camera_only": 0.25, "fusion": 0.5},
        max_minutes=max_minutes,
    )
    clock = SimpleNamespace(plan=plan, elapsed=0.0, is_over=False)
    bar = TerminalProgress(clock, validate_every=1000, val_batches=10)
    trainer = SimpleNamespace(
        is_global_zero=True,
        global_step=0,
        world_size=1,
        precision_plugin=SimpleNamespace(train_step_context=None),
    )
    module = SimpleNamespace(model=None, freeze_camera=True)
    monkeypatch.setattr("sys.stderr.isatty", lambda: False)
    bar.on_train_start(trainer, module)
    while not clock.is_over:
        module.stage = plan.position(trainer.global_step, clock.elapsed)[0]
        clock.elapsed += STEP[module.stage]
        trainer.global_step += 1
        clock.is_over = plan.position(trainer.global_step, clock.elapsed)[1] >= 1
        bar.on_train_batch_end(trainer, module, {"loss": 1.0}, SimpleNamespace(size=8), 0)
    bar.on_train_end(trainer, module)
    return capsys.readouterr().out.splitlines()


def test_a_whole_run_says_how_long_it_takes_and_corrects_itself(capsys, monkeypatch):
    lines = [line for line in said(capsys, monkeypatch) if "to go" in line]
    assert [int(line.split(":")[0].removeprefix("step ")) for line in lines] == [
        start + STARTING + STEADY for start in (0, 100, 150)
    ]
    first, _, last = lines
    rest = 60 * 0.1 + 250 * 0.25 + 10 * 0.25 / 2
    assert f"step 40: {rest / 60:.1f} min to go for 310 steps (0.100 s a step, about 0.250 in fusion)" in first
    assert f"{160 * 0.3 + 10 * 0.3 / 2:.0f} s to go for 160 steps (0.300 s a step) and 1 validation" in last


def test_a_run_that_is_not_cut_says_nothing_about_a_limit(capsys, monkeypatch):
    assert not [line for line in said(capsys, monkeypatch, max_minutes=60) if "max_minutes" in line]


def test_a_run_that_time_cuts_says_so_before_and_after(capsys, monkeypatch):
    lines = [line for line in said(capsys, monkeypatch, max_minutes=1, expected_surplus=0.2) if "max_minutes" in line]
    assert "trainer.max_minutes=1 will end it after about" in lines[0]
    assert "of 350 steps" in lines[0]
    assert "README" in lines[0]
    taken = int(lines[-1].split()[4])
    assert lines[-1].startswith(f"stopped by trainer.max_minutes=1 after {taken} of 350 steps")
    expected = [int(line.split("about ")[1].split()[0]) for line in lines[:-1]]
    assert expected[0] == pytest.approx(taken, abs=30)  # camera_only was taken to be as slow as fusion
    assert expected[-1] == pytest.approx(taken, abs=3)


def test_a_run_of_a_few_steps_makes_no_forecast(capsys, monkeypatch):
    assert said(capsys, monkeypatch, camera=6, camera_only=4, fusion=10) == []
