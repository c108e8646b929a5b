import pytest
from beartype import beartype

from fusion_net.cli import UserError, build, check_overrides, one_line


@pytest.mark.parametrize(
    ("argument", "answer"),
    [
        ("trainer.batch_sise=4", "did you mean trainer.batch_size"),
        ("trainer=cpuu", "did you mean cpu?"),
        ("modality_droput=0.5", "did you mean modality_dropout"),
        ("nonsense", "is not an override"),
        ("encoders=[camera,lidar", "quote lists"),
        ("grid=nanoo", "did you mean nano?"),
    ],
)
def test_a_mistyped_override_is_answered_with_the_nearest_valid_one(argument, answer):
    with pytest.raises(UserError, match=answer.replace("?", r"\?")):
        check_overrides("train", [argument])


@pytest.mark.parametrize(
    "argument", ["seed=3", "trainer.max_minutes=2", "encoders=[camera,lidar]", "+extra.key=1", "experiment=nano", "-m"]
)
def test_a_correct_override_passes(argument):
    check_overrides("train", [argument])


@beartype
class Thing:
    def __init__(self, count: int) -> None:
        if count < 0:
            raise ValueError(f"count={count} must not be negative")


def test_a_wrong_type_names_the_key_and_the_type():
    with pytest.raises(UserError, match="thing: count='many' is not of type int"):
        build({"_target_": f"{__name__}.Thing", "count": "many"}, "thing")


def test_a_refused_value_is_one_line():
    with pytest.raises(UserError, match="thing: count=-1 must not be negative"):
        build({"_target_": f"{__name__}.Thing", "count": -1}, "thing")


def test_line_breaks_are_folded():
    assert one_line(ValueError("a\n  b")) == "a b"
