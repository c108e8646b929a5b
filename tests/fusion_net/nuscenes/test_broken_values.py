"""One field of one record replaced by junk: the tree is read, or one line names the table and the record."""

import copy
import json
import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.data.samples import SampleReader
from fusion_net.evaluation.decoys import read_bodies
from fusion_net.evaluation.scoring import ground_truth
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.table_fields import FIELDS, OPTIONAL
from fusion_net.reports.dataset.survey import survey
from tests.fixtures.tiny_tree import write_tree

GRID = BEVGrid(0.0, 64.0, -24.0, 32.0, 0.5)
BOXES = [
    {"category": "vehicle.car", "center": lambda t: (40 + 6 * t, 25, 1), "attribute": "vehicle.moving"},
    {"category": "movable_object.debris", "center": lambda t: (45, 20, 1)},
]
MISSING = object()
JUNK = (
    MISSING, None, True, False, float("nan"), float("inf"), 0, -1, 7, 10**30, -0.5, 1e300, "", "junk", "7", [], {}, [1], [[]],
    ["junk"], [None, 1, 2], [1, 2, float("nan")], [0, 0, 0], [-1, -1, -1], [0, 0, 0, 0], [1, 2, 3, 4], [1e300] * 4,
    [[1, 0, 0], [0, -1, 0], [0, 0, 1]], [[0] * 3] * 3, {"name": 3}, "no\nlines",
)  # fmt: skip
PLACES = [(table, field) for fields in (FIELDS, OPTIONAL) for table in fields for field in ("token", *fields[table])]


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """A whole tree's root and tables, with every field that a generated one has."""
    root = write_tree(tmp_path_factory.mktemp("whole") / "tree", scenes=1, keyframes=2, sweeps=1, boxes=BOXES)
    found = {path.stem: json.loads(path.read_bytes()) for path in (root / "v1.0-tiny").glob("*.json")}
    for label in found["sample_annotation"]:
        label |= {"velocity": [0.0, 0.0], "imitates": "vehicle.car" if "object-1" in label["token"] else ""}
    for mount in found["calibrated_sensor"]:
        mount |= {"height": 48, "width": 80}
    found["scene"][0] |= {"layout": "merge", "condition": {"name": "fog", "severity": 2}}
    return root, found


def read_everything(root: Path) -> None:
    """All that training, scoring and the statistics read."""
    dataset = NuScenesDataset(str(root), "all", grid=GRID)
    dataset.collate([dataset[place] for place in range(len(dataset))])
    dataset.has_labels()
    read_bodies(ground_truth(dataset), dataset.index)
    survey(dataset.index, files=2)


def spoil(tables, folder: Path, table: str, place: int, field: str, junk) -> tuple[Path, str]:
    """A tree with one value replaced, and the token of its record."""
    whole, found = tables
    (folder / "v1.0-tiny").mkdir(parents=True, exist_ok=True)
    for name in ("samples", "sweeps"):
        if not (folder / name).exists():
            (folder / name).symlink_to(whole / name)
    for name, records in found.items():
        if name == table:
            records = copy.deepcopy(records)
            record = records[place % len(records)]
            token = record["token"]
            if junk is MISSING:
                record.pop(field, None)
            else:
                record[field] = junk
        (folder / "v1.0-tiny" / f"{name}.json").write_text(json.dumps(records), encoding="utf-8")
    return folder, token


def check(root: Path, table: str, token: str, field: str) -> None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a time stamp of 7 us is far away, but a number
            read_everything(root)
    except ValueError as error:
        text = str(error)
        assert "\n" not in text
        assert f"{table}.json" in text or "no LIDAR_TOP keyframe" in text
        assert token in text or field == "token" or "no LIDAR_TOP keyframe" in text


def test_the_tree_is_read_as_it_is(tables, tmp_path):
    root, _ = spoil(tables, tmp_path, "scene", 0, "description", "")
    read_everything(root)


@settings(max_examples=60)
@given(where=st.sampled_from(PLACES), place=st.integers(0, 30), junk=st.sampled_from(JUNK))
def test_junk_in_any_field_is_read_or_named(tables, tmp_path_factory, where, place, junk):
    table, field = where
    root, token = spoil(tables, tmp_path_factory.mktemp("junk"), table, place, field, junk)
    check(root, table, token, field)


@pytest.mark.slow
@pytest.mark.parametrize(("table", "field"), PLACES)
def test_every_junk_in_every_field_is_read_or_named(tables, tmp_path, table, field):
    kinds = {record["token"].rpartition("-")[0]: place for place, record in enumerate(tables[1][table])}
    for junk in JUNK:
        for place in kinds.values():  # one record a channel, a scene, an object
            root, token = spoil(tables, tmp_path, table, place, field, junk)
            check(root, table, token, field)


