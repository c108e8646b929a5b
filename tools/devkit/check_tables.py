"""The thirteen tables: every link leads somewhere, time runs forwards, every file is there."""

import os
from collections.abc import Iterator

import numpy as np
from findings import Finding, none_of
from nuscenes import NuScenes
from PIL import Image
from project import nuscenes_format

CHAINS = {
    "sample": "samples of a scene",
    "sample_data": "firings of a sensor",
    "sample_annotation": "boxes of an object",
}


def check_tables(tree: NuScenes) -> Iterator[Finding]:
    """Links, time stamps, files, and the records of logs and maps."""
    for table, of in CHAINS.items():
        rows = getattr(tree, table)
        wrong = [row["token"] for row in rows if not _linked(tree, table, row)]
        yield none_of(f"{of}: prev and next mirror each other and time grows", wrong, len(rows))
    yield from _scenes(tree)
    yield from _files(tree)
    logs = {token for record in tree.map for token in record["log_tokens"]}
    wrong = [log["logfile"] for log in tree.log if log["token"] not in logs or log["location"] == ""]
    yield none_of("logs: each has a map and a place", wrong, len(tree.log))
    wrong = [r["filename"] for r in tree.map if not set(np.unique(r["mask"].mask())) <= {0, 255}]
    yield none_of("maps: the mask's pixels are 0 or 255", wrong, len(tree.map))
    wrong = [category["name"] for category in tree.category if category["name"] not in tree.colormap]
    yield none_of("categories: each is one of nuScenes' own, which have a colour", wrong, len(tree.category))


def stamp(tree: NuScenes, row: dict) -> int:
    """Microseconds of a record."""
    return row["timestamp"] if "timestamp" in row else tree.get("sample", row["sample_token"])["timestamp"]


def _linked(tree: NuScenes, table: str, row: dict) -> bool:
    if not row["next"]:
        return True
    after = tree.get(table, row["next"])
    return after["prev"] == row["token"] and stamp(tree, after) > stamp(tree, row)


def _scenes(tree: NuScenes) -> Iterator[Finding]:
    wrong = []
    for scene in tree.scene:
        tokens = tree.field2token("sample", "scene_token", scene["token"])
        ends = [token for token in tokens if not tree.get("sample", token)["next"]]
        if len(tokens) != scene["nbr_samples"] or ends != [scene["last_sample_token"]]:
            wrong.append(scene["name"])
    yield none_of("scenes: as many samples as they say, the last one last", wrong, len(tree.scene))
    late = [
        abs(tree.get("sample_data", sample["data"][nuscenes_format.REFERENCE])["timestamp"] - sample["timestamp"])
        * 1e-3
        for sample in tree.sample
    ]
    yield Finding("samples: from the stamp to that of LIDAR_TOP", max(late), "<=", 50, len(late), "ms")


def _files(tree: NuScenes) -> Iterator[Finding]:
    """All files are there; of the first samples' images the size is looked at."""
    missing = [
        r["filename"] for r in tree.sample_data if not os.path.exists(os.path.join(tree.dataroot, r["filename"]))
    ]
    yield none_of("sensor files: all are there", missing, len(tree.sample_data))
    images = [r for r in tree.sample_data if r["sensor_modality"] == "camera"][:64]
    sizes = [Image.open(os.path.join(tree.dataroot, record["filename"])).size for record in images]
    wrong = [r["filename"] for r, size in zip(images, sizes, strict=True) if size != (r["width"], r["height"])]
    yield none_of("images: as large as the table says", wrong, len(images))
