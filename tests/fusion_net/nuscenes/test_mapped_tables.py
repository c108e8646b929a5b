import pickle
import shutil

import numpy as np
import pytest

from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.nuscenes import mapped_tables
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.real_tree import edit
from tests.fixtures.tiny_tree import write_tree

BOXES = [
    {"category": "vehicle.car", "center": lambda t: (40 + 6 * t, 25, 1), "yaw": lambda t: 0.3 * t},
    {"category": "human.pedestrian.adult", "center": lambda t: (20, 25 - t, 1), "attribute": "pedestrian.moving"},
    {"category": "static_object.bicycle_rack", "center": lambda t: (30, 20, 1), "frames": [0, 2]},
]


@pytest.fixture
def root(tmp_path):
    return write_tree(tmp_path / "tree", scenes=3, boxes=BOXES)


def written(root):
    return list(root.glob(".cache/v1.0-tiny/*tables-*"))


def assert_same(mapped, plain):
    assert mapped.mapped is not None
    for name, records in plain.tables.items():
        assert list(mapped.tables[name].items()) == list(records.items())
        assert [mapped.tables[name][token] for token in records] == list(records.values())
    assert {token: mapped.keyframes[token] for token in mapped.keyframes} == plain.keyframes
    assert {token: mapped.sample_data_of[token] for token in mapped.sample_data_of} == plain.sample_data_of
    for record in plain.tables["sample_data"].values():
        assert mapped.global_T_ego(record).tobytes() == plain.global_T_ego(record).tobytes()
    for token in plain.split("all"):
        one, other = (nusc.annotations(token, CLASSES) for nusc in (mapped, plain))
        for part, twin in ((one, other), (one.boxes, other.boxes)):
            for name, value in vars(twin).items():
                if isinstance(value, np.ndarray):
                    np.testing.assert_array_equal(getattr(part, name), value, err_msg=name)
        assert mapped.racks(token).center.tolist() == plain.racks(token).center.tolist()


def test_mapped_tables_say_what_parsed_ones_say(root):
    plain = NuScenes(root)
    for _ in ("written", "read"):
        assert_same(NuScenes(root, mapped=True), plain)
    assert len(written(root)) == 1
    assert plain.mapped is None


def test_a_second_time_nothing_is_checked_or_parsed(root, monkeypatch):
    NuScenes(root, mapped=True)
    monkeypatch.delattr(mapped_tables, "load_tables")
    assert NuScenes(root, mapped=True).split("all")


def test_a_token_that_is_not_there_is_named(root):
    for _ in range(2):
        with pytest.raises(ValueError, match=r"sample_data.json has no record with the token 'zzz'"):
            NuScenes(root, mapped=True).get("sample_data", "zzz")


def test_tables_that_have_changed_are_checked_again(root):
    NuScenes(root, mapped=True)
    (old,) = written(root)
    edit(root, "sample_annotation", lambda record: record.update(num_lidar_pts=7))
    assert_same(NuScenes(root, mapped=True), NuScenes(root))
    edit(root, "sample_annotation", lambda record: record.update(num_lidar_pts=-1))
    with pytest.raises(ValueError, match="num_lidar_pts=-1"):
        NuScenes(root, mapped=True)
    edit(root, "sample_annotation", lambda record: record.update(num_lidar_pts=8))
    NuScenes(root, mapped=True)
    assert not old.exists()
    assert len(written(root)) == mapped_tables.KEPT


def test_tables_without_annotations(tmp_path):
    root = write_tree(tmp_path / "tree", scenes=2, keyframes=1)
    for _ in ("written", "read"):
        assert_same(NuScenes(root, mapped=True), NuScenes(root))


def test_where_nothing_can_be_written_tables_are_parsed(root):
    (root / ".cache").write_text("")
    assert NuScenes(root, mapped=True).mapped is None


def test_a_writer_that_was_killed_leaves_no_table_behind(root):
    NuScenes(root, mapped=True)
    (whole,) = written(root)
    whole.rename(whole.with_name(f".{whole.name}-7.part"))
    NuScenes(root, mapped=True)
    assert written(root) == [whole]


def test_a_process_that_is_spawned_maps_them_itself(root):
    data = pickle.dumps(NuScenes(root, mapped=True))
    assert_same(pickle.loads(data), NuScenes(root))
    shutil.rmtree(root / ".cache")


@pytest.mark.parametrize("damage", ["cut", "empty", "zeros", "head"])
def test_a_damaged_file_is_made_again(root, damage):
    NuScenes(root, mapped=True)
    (path,) = written(root)
    whole = path.read_bytes()
    middle = len(whole) // 2
    changed = {"cut": whole[:middle], "empty": b"", "zeros": whole[:middle] + bytes(40) + whole[middle + 40 :]}
    path.write_bytes(changed.get(damage, b"\xff" * 30 + whole[30:]))
    assert_same(NuScenes(root, mapped=True), NuScenes(root))
    assert path.read_bytes() == whole


def test_a_damaged_file_that_cannot_be_made_again_is_not_read(root, monkeypatch):
    NuScenes(root, mapped=True)
    (path,) = written(root)
    path.write_bytes(path.read_bytes()[:-100])
    monkeypatch.setattr(mapped_tables, "_is_writable", lambda folder: False)
    nusc = NuScenes(root, mapped=True)
    assert nusc.mapped is None
    assert nusc.tables == NuScenes(root).tables