@pytest.mark.parametrize(
    ("table", "field", "junk", "message"),
    [
        (
            "sample_annotation",
            "visibility_token",
            "v0-40",
            r"visibility_token='v0-40', which is not one of \"1\", \"2\"",
        ),
        ("sample_annotation", "num_lidar_pts", None, "num_lidar_pts=None, which is not a whole number of 0 or more"),
        (
            "sample_annotation",
            "size",
            [1.9, -4.6, 1.6],
            r"size=\[1.9, -4.6, 1.6\], which is not width, length and height",
        ),
        (
            "sample_annotation",
            "instance_token",
            "gone",
            "instance_token='gone', .*the token of a record of instance.json",
        ),
        ("ego_pose", "rotation", [0.0] * 4, r"rotation=\[0.0, 0.0, 0.0, 0.0\], which is not a unit quaternion"),
        ("ego_pose", "translation", [1.0, 2.0, float("nan")], r"translation=\[1.0, 2.0, nan\], .* finite numbers"),
        ("sample_data", "timestamp", "soon", "timestamp='soon', which is not a whole number"),
        ("sample_data", "ego_pose_token", "gone", "ego_pose_token='gone', .*the token of a record of ego_pose.json"),
        ("sample", "next", "gone", "next='gone', .*the token of a record of sample.json, or empty"),
    ],
)
def test_a_broken_value_is_named_with_its_file_record_and_field(tables, tmp_path, table, field, junk, message):
    root, token = spoil(tables, tmp_path, table, 0, field, junk)
    with pytest.raises(ValueError, match=rf"v1\.0-tiny/{table}\.json: the record '{token}' has {message}"):
        NuScenes(root)


def test_a_sample_that_leads_back_to_itself_is_named(tables, tmp_path):
    root, token = spoil(tables, tmp_path, "sample", 1, "next", "scene-0000-0")
    with pytest.raises(ValueError, match=r"sample\.json: the 'next' of the record 'scene-0000-0' leads back"):
        NuScenes(root).split("all")
    assert token == "scene-0000-1"


def test_two_records_of_one_token_are_named(tables, tmp_path):
    root, _ = spoil(tables, tmp_path, "sample_annotation", 1, "token", "scene-0000-object-0-0")
    with pytest.raises(
        ValueError, match=r"sample_annotation\.json: two records have the token 'scene-0000-object-0-0'"
    ):
        NuScenes(root)


def test_an_image_of_another_size_is_named_with_its_record(tables, tmp_path):
    at = next(i for i, record in enumerate(tables[1]["sample_data"]) if "CAM_FRONT" in record["token"])
    root, token = spoil(tables, tmp_path, "sample_data", at, "width", 352)
    with pytest.raises(ValueError, match="is an image of height=48, width=80, not of height=48, width=352") as error:
        SampleReader().read(NuScenes(root), "scene-0000-0")
    assert f"{token}.jpg" in str(error.value)
    assert f"sample_data.json: the record '{token}'" in str(error.value)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("num_lidar_pts", 0, "every label has num_lidar_pts=0 and num_radar_pts=0"),
        ("translation", [5000.0, 0.0, 0.0], r"no label with a LiDAR or radar point lies on the grid \(x 0.0 to 64.0 m"),
        (None, None, "none of its 2 samples has a label of car"),
    ],
)
def test_what_labels_lack_is_said(tables, tmp_path, field, value, message):
    root, _ = spoil(tables, tmp_path, "scene", 0, "description", "")
    path = root / "v1.0-tiny/sample_annotation.json"
    labels = json.loads(path.read_bytes()) if field else []
    path.write_text(json.dumps([label | {field: value} for label in labels]), encoding="utf-8")
    dataset = NuScenesDataset(str(root), "all", grid=GRID, classes=["car"])
    assert not dataset.has_labels()
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(dataset.why_no_labels())


def test_zero_bytes_after_the_end_of_an_image_are_harmless_and_a_cut_one_is_not(tmp_path):
    tree = NuScenes(write_tree(tmp_path, scenes=1, keyframes=1))
    path = tree.path(tree.keyframes["scene-0000-0"]["CAM_FRONT"])
    whole, data = SampleReader().read(tree, "scene-0000-0").images, path.read_bytes()
    path.write_bytes(data + bytes(4096))
    np.testing.assert_array_equal(SampleReader().read(tree, "scene-0000-0").images, whole)
    for cut in (data[:-2], data[: len(data) // 2], data[: len(data) // 2] + bytes(4096)):
        path.write_bytes(cut)
        with pytest.raises(ValueError, match=rf"{path} is damaged or cut short.*sample_data\.json: the record"):
            SampleReader().read(tree, "scene-0000-0")


def test_a_side_picture_of_another_kind_is_named(tmp_path):
    tree = NuScenes(write_tree(tmp_path, scenes=1, keyframes=1))
    depth = tree.path(tree.keyframes["scene-0000-0"]["CAM_FRONT"]).with_suffix(".depth.png")
    os.replace(depth.with_name(depth.name.replace("depth", "class")), depth)
    with pytest.raises(ValueError, match=rf"{depth} is no picture of one channel of uint16"):
        SampleReader().read(tree, "scene-0000-0")
