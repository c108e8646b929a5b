"""What is built from a node of settings, and the one line that a refusal is told in."""

from typing import Literal

import pytest
from beartype import beartype
from hydra.errors import ConfigCompositionException

from fusion_net.common.cli.command import UserError, build, one_line
from fusion_net.common.cli.composed import composed


@beartype
class Thing:
    def __init__(self, count: int) -> None:
        if count < 0:
            raise ValueError(f"count={count} must not be negative")


def test_a_wrong_type_names_the_key_and_the_type():
    with pytest.raises(UserError, match=r"^thing\.count='many' is not of type int"):
        build({"_target_": f"{__name__}.Thing", "count": "many"}, "thing")


def test_a_refused_value_is_one_line():
    with pytest.raises(UserError, match=r"^thing\.count=-1 must not be negative"):
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


def test_files_are_named_without_the_key_of_what_reads_them_and_without_a_number_of_the_system():
    with pytest.raises(UserError, match=r"^count=-1 must"):
        build({"_target_": f"{__name__}.Thing", "count": -1})
    assert one_line(PermissionError(13, "Permission denied", "runs/mine")) == "runs/mine: Permission denied"


def test_a_file_where_a_folder_is_needed_is_named_with_what_to_do(tmp_path):
    (tmp_path / "runs").touch()
    with pytest.raises(OSError, match="runs") as caught:
        (tmp_path / "runs" / "mine").mkdir(parents=True)
    assert one_line(caught.value).startswith(f"{tmp_path}/runs")
    assert one_line(caught.value).endswith("a file is where a folder is needed: move it away")


def test_a_value_that_is_no_choice_is_answered_with_the_nearest():
    with pytest.raises(UserError, match=r"there is no kind=conct; did you mean concat\?"):
        build({"_target_": f"{__name__}.Choice", "kind": "conct"}, "choice")


def test_an_error_of_a_loader_process_is_its_message_alone():
    caught = "Caught ValueError in DataLoader worker process 0.\nOriginal Traceback (most recent call last):\n  x\n"
    text = f"{caught}ValueError: a.jpg is cut\n"
    assert one_line(ValueError(text)) == "a.jpg is cut"


def test_line_breaks_are_folded():
    assert one_line(ValueError("a\n  b")) == "a b"


@beartype
class Measured:
    def __init__(
        self, width: float, sizes: list[float], by_name: dict[str, float] | None = None, count: int = 1
    ) -> None:
        self.values = [width, *sizes, *(by_name or {}).values(), count]


def test_whole_numbers_are_numbers():
    node = {"_target_": f"{__name__}.Measured", "width": 1, "sizes": [1, 2.5], "by_name": {"a": 3}, "count": 4}
    built = build(node, "thing").values
    assert built == [1, 1, 2.5, 3, 4]
    assert [type(value) for value in built] == [float, float, float, float, int]


def test_true_is_no_number():
    with pytest.raises(UserError, match="width=True is not of type float"):
        build({"_target_": f"{__name__}.Measured", "width": True, "sizes": []}, "thing")


def test_a_list_where_a_mapping_stands_says_what_the_setting_is():
    with pytest.raises(ConfigCompositionException) as raised:
        composed("train", "model.losses.class_weights=[1,2]")
    assert one_line(raised.value) == (
        "model.losses.class_weights=[1,2]: the setting is a mapping, {name: value, ...}, or one value, not a list, or the"
        " other way round"
    )
