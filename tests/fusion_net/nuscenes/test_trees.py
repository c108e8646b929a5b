import json
import shutil
from pathlib import Path

import pytest

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.nuscenes.datasets import open_datasets, samples_of_split
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.origin import whole_command
from tests.fixtures.real_tree import edit
from tests.fixtures.tiny_tree import write_tree

GRID = BEVGrid(0.0, 32.0, -12.8, 16.0, 0.8)
SCENES = [f"scene-{s:04d}" for s in range(5)]


@pytest.fixture
def whole(tmp_path):
    return write_tree(tmp_path / "whole", scenes=5, keyframes=2)


def cut(whole, shard, scenes, *, hash="a" * 64):
    """A shard: a copy of the tree that knows only some of its scenes."""
    shutil.copytree(whole, shard)
    for name, of in (("scene", "name"), ("sample", "scene_token"), ("sample_data", "sample_token")):
        edit(shard, name, lambda row, of=of: row[of].startswith(tuple(scenes)))
    splits = {"tiny_train": [s for s in scenes if s != SCENES[-1]], "tiny_val": [s for s in scenes if s == SCENES[-1]]}
    (shard / "v1.0-tiny/splits.json").write_text(json.dumps({k: v for k, v in splits.items() if v}))
    (shard / "manifest.json").write_text(json.dumps({"hash": hash, "complete": True}))
    return shard


@pytest.fixture
def shards(whole, tmp_path):
    root = tmp_path / "shards"
    for number in (1, 2, 3):
        cut(whole, root / f"shard-{number}-of-3", SCENES[number - 1 :: 3])
    return root


def tokens(root, split):
    return [token for _, token in samples_of_split(open_datasets(root), split)]


def test_a_folder_of_shards_and_a_list_of_them_read_as_the_whole(whole, shards, capsys):
    listed = [str(path) for path in sorted(shards.iterdir())]
    for split in ("train", "val", "all"):
        assert tokens(str(shards), split) == tokens(listed, split) == tokens(str(whole), split)
    one, many = (NuScenesDataset(str(root), "train", grid=GRID) for root in (whole, shards))
    assert [sample.token for sample in one] == [sample.token for sample in many]
    assert many.fingerprint == ["a" * 64]
    assert capsys.readouterr().err == ""


def test_the_first_scenes_of_a_split_are_nested_whether_in_shards_or_whole(whole, shards):
    def chosen(root, scenes):
        return [token for _, token in samples_of_split(open_datasets(str(root)), "train", scenes=scenes)]

    one, two = chosen(whole, 1), chosen(whole, 2)
    everything = tokens(str(whole), "train")
    assert one == two[: len(one)] == everything[: len(one)]
    assert 0 < len(one) < len(two) < len(everything)
    assert chosen(shards, 2) == two
    assert chosen(whole, 4) == everything
    for root in (whole, shards):
        with pytest.raises(
            ValueError, match=f"scenes=100: of the split 'train' {root} has 4; give fewer, or null for all"
        ):
            chosen(root, 100)
    with pytest.raises(ValueError, match="scenes=0 leaves nothing of the split 'train'"):
        chosen(whole, 0)


def test_missing_shards_are_named_once(shards, capsys):
    shutil.rmtree(shards / "shard-1-of-3")
    assert [len(tokens(str(shards), split)) for split in ("train", "val")] == [4, 2]
    assert capsys.readouterr().err == f"warning: {shards}: 2 of 3 shards are there; missing: 1\n"


def test_shards_that_do_not_belong_together_are_refused(whole, shards):
    other = cut(whole, shards / "shard-1-of-4", SCENES[:1])
    with pytest.raises(ValueError, match="holds shards of 3 and of 4"):
        open_datasets(str(shards))
    shutil.rmtree(other)
    (shards / "shard-2-of-3/manifest.json").write_text(json.dumps({"hash": "b" * 64}))
    with pytest.raises(ValueError, match=r"shard-1-of-3 and .*shard-2-of-3 were generated with other settings"):
        open_datasets(str(shards))


def test_a_half_generated_shard_names_the_command(shards):
    command = "python -m data_gen data=tiny shard=3/3"
    manifest = {"hash": "a" * 64, "complete": False, "shard": {"number": 3, "count": 3}, "command": command}
    (shards / "shard-3-of-3/manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match=rf"shard-3-of-3 is half generated.*: {command} data.root={shards}$"):
        open_datasets(str(shards))


@pytest.mark.parametrize(
    ("command", "shard", "whole"),
    [
        ("python -m data_gen data=tiny", None, "python -m data_gen data=tiny data.root=data/x/shard-1-of-3"),
        (
            "python -m data_gen data=tiny shard=1/3 seed=2",
            {"number": 1},
            "python -m data_gen data=tiny seed=2 data.root=data/x",
        ),
        (
            "python -m data_gen -m shard=1/3,2/3 hydra/launcher=joblib",
            {"number": 1},
            "python -m data_gen data.root=data/x",
        ),
        ("", None, ""),
    ],
)
def test_shards_are_made_again_as_one(command, shard, whole):
    assert whole_command(Path("data/x/shard-1-of-3"), {"command": command, "shard": shard}) == whole


def test_the_same_scene_twice_is_refused(whole, shards):
    with pytest.raises(ValueError, match="hold the same samples, of scene-0000: leave one out"):
        samples_of_split(open_datasets([str(whole), str(shards)]), "train")


def test_several_trees_follow_each_other_and_one_may_lack_the_split(tmp_path):
    one = NuScenes(write_tree(tmp_path / "one", scenes=2, keyframes=2))
    other = write_tree(tmp_path / "other", scenes=1, keyframes=2)
    (other / "v1.0-tiny/splits.json").write_text("{}")
    other = NuScenes(other)
    assert [token for _, token in samples_of_split([one, other], "val")] == one.split("val")
    with pytest.raises(ValueError, match="hold the same samples"):
        samples_of_split([one, other], "all")
    with pytest.raises(ValueError, match="no split 'val'"):
        samples_of_split([other], "val")


def test_images_that_no_batch_can_hold_are_refused(tmp_path):
    roots = [write_tree(tmp_path / name, scenes=1, keyframes=1) for name in ("two", "one")]
    for name in ("sensor", "calibrated_sensor", "sample_data", "scene", "sample", "sample_annotation"):
        path = roots[1] / "v1.0-tiny" / f"{name}.json"
        rows = json.loads(path.read_text().replace("scene-0000", "scene-0007"))
        path.write_text(json.dumps([row for row in rows if "CAM_BACK" not in row["token"]]))
    poses = roots[1] / "v1.0-tiny/ego_pose.json"
    poses.write_text(poses.read_text().replace("scene-0000", "scene-0007"))
    for path in roots[1].glob("s*s/*/*"):
        path.rename(path.with_name(path.name.replace("scene-0000", "scene-0007")))
    (roots[1] / "v1.0-tiny/splits.json").unlink()
    with pytest.raises(ValueError, match=r"two has 2 of 80x48, .*one has 1 of 80x48"):
        NuScenesDataset([str(root) for root in roots], "all", grid=GRID)
    cameras = {"cameras": ["CAM_FRONT"]}
    assert len(NuScenesDataset([str(root) for root in roots], "all", grid=GRID, **cameras)) == 2


def test_no_folder_at_all_is_refused():
    with pytest.raises(ValueError, match="names no folder"):
        open_datasets([])
