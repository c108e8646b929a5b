"""Which scenes a split has: what ``splits.json`` says or, as real nuScenes has none, the official lists.

``official_splits.json`` is copied from the nuscenes-devkit, which knows them by heart.
"""

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from fusion_net.common.nuscenes_format import SPLITS_FILE
from fusion_net.nuscenes.tables import read_json, repair_advice, shown

OFFICIAL = {"v1.0-mini": ("mini_train", "mini_val"), "v1.0-trainval": ("train", "val"), "v1.0-test": ("test",)}
"""Names of the official splits by version."""


def read_splits(folder: Path, scenes: Sequence[str]) -> dict[str, list[str]]:
    """Scene names by split of a version folder whose scene table has ``scenes``; "all" is every scene.

    Of an official list the scenes that are there, as the devkit takes it.
    """
    path = folder / SPLITS_FILE
    if path.exists():
        named = _read(path)
    else:
        official = official_splits()
        named = {name: [s for s in official[name] if s in {*scenes}] for name in OFFICIAL.get(folder.name, ())}
    return named | {"all": list(scenes)}


@cache
def official_splits() -> dict[str, list[str]]:
    """Scene names of nuScenes' mini_train, mini_val, train, val and test."""
    return json.loads(Path(__file__).with_name("official_splits.json").read_bytes())["splits"]


def _read(path: Path) -> dict[str, list[str]]:
    try:
        named = read_json(path)
    except ValueError as error:
        raise ValueError(f"{error}; {repair_advice(path.parent.parent)}") from None
    if not isinstance(named, dict):
        raise ValueError(f"{path} is not a list of scene names by the name of a split")
    for name, scenes in named.items():
        if not isinstance(scenes, list) or not all(isinstance(scene, str) for scene in scenes):
            raise ValueError(f"{path}: the split {name!r} is {shown(scenes)}, which is not a list of scene names")
    return named
