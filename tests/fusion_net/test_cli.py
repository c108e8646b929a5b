from typing import Literal

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
        ("trainer.batch_size=abc", "trainer.batch_size=abc is not a whole number; the default is 8"),
        ("trainer.batch_size=1.5", "not a whole number"),
        ("trainer.batch_size=null", "trainer.batch_size=null is not a whole number"),
        ("modality_dropout=abc", "modality_dropout=abc is not a number"),
        ("resume=yess", "resume=yess is not true or false; the default is false"),
        ("encoders=camera", "write 'encoders="),
        ("name=[a]", "is not a name"),
        ("trainer.augment={flip_x:true}", "unknown key 'flip_x' in trainer.augment; did you mean flip_y?"),
        ("sweep=seeds", "write [+]sweep=seeds"),
        ("+sweep=seedz", "there is no sweep=seedz; did you mean seeds?"),
    ],
)
def test_a_mistyped_override_is_answered_with_the_nearest_valid_one(argument, answer):
    with pytest.raises(UserError, match=answer.replace("?", r"\?")):
        check_overrides("train", [argument])


@pytest.mark.parametrize(
    "argument",
    [
        "modality_dropout=1",
        "name=5",
        "seed=1,2",
        "reader.train.augment=null",
        "seed=3",
        "trainer.max_minutes=2",
        "encoders=[camera,lidar]",
        "+extra.key=1",
        "data.root=[a,b]",
        "+sweep=seeds",
        "hydra/launcher=joblib",
        "trainer.augment={brightness:0.1}",
        "experiment=nano",
        "-m",
    ],
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


@beartype
class Proud:
    def __init__(self) -> None:
        raise ValueError("thing: out of order")


def test_a_key_that_the_message_begins_with_is_not_said_twice():
    with pytest.raises(UserError, match=r"^thing: out of order$"):
        build({"_target_": f"{__name__}.Proud"}, "thing")


@beartype
class Choice:
    def __init__(self, kind: Literal["concat", "average"], share: float = 0.5) -> None:
        self.kind = kind


def test_a_value_that_is_no_choice_is_answered_with_the_nearest():
    with pytest.raises(UserError, match=r"there is no kind=conct; did you mean concat\?"):
        build({"_target_": f"{__name__}.Choice", "kind": "conct"}, "choice")


def test_a_whole_number_for_a_float_is_answered_with_how_to_write_it():
    with pytest.raises(UserError, match=r"share=1 is not of type float; write 1\.0"):
        build({"_target_": f"{__name__}.Choice", "kind": "concat", "share": 1}, "choice")


def test_an_error_of_a_loader_process_is_its_message_alone():
    caught = "Caught ValueError in DataLoader worker process 0.\nOriginal Traceback (most recent call last):\n  x\n"
    text = f"{caught}ValueError: a.jpg is cut\n"
    assert one_line(ValueError(text)) == "a.jpg is cut"


def test_line_breaks_are_folded():
    assert one_line(ValueError("a\n  b")) == "a b"
