"""The tables hold together; one process or two, in shards, or cut short and gone on with: the same bytes."""

import json
import shutil
from datetime import UTC, datetime

import pytest

from data_gen.generate import Job, generate, record_path
from data_gen.jobs.shard import Shard
from tests.fixtures.small_generation import COMMAND, job, settings, table, tree_hash


def test_every_link_between_tables_holds(tree):
    tokens = {name: {row["token"] for row in table(tree, name)} for name in (
        "sample", "scene", "log", "instance", "category", "attribute", "ego_pose", "calibrated_sensor", "sensor")}  # fmt: skip
    for row in table(tree, "sample_data"):
        assert row["sample_token"] in tokens["sample"]
        assert row["ego_pose_token"] in tokens["ego_pose"]
        assert row["calibrated_sensor_token"] in tokens["calibrated_sensor"]
        assert (tree / row["filename"]).is_file()
    for row in table(tree, "sample_annotation"):
        assert row["sample_token"] in tokens["sample"]
        assert row["instance_token"] in tokens["instance"]
        assert set(row["attribute_tokens"]) <= tokens["attribute"]
        assert min(row["size"]) > 0
    assert {row["scene_token"] for row in table(tree, "sample")} == tokens["scene"]
    mapped = {t for row in table(tree, "map") for t in row["log_tokens"]}
    assert mapped == tokens["log"]


def test_chains_of_a_channel_run_forward_in_time(tree):
    rows = {row["token"]: row for row in table(tree, "sample_data")}
    for row in rows.values():
        if row["next"]:
            assert rows[row["next"]]["timestamp"] > row["timestamp"]
            assert rows[row["next"]]["prev"] == row["token"]
    sweeps = [row for row in rows.values() if not row["is_key_frame"]]
    stamps = {row["token"]: row["timestamp"] for row in table(tree, "sample")}
    assert sweeps
    assert all(row["timestamp"] <= stamps[row["sample_token"]] for row in rows.values())


def test_labels_move_by_their_velocity(tree):
    by_instance = {}
    stamps = {row["token"]: row["timestamp"] for row in table(tree, "sample")}
    for row in table(tree, "sample_annotation"):
        by_instance.setdefault(row["instance_token"], []).append(row)
    pairs = [rows for rows in by_instance.values() if len(rows) == 2]
    assert pairs
    for first, second in pairs:
        dt = (stamps[second["sample_token"]] - stamps[first["sample_token"]]) / 1e6
        for axis in range(2):
            mean = (first["velocity"][axis] + second["velocity"][axis]) / 2
            assert (second["translation"][axis] - first["translation"][axis]) / dt == pytest.approx(mean, abs=1.0)


def test_two_workers_in_another_folder_write_the_same_bytes(tree, rig, tmp_path):
    generate(job(tmp_path / "two", rig), settings=settings(), workers=2, command=COMMAND)
    assert {"manifest.json", "v1.0-tiny/splits.json", "v1.0-tiny/sample_data.json"} < tree_hash(tree).keys()
    assert tree_hash(tmp_path / "two") == tree_hash(tree)
    assert not any(str(tmp_path).encode() in path.read_bytes() for path in (tmp_path / "two").rglob("*.json"))


def test_the_date_of_a_log_is_that_of_its_stamps(tree):
    scenes = {row["token"]: row["log_token"] for row in table(tree, "scene")}
    dates = {row["token"]: row["date_captured"] for row in table(tree, "log")}
    for row in table(tree, "sample"):
        captured = datetime.fromtimestamp(row["timestamp"] / 1e6, UTC).date()
        assert dates[scenes[row["scene_token"]]] == captured.isoformat()


