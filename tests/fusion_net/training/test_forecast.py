"""What is said about the length of a run, on given speeds."""

import pytest
import torch

from fusion_net.training.forecast import STARTING, STEADY, StepTimes, fusion_surplus, outlook
from fusion_net.training.plan import TrainingPlan
from tests.fixtures.small_model import small_batch, small_early_model, small_model

PACE = {"camera": 0.1, "camera_only": 0.2, "fusion": 0.25}


def plan(max_minutes=None, **steps):
    return TrainingPlan(
        steps={"camera": 100, "camera_only": 20, "fusion": 200} | steps,
        max_lr=1e-3,
        warmup_fraction=0.15,
        stage_fractions={"camera": 0.25, "camera_only": 0.25, "fusion": 0.5},
        max_minutes=max_minutes,
    )


def ahead(plan, *, step=0, elapsed=0.0, pace=PACE, validate_every=1000, validation=0.0):
    return outlook(plan, pace, step=step, elapsed=elapsed, validate_every=validate_every, validation=validation)


def test_each_stage_has_its_own_speed():
    assert ahead(plan()) == (320, pytest.approx(100 * 0.1 + 20 * 0.2 + 200 * 0.25), 1)


def test_of_a_run_under_way_only_the_rest_counts():
    p = plan()
    p.position(100, 30.0)
    p.position(120, 35.0)
    assert ahead(p, step=220, elapsed=80.0).seconds == pytest.approx(100 * 0.25)


@pytest.mark.parametrize(("every", "count"), [(1000, 1), (100, 3), (320, 1), (160, 2), (60, 4)])
def test_validations_come_in_fusion_and_at_the_end(every, count):
    """Steps 121 to 320 are fusion's; a validation that is due at the end is the last one."""
    found = ahead(plan(), validate_every=every, validation=7.0)
    assert found.validations == count
    assert found.seconds == pytest.approx(64 + 7 * count)


@pytest.mark.parametrize("minutes", [0.05, 0.2, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("steps", [{}, {"camera": 0, "camera_only": 0}, {"camera": 500}])
def test_a_time_limit_ends_the_run_where_the_plan_ends_it(minutes, steps):
    """Against the plan itself, stepped through at that speed."""
    walked, step, clock = plan(minutes, **steps), 0, 0.0
    stage, progress = walked.position(step, clock)
    while progress < 1:
        step, clock = step + 1, clock + PACE[stage]
        stage, progress = walked.position(step, clock)
    found = ahead(plan(minutes, **steps))
    assert abs(found.last_step - step) <= 3  # a stage ends at the first step behind its time: rounding, once a stage
    assert found.seconds == pytest.approx(clock, abs=0.6)


def test_a_limit_that_is_far_away_cuts_nothing():
    assert ahead(plan(60.0)) == ahead(plan())


def test_the_speed_is_that_of_the_stage_once_it_is_steady():
    times = StepTimes()
    for seconds in [9.0] * STARTING + [0.1] * (STEADY - 1):
        times.add("camera", seconds)
    assert times.median is None
    times.add("camera", 5.0)
    assert times.median == 0.1  # of all but a hiccup
    times.add("fusion", 0.3)
    assert times.median is None


@pytest.mark.parametrize("model", [small_model, small_early_model])
def test_trying_the_whole_network_leaves_the_model_as_it_was(model):
    model = model()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    surplus = fusion_surplus(model, small_batch(2), freeze_camera=True, context=torch.enable_grad, repeats=1)
    assert -1.0 < surplus < 60.0
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())
    assert all(p.grad is None and p.requires_grad for p in model.parameters())
