"""Radar scans as the devkit loads them, each with the labelled boxes as the sensor would see them at the scan's own time."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from check_boxes import global_T_sensor, velocity_of
from nuscenes import NuScenes
from nuscenes.utils.data_classes import Box, RadarPointCloud

NEAR_KEYFRAME = 0.1
"""Seconds from a keyframe up to which a box may be moved by its velocity alone, where no keyframe comes before."""
PERIOD = 0.05
"""Seconds by which ages are told apart: a radar of nuScenes fires every 75 ms, ours every 50 ms."""

SEEN, FAR = 5, 45.0
"""LiDAR points from which an object counts as in sight, and metres up to which."""
FRONT = (-0.4, 1.2)
"""Metres behind the nearest point of a box at which most returns lie: the range's noise is at most 0.2 m."""
UNAMBIGUOUS, MIRROR = 3, 0x06
"""ambig_state of a return whose Doppler is not folded, invalid_state of one that the sensor takes for a mirror image."""
ALL_RADARS, ALL_AGES = "all radars", "all ages"
KEYFRAME = "keyframe"


@dataclass(frozen=True)
class Seen:
    """A labelled object as a radar would see it. All lengths in metres."""

    instance: str
    category: str
    bearing: tuple[float, float]  # radians counter-clockwise from the boresight: right and left edge
    distance: tuple[float, float]  # of the nearest and the farthest point
    velocity: np.ndarray  # (2,) m/s over ground, in sensor axes
    lidar_points: int


@dataclass(frozen=True)
class Scan:
    """P returns of one firing, in the sensor's frame: x along the boresight, y left; none that it takes for a mirror image."""

    channel: str
    age: str  # "keyframe", or how long before its own channel's keyframe
    record: dict  # of sample_data
    range: np.ndarray  # (P,) metres
    bearing: np.ndarray  # (P,) radians counter-clockwise from the boresight
    speed: np.ndarray  # (P,) m/s along the ray, relative to the sensor: positive recedes
    ground_speed: np.ndarray  # (P,) m/s along the ray, over ground
    rcs: np.ndarray  # (P,) dBsm
    unfolded: (
        np.ndarray
    )  # (P,) bool: whether the speeds are certain; another fold of the Doppler reports wrong ones on purpose
    objects: list[Seen]

    def offsets(self, seen: Seen) -> tuple[np.ndarray, np.ndarray, float]:
        """Degrees (P,) from the middle of an object, metres (P,) behind its nearest point, and half its width in degrees."""
        right, left = np.degrees(seen.bearing)
        return np.degrees(self.bearing) - (right + left) / 2, self.range - seen.distance[0], float(left - right) / 2


def radar_scans(tree: NuScenes, samples: list[dict]) -> list[Scan]:
    """The scans of all radars in ``samples``: of each keyframe, and all since the keyframe before; with the objects that lie
    wholly in the field of view, in which 98 % of a radar's returns are, and in sight of the LiDAR."""
    scans = list(_scans(tree, samples))
    bearings: dict[str, list[np.ndarray]] = {}
    for scan in scans:
        bearings.setdefault(scan.channel, []).append(np.abs(scan.bearing))
    edges = {channel: float(np.percentile(np.append(np.concatenate(b), 0.0), 98)) for channel, b in bearings.items()}
    return [
        replace(scan, objects=[seen for seen in scan.objects if max(np.abs(seen.bearing)) < edges[scan.channel]])
        for scan in scans
    ]


def _scans(tree: NuScenes, samples: list[dict]) -> Iterator[Scan]:
    RadarPointCloud.disable_filters()
    for sample in samples:
        for channel in (name for name in sample["data"] if name.startswith("RADAR")):
            record = keyframe = tree.get("sample_data", sample["data"][channel])
            yield _scan(tree, sample, channel, record, KEYFRAME)
            while record["prev"]:
                record = tree.get("sample_data", record["prev"])
                if record["is_key_frame"] or record["sample_token"] != sample["token"]:
                    break
                periods = round(1e-6 * (keyframe["timestamp"] - record["timestamp"]) / PERIOD)
                yield _scan(tree, sample, channel, record, f"{1000 * PERIOD * periods:.0f} ms before")
    RadarPointCloud.default_filters()


