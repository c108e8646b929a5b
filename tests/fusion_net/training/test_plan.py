import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.training.plan import TrainingPlan


def plan(camera=100, camera_only=20, fusion=50, **changes):
    steps = {"camera": camera, "camera_only": camera_only, "fusion": fusion}
    fractions = {"camera": 0.25, "camera_only": 0.25, "fusion": 0.5}
    return TrainingPlan(
        **{"steps": steps, "max_lr": 1e-3, "warmup_fraction": 0.15, "stage_fractions": fractions, **changes}
    )


def test_stages_follow_each_other_by_steps():
    p = plan()
    assert p.position(0, 0.0) == ("camera", 0.0)
    assert p.position(99, 1e6) == ("camera", 0.99)
    assert p.position(100, 1e6) == ("camera_only", 0.0)
    assert p.position(120, 1e6) == ("fusion", 0.0)
    assert p.position(145, 1e6) == ("fusion", 0.5)
    assert p.position(170, 1e6) == ("fusion", 1.0)


def test_minutes_end_each_stage_and_what_is_left_goes_to_the_next():
    p = plan(max_minutes=10)
    assert p.position(10, 75.0) == ("camera", pytest.approx(0.5))
    assert p.position(20, 150.0) == ("camera_only", 0.0)
    assert p.position(40, 160.0) == ("fusion", 0.0)  # its steps were done early
    assert p.position(41, 380.0) == ("fusion", pytest.approx(0.5))
    assert p.position(42, 601.0) == ("fusion", 1.0)


def test_without_a_camera_only_fusion_is_left():
    assert plan(camera=0, camera_only=0).position(0, 0.0) == ("fusion", 0.0)


def test_a_resumed_plan_stands_where_it_stood():
    p = plan()
    p.position(100, 4.5)
    resumed = plan(stage_starts=p.stage_starts)
    assert resumed.position(110, 5.0) == p.position(110, 5.0) == ("camera_only", 0.5)


def test_rate_rises_to_its_maximum_and_anneals_to_a_thousandth():
    p = plan(warmup_fraction=0.2)
    assert p.learning_rate(0.0) == pytest.approx(5e-5)
    assert p.learning_rate(0.2) == pytest.approx(1e-3)
    assert p.learning_rate(1.0) == pytest.approx(1e-6)


@given(st.floats(0, 1))
def test_rate_never_leaves_its_bounds(progress):
    assert 1e-6 <= plan().learning_rate(progress) <= 1e-3 + 1e-12


@pytest.mark.parametrize(
    "changes",
    [
        {"fusion": 0},
        {"camera": -1},
        {"max_minutes": 0},
        {"warmup_fraction": 1.0},
        {"warmup_fraction": -0.1},
        {"stage_fractions": {"camera": 0.5, "alone": 0.1, "fusion": 0.4}},
        {"stage_fractions": {"camera": 0.5, "camera_only": 0.5, "fusion": 0.0}},
        {"stage_fractions": {"camera": -0.5, "camera_only": 0.5, "fusion": 1.0}},
    ],
)
def test_impossible_plans_are_refused(changes):
    with pytest.raises(ValueError, match="trainer: "):
        plan(**changes)
