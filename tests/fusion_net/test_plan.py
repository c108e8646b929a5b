import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.training.plan import TrainingPlan


def plan(**changes):
    return TrainingPlan(**({"camera_steps": 100, "fusion_steps": 50, "max_lr": 1e-3} | changes))


def test_stages_follow_each_other_by_steps():
    p = plan()
    assert p.position(0, 0.0) == ("camera", 0.0)
    assert p.position(99, 1e6) == ("camera", 0.99)
    assert p.position(100, 1e6) == ("fusion", 0.0)
    assert p.position(125, 1e6) == ("fusion", 0.5)
    assert p.position(150, 1e6) == ("fusion", 1.0)


def test_minutes_end_each_stage_and_fusion_gets_what_the_camera_left():
    p = plan(max_minutes=10, camera_share=0.4)
    assert p.position(10, 120.0) == ("camera", pytest.approx(0.5))
    assert p.position(20, 240.0) == ("fusion", 0.0)
    assert p.position(21, 420.0) == ("fusion", pytest.approx(0.5))
    assert p.position(22, 601.0) == ("fusion", 1.0)


def test_no_camera_stage_starts_in_fusion():
    assert plan(camera_steps=0).position(0, 0.0) == ("fusion", 0.0)


def test_rate_rises_to_its_maximum_and_anneals_to_a_thousandth():
    p = plan(warmup=0.2)
    assert p.learning_rate(0.0) == pytest.approx(5e-5)
    assert p.learning_rate(0.2) == pytest.approx(1e-3)
    assert p.learning_rate(1.0) == pytest.approx(1e-6)


@given(st.floats(0, 1))
def test_rate_never_leaves_its_bounds(share):
    assert 1e-6 <= plan().learning_rate(share) <= 1e-3 + 1e-12


@pytest.mark.parametrize("changes", [{"fusion_steps": 0}, {"camera_steps": -1}, {"max_minutes": 0}])
def test_impossible_plans_are_refused(changes):
    with pytest.raises(ValueError, match="plan"):
        plan(**changes)
