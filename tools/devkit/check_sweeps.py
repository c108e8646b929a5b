"""Several sweeps in one cloud, as the devkit puts them together: what stood still must lie on itself."""

from collections.abc import Iterator

import numpy as np
from check_boxes import MARGIN, global_T_sensor
from findings import Finding, share
from nuscenes import NuScenes
from nuscenes.utils.data_classes import LidarPointCloud, RadarPointCloud
from nuscenes.utils.geometry_utils import points_in_box
from project import nuscenes_format

REFERENCE = nuscenes_format.REFERENCE

STILL = 0.05
"""m/s of an object at rest."""


def check_sweeps(tree: NuScenes, samples: list[dict]) -> Iterator[Finding]:
    """Points of the keyframe before, carried by the devkit into this one's frame, still lie in the boxes of what stands."""
    back, inside, of = _sweeps_between(tree, REFERENCE), 0, 0
    for sample in samples:
        if sample["prev"]:
            found, labelled = _carried(tree, sample, back)
            inside, of = inside + found, of + labelled
    yield share("LiDAR points of objects at rest, half a second on: inside the box", inside, of, 0.95)
    yield from _radar(tree, samples)


def _sweeps_between(tree: NuScenes, channel: str) -> int:
    """Firings of a channel from one keyframe to the next."""
    record = tree.get("sample_data", tree.sample[-1]["data"][channel])
    steps = 1
    while record["prev"] and not tree.get("sample_data", record["prev"])["is_key_frame"]:
        record, steps = tree.get("sample_data", record["prev"]), steps + 1
    return steps


def _carried(tree: NuScenes, sample: dict, back: int) -> tuple[int, int]:
    record = tree.get("sample_data", sample["data"][REFERENCE])
    cloud, ages = LidarPointCloud.from_file_multisweep(tree, sample, REFERENCE, REFERENCE, nsweeps=back + 1)
    before = tree.get("sample", sample["prev"])
    age = 1e-6 * (record["timestamp"] - tree.get("sample_data", before["data"][REFERENCE])["timestamp"])
    cloud.transform(global_T_sensor(tree, record))
    points = cloud.points[:3, np.abs(ages[0] - age) < 1e-3]
    now = {row["instance_token"]: row for row in (tree.get("sample_annotation", token) for token in sample["anns"])}
    inside, of = 0, 0
    for token in before["anns"]:
        row = tree.get("sample_annotation", token)
        again = now.get(row["instance_token"])
        if again and np.linalg.norm(np.subtract(again["translation"], row["translation"])) < STILL * age:
            box = tree.get_box(again["token"])
            box.wlh = box.wlh + 2 * MARGIN
            count = row.get(nuscenes_format.LIDAR_ECHOES, row["num_lidar_pts"])
            of += count
            inside += min(count, int(points_in_box(box, points).sum()))
    return inside, of


def _radar(tree: NuScenes, samples: list[dict]) -> Iterator[Finding]:
    """Radar scans put together by the devkit; ages must not be negative beyond a radar's own period."""
    points, ages = 0, [0.0]
    for sample in samples:
        for channel in (c for c in sample["data"] if c.startswith("RADAR")):
            cloud, times = RadarPointCloud.from_file_multisweep(tree, sample, channel, REFERENCE, nsweeps=3)
            points += cloud.nbr_points()
            ages += times[0, :1].tolist() + times[0, -1:].tolist()
    yield Finding("radar returns a keyframe, all units, three scans", points / len(samples), ">=", 1, points)
    yield Finding("radar returns: youngest age", min(ages), ">=", -0.1, points, "s")
