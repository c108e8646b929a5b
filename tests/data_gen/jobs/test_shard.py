from itertools import chain
from pathlib import Path

import pytest

from data_gen.jobs.shard import Shard


@pytest.mark.parametrize(("scenes", "count"), [(920, 64), (7, 7), (5, 2), (3, 1)])
def test_every_scene_is_in_one_shard(scenes, count):
    parts = [Shard(number, count).scenes(scenes) for number in range(1, count + 1)]
    assert sorted(chain(*parts)) == list(range(scenes))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_a_longer_data_set_keeps_the_scenes_of_each_shard():
    assert Shard(3, 8).scenes(100)[:12] == Shard(3, 8).scenes(96)


def test_folders_sort_by_number():
    names = [Shard.parse(f"{number}/64").folder(Path("data/nano")).name for number in range(1, 65)]
    assert names[2] == "shard-03-of-64"
    assert names == sorted(names)


@pytest.mark.parametrize("text", ["0/4", "5/4", "3", "a/b", "1/0", "-1/4", "1/2/3", "1 / 4"])
def test_what_is_no_shard_is_refused(text):
    with pytest.raises(ValueError, match=f"shard={text}"):
        Shard.parse(text)


def test_more_shards_than_scenes_are_refused():
    with pytest.raises(ValueError, match="4 scenes fill at most 4 shards"):
        Shard(1, 5).scenes(4)
