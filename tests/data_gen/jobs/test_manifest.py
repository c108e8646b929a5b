"""What a folder of data says of itself, and which generator may write into it."""

import errno
import json
import shlex
import shutil

import pytest
from hydra import compose, initialize_config_dir

from data_gen.generate import Job, generate
from data_gen.jobs.manifest import FORMAT, only_generator, without_place
from data_gen.jobs.shard import Shard
from fusion_net.common.cli.command import CONFIGS
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.small_generation import COMMAND, job, settings, tree_hash


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
