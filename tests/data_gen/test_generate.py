import errno
import hashlib
import json
import shlex
import shutil
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from hydra import compose, initialize_config_dir

from data_gen.generate import DataConfig, Job, generate, record_path
from data_gen.jobs.manifest import FORMAT, only_generator, without_place
from data_gen.jobs.shard import Shard
from data_gen.rig.mounts import Camera, Lidar, Radar
from data_gen.rig.rig import Rig
from data_gen.scene.conditions import ConditionMix, Preset
from fusion_net.common.cli.command import CONFIGS
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.lidar_models import HDL32E
from tests.fixtures.scenarios import MIXED

COMMAND = "python -m data_gen data=nano condition=fog"


@pytest.fixture(scope="module")
def rig():
    return Rig(
        name="tiny",
        sweeps={"radar": 1, "lidar": 1},
        cameras={
            "CAM_FRONT": Camera(
                translation=[1.7, 0.1, 1.5],
                rotation_deg=[1.0, 2.0, -3.0],
                rate=30.0,
                width=64,
                height=32,
                hfov_deg=70.0,
            )
        },
        lidars={"LIDAR_TOP": Lidar(model=HDL32E, translation=[0.9, 0.0, 1.8], rate=10.0, columns=180)},
        radars={"RADAR_FRONT": Radar(translation=[3.4, 0.0, 0.5], rate=20.0)},
    )


def job(root, rig, *, num_scenes=3, seed=5, **weights):
    data = DataConfig(
        name="tiny", root=str(root), num_scenes=num_scenes, keyframes=2, split_weights=weights or {"train": 1, "val": 1}
    )
    scenario = replace(MIXED, layouts={"train": {"highway": 1, "two_way": 1}})
    clear = Preset(illuminance=[40_000.0, 80_000.0], sun_elevation=[30.0, 60.0])
    condition = ConditionMix(presets={"clear": [clear]}, weights={"clear": 1.0})
    return Job(data=data, rig=rig, scenario=scenario, condition=condition, seed=seed)


def settings(seed=5):
    return {"seed": seed, "rig": "tiny"}


def tree_hash(root):
    files = sorted(path for path in root.rglob("*") if path.is_file())
    return {str(p.relative_to(root)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture(scope="module")
def tree(rig, tmp_path_factory):
    root = tmp_path_factory.mktemp("data") / "tree"
    generate(job(root, rig), settings=settings(), workers=1, command=COMMAND)
    return root


def table(root, name):
    return json.loads((root / "v1.0-tiny" / f"{name}.json").read_text())


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


def test_the_command_is_kept_without_folder_and_processes():
    words = ["python", "-m", "data_gen", "data=nano", "data.root=/some/where", "workers=4", "+data.root=x"]
    assert without_place([*words, "condition=fog"]) == COMMAND


@pytest.mark.parametrize("place", ["plain", "with = and, blank"])
@pytest.mark.parametrize("shard", [None, Shard(1, 2)])
def test_a_half_generated_tree_tells_the_command_that_goes_on_wherever_it_lies_now(
    rig, tmp_path, monkeypatch, place, shard
):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Job, "make", interrupted)
    with pytest.raises(KeyboardInterrupt):
        generate(job(tmp_path / "first", rig), settings=settings(), workers=1, command=COMMAND, shard=shard)
    root = (tmp_path / "first").rename(tmp_path / place)
    with pytest.raises(ValueError, match="half generated") as error:
        NuScenes(shard.folder(root) if shard else root)
    words = shlex.split(str(error.value).rpartition(": ")[2])
    assert words[:-1] == COMMAND.split()
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        assert compose("data_gen", overrides=words[3:]).data.root == str(root)


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


def test_shards_of_other_settings_or_another_count_or_beside_a_whole_set_are_refused(tree, rig, tmp_path):
    generate(job(tmp_path, rig, num_scenes=2), settings=settings(), workers=1, shard=Shard(2, 2))
    with pytest.raises(ValueError, match=r"shard-2-of-2 was generated with other settings \(seed: 5 there, 6 asked"):
        generate(job(tmp_path, rig, seed=6), settings=settings(seed=6), workers=1, shard=Shard(1, 2))
    with pytest.raises(ValueError, match="shard-2-of-2 is none of 3 shards"):
        generate(job(tmp_path, rig), settings=settings(), workers=1, shard=Shard(1, 3))
    with pytest.raises(ValueError, match="holds a data set that is not in shards"):
        generate(job(tree, rig), settings=settings(), workers=1, shard=Shard(1, 2))
    with pytest.raises(ValueError, match="holds shards; pass shard=NUMBER/COUNT"):
        generate(job(tmp_path, rig), settings=settings(), workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["shard-2-of-2"]


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


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ('{"format": 99, "rows": []}', "was made by format 99 of the generator"),
        (f'{{"format": {FORMAT}, "ha', "manifest.json is damaged"),
        ('{"hash": "x"}', "manifest.json is damaged"),
        ("[]", "manifest.json is damaged"),
    ],
)
def test_a_manifest_of_another_format_or_a_damaged_one_is_refused(rig, tmp_path, text, answer):
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(ValueError, match=answer):
        generate(job(tmp_path, rig), settings=settings(), workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]
    assert (tmp_path / "manifest.json").read_text() == text


def test_a_second_generator_in_the_same_folder_is_refused(rig, tmp_path):
    with (
        only_generator(tmp_path),
        pytest.raises(ValueError, match="another generator is writing"),
        only_generator(tmp_path),
    ):
        pass
    with only_generator(tmp_path):  # free again
        pass


def test_a_full_disk_is_named_with_what_to_do(rig, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device", "x.jpg")

    monkeypatch.setattr("data_gen.generate.record_scene", full)
    root = tmp_path / "full"
    with pytest.raises(OSError, match=r"the disk of .*full is full .*No space left on device: 'x.jpg'.*make room"):
        generate(job(root, rig, num_scenes=1), settings=settings(), workers=1)
    assert not json.loads((root / "manifest.json").read_text())["complete"]


def test_without_room_nothing_begins_and_the_same_command_goes_on_later(tree, rig, tmp_path, monkeypatch):
    root = tmp_path / "x"
    with monkeypatch.context() as patch:
        patch.setattr("data_gen.jobs.manifest.ROOM", 10**18)
        with pytest.raises(OSError, match="make room and give the same command again"):
            generate(job(root, rig, num_scenes=1), settings=settings(), workers=1)
    monkeypatch.setattr(Job, "make", lambda self, index, split: shutil.copytree(tree, root, dirs_exist_ok=True))
    assert generate(job(root, rig, num_scenes=1), settings=settings(), workers=1)["complete"]


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


def test_other_settings_in_the_same_folder_are_refused_and_nothing_is_lost(tree, rig):
    before = tree_hash(tree)
    with pytest.raises(ValueError, match="seed: 5 there, 6 asked for"):
        generate(job(tree, rig, seed=6), settings=settings(seed=6), workers=1)
    assert tree_hash(tree) == before


def test_a_folder_with_other_files_is_refused(rig, tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ValueError, match="holds other files"):
        generate(job(tmp_path, rig), settings=settings(), workers=1)
    assert (tmp_path / "thesis.txt").read_text() == "mine"


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