def by_case(scans: list[Scan]) -> Iterator[tuple[str, str, list[Scan]]]:
    """Radar, age and scans: of each radar, and of all together, the scans of all ages, then those of each, the youngest
    first."""
    groups: dict[tuple[str, str], list[Scan]] = {}
    for scan in scans:
        for channel in (scan.channel, ALL_RADARS):
            for age in (ALL_AGES, scan.age):
                groups.setdefault((channel, age), []).append(scan)
    for (channel, age), mine in groups.items():
        yield channel, age, mine


def _scan(tree: NuScenes, sample: dict, channel: str, record: dict, age: str) -> Scan:
    cloud = RadarPointCloud.from_file(os.path.join(tree.dataroot, record["filename"])).points.astype(float)
    x, y, _, _, _, rcs, vx, vy, vx_comp, vy_comp, _, ambig_state = cloud[:12, cloud[14] != MIRROR]
    distance = np.maximum(np.hypot(x, y), 1e-6)
    along = np.stack([x, y]) / distance
    objects = list(_objects(tree, sample, record))
    return Scan(
        channel, age, record, distance, np.arctan2(y, x), np.sum(along * (vx, vy), axis=0),
        np.sum(along * (vx_comp, vy_comp), axis=0), rcs, ambig_state == UNAMBIGUOUS, objects,
    )  # fmt: skip


def _objects(tree: NuScenes, sample: dict, record: dict) -> Iterator[Seen]:
    """What is labelled, where it was at the time of the record, and lies before the sensor."""
    sensor_T_global = np.linalg.inv(global_T_sensor(tree, record))
    for row, box, velocity in _boxes_then(tree, sample, record):
        corners = (sensor_T_global @ np.vstack([box.corners(), np.ones(8)]))[:3]
        if corners[0].min() < 0.5:
            continue
        reach, nearest = np.linalg.norm(corners, axis=0), _nearest(corners)
        if row["num_lidar_pts"] < SEEN or nearest > FAR:
            continue
        bearing = np.arcsin(corners[1] / reach)
        seen = sensor_T_global[:2, :2] @ velocity
        yield Seen(
            row["instance_token"], row["category_name"], (bearing.min(), bearing.max()),
            (nearest, reach.max()), seen, row["num_lidar_pts"],
        )  # fmt: skip


def _nearest(corners: np.ndarray) -> float:
    """Distance of the nearest point of a box with corners (3, 8) on the ground; the sensor is outside."""
    low = corners[:2, [2, 3, 7, 6]]  # the devkit's corners of the bottom, in turn
    ends = np.roll(low, -1, axis=1) - low
    share = np.clip(-np.sum(low * ends, axis=0) / np.sum(ends**2, axis=0), 0, 1)
    return float(np.linalg.norm(low + share * ends, axis=0).min())


def _boxes_then(tree: NuScenes, sample: dict, record: dict) -> Iterator[tuple[dict, Box, np.ndarray]]:
    """Annotations with their box and their velocity (2,) at the time of the record: as the devkit interpolates between
    keyframes; where there is none before, moved by their velocity."""
    late = 1e-6 * (record["timestamp"] - sample["timestamp"])
    rows = [tree.get("sample_annotation", token) for token in sample["anns"]]
    if record["is_key_frame"] or not sample["prev"]:
        for row in rows if abs(late) < NEAR_KEYFRAME else ():
            box, velocity = tree.get_box(row["token"]), velocity_of(tree, row)
            box.translate(np.append(velocity * late, 0.0))
            yield row, box, velocity
        return
    before = tree.get("sample", sample["prev"])
    share = 1e6 * late / (sample["timestamp"] - before["timestamp"])  # from 0, now, to -1
    for row, box in zip(rows, tree.get_boxes(record["token"]), strict=True):
        if row["prev"] and tree.get("sample_annotation", row["prev"])["sample_token"] == before["token"]:
            earlier = velocity_of(tree, tree.get("sample_annotation", row["prev"]))
            now = velocity_of(tree, row)
            yield row, box, now + (now - earlier) * share