def test_shards_together_hold_the_bytes_of_the_whole(tree, rig, tmp_path):
    made = [generate(job(tmp_path, rig), settings=settings(), workers=1, shard=Shard(n, 2)) for n in (1, 2)]
    roots = [tmp_path / "shard-1-of-2", tmp_path / "shard-2-of-2"]
    assert sorted(tmp_path.iterdir()) == roots
    assert {manifest["hash"] for manifest in made} == {json.loads((tree / "manifest.json").read_text())["hash"]}
    whole, *parts = [
        {path: hash for path, hash in tree_hash(root).items() if "/" in path and "v1.0" not in path}
        for root in (tree, *roots)
    ]
    assert not parts[0].keys() & parts[1].keys()
    assert parts[0] | parts[1] == whole
    for name in ("scene", "sample", "sample_data", "ego_pose", "sample_annotation", "instance", "log", "map"):
        rows = [row for root in roots for row in table(root, name)]
        assert sorted(rows, key=str) == sorted(table(tree, name), key=str)
    assert all(table(root, "calibrated_sensor") == table(tree, "calibrated_sensor") for root in roots)
    shared = [json.loads((root / "v1.0-tiny/splits.json").read_text()) for root in roots]
    whole = json.loads((tree / "v1.0-tiny/splits.json").read_text())
    assert {name: sorted(s for part in shared for s in part.get(name, [])) for name in whole} == whole


def test_a_record_that_was_cut_short_is_made_again(tree, rig, tmp_path):
    root = tmp_path / "cut"
    shutil.copytree(tree, root)
    record = record_path(root, 1)
    record.write_bytes(record.read_bytes()[:-40])
    generate(job(root, rig), settings=settings(), workers=1, command=COMMAND)
    assert tree_hash(root) == tree_hash(tree)


def test_scenes_whose_sensor_files_are_gone_are_made_again(tree, rig, tmp_path):
    root = tmp_path / "lost"
    shutil.copytree(tree, root)
    image, *_ = sorted((root / "samples/CAM_FRONT").glob("*.jpg"))
    image.unlink()
    scan = next(iter(sorted((root / "samples/RADAR_FRONT").glob("*.pcd"), reverse=True)))
    scan.write_bytes(b"")
    generate(job(root, rig), settings=settings(), workers=1, command=COMMAND)
    assert tree_hash(root) == tree_hash(tree)


def test_an_interrupted_run_goes_on_to_the_same_tree(tree, rig, tmp_path, monkeypatch):
    root = tmp_path / "cut"
    whole, made = Job.make, []

    def cut_short(self, index, split):
        if index == 1 and not made:
            made.append(index)
            raise KeyboardInterrupt
        whole(self, index, split)

    monkeypatch.setattr(Job, "make", cut_short)
    with pytest.raises(KeyboardInterrupt):
        generate(job(root, rig), settings=settings(), workers=1)
    assert record_path(root, 0).exists()
    assert not json.loads((root / "manifest.json").read_text())["complete"]
    generate(job(root, rig), settings=settings(), workers=1, command=COMMAND)
    assert tree_hash(root) == tree_hash(tree)


def test_more_scenes_begin_like_fewer(tree, rig, tmp_path):
    longer = job(tmp_path / "x", rig, num_scenes=50, train=20, val=2, test=1).data.splits()
    shorter = job(tmp_path / "x", rig, num_scenes=20, train=20, val=2, test=1).data.splits()
    assert longer[:20] == shorter
    assert set(shorter) == {"train", "val", "test"}
    many = job(tmp_path / "x", rig, num_scenes=920, train=20, val=2, test=1).data.splits()
    assert [many.count(s) for s in ("train", "val", "test")] == [800, 80, 40]


@pytest.mark.parametrize("weights", [{"train": -1, "val": 2}, {"train": 0}])
def test_split_weights_that_share_nothing_out_are_refused(rig, tmp_path, weights):
    with pytest.raises(ValueError, match="negative or all zero"):
        job(tmp_path / "x", rig, **weights)


@pytest.mark.parametrize("workers", [0, -1, "many"])
def test_a_number_of_workers_that_is_none_is_refused(rig, tmp_path, workers):
    with pytest.raises(ValueError, match=f"workers={workers} is not a number of processes"):
        generate(job(tmp_path / "x", rig), settings=settings(), workers=workers)
    assert not (tmp_path / "x").exists()
