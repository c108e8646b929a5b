"""Names of result folders: no two evaluations share one."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion_net.evaluation.result_folder import is_same_data, result_folder

RUN = Path("runs/mine")


class Tree:
    """Knows the splits nano_val and nano_test by short names too."""

    def split_name(self, name):
        return {"val": "nano_val", "test": "nano_test"}.get(name, name)


def folder(split="val", root="data/nano", **more):
    made = result_folder(RUN, [Tree()], split=split, own_split="val", root=root, own_root="data/nano", **more)
    return str(made.relative_to(RUN))


def test_parts_name_what_is_not_as_the_run_validated():
    assert folder() == folder(split="nano_val") == folder(root="./data/nano/") == "eval"
    assert folder(split="test") == "eval/test"
    assert folder(root="data/fog") == "eval/val@data-fog"
    assert folder(root=["data/fog", "data/rain"]) == "eval/val@data-fog+data-rain"
    assert folder(fault="lidar_rotation_3") == "eval/lidar_rotation_3"
    assert folder(split="test", checkpoint="last", fault="dead_lidar_1") == "eval/test/last/dead_lidar_1"


def test_data_is_the_same_in_any_order_and_spelling():
    assert is_same_data(["a", "b/../c"], ["c", str(Path("a").resolve())])
    assert not is_same_data("a", ["a", "b"])


@pytest.mark.parametrize("pair", [("a/b", "a-b"), ("x/nano", "y/nano"), ("/data/fog", "data/fog"), ("a=b", "a,b")])
def test_roots_that_differ_only_in_signs_or_place_are_told_apart(pair):
    assert folder(root=pair[0]) != folder(root=pair[1])


PATHS = st.lists(st.text("ab-_.,=' é/", min_size=1, max_size=90), min_size=1, max_size=2)


@given(PATHS, PATHS)
def test_two_roots_share_a_folder_only_if_they_are_the_same_and_its_name_is_plain(one, other):
    names = folder(root=one), folder(root=other)
    assert (names[0] == names[1]) == ([Path(p).resolve() for p in one] == [Path(p).resolve() for p in other])
    for name in names:
        assert not set(Path(name).name) & set("=,'\" ")
        assert len(name) < 200
