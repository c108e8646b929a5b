"""Faults of radar data, each beside the check that has to catch it."""

import math
from collections.abc import Callable

import numpy as np
from faulty_copy import FaultyCopy, channel_of
from pyquaternion import Quaternion

LATE = 50_000
"""Microseconds."""
MOUNTS = "radar mounts: on the side that the channel's name says"
FILES = "radar files: named after their channel and time"
STAMPS = "radar ego poses: of the scan's own time"
PATH = "radar ego poses: off the path"
HEADING = "radar ego poses: off the heading"
COMPENSATION = "radar vx_comp: off vx and the car's own speed, 90 % below"
TRAVEL = "radar vx: direction of the car's travel, from what stands still"
SPEED = "radar vx: speed of the car, from what stands still, of that of its path"
FIELD = "radar field of view: left edge against right"
BEARING = "radar: bearing of returns, off the boxes"
RANGE = "radar: range of returns, off the near side of boxes"
AT_REST = "radar vx_comp: of boxes at rest, off zero, median"
MOVING = "radar vx_comp: of moving boxes, off their velocity along the ray, median"
POSSIBLE = "radar RCS: what a radar can write"
CARS = "radar RCS: of cars, off 8 dBsm"
STANDOUT = "radar RCS: vehicles over the median of their scan"
ORDERED = "firings of a sensor: prev and next mirror each other and time grows"


def turned(degrees: float, channel: str = ""):
    """Mounts turned to the left: one or all."""

    def damage(copy: FaultyCopy) -> None:
        mounts = copy.mounts()
        for name, row in mounts.items():
            if channel in ("", name):
                turn = Quaternion(axis=[0, 0, 1], degrees=degrees)
                row["rotation"] = (turn * Quaternion(row["rotation"])).elements.tolist()
        copy.write_mounts(mounts)

    return damage


def moved(metres: float, channel: str):
    """A mount moved along its boresight."""

    def damage(copy: FaultyCopy) -> None:
        mounts = copy.mounts()
        row = mounts[channel]
        ahead = Quaternion(row["rotation"]).rotation_matrix[:, 0]
        row["translation"] = (row["translation"] + metres * ahead).tolist()
        copy.write_mounts(mounts)

    return damage


def exchanged_mounts(copy: FaultyCopy) -> None:
    """Left radars get the mounts of the right ones."""
    mounts = copy.mounts()
    for name in [name for name in mounts if name.endswith("LEFT")]:
        left, right = mounts[name], mounts[name.replace("LEFT", "RIGHT")]
        for key in ("translation", "rotation"):
            left[key], right[key] = right[key], left[key]
    copy.write_mounts(mounts)


def returns(change: Callable[[np.ndarray, dict], np.ndarray | None], **which):
    """Every scan changed: of one channel, or the sweeps only."""
    return lambda copy: copy.change_returns(change, **which)


def negated(*names: str):
    """Columns with the other sign."""

    def change(scan: np.ndarray, _: dict) -> None:
        for name in names:
            scan[name] *= -1

    return change


def scaled_range(factor: float):
    """Places farther out along the ray."""

    def change(scan: np.ndarray, _: dict) -> None:
        scan["x"] *= factor
        scan["y"] *= factor

    return change


def uncompensated(scan: np.ndarray, _: dict) -> None:
    """The car's own motion left in."""
    scan["vx_comp"], scan["vy_comp"] = scan["vx"], scan["vy"]


def all_at_rest(scan: np.ndarray, _: dict) -> None:
    """Nothing moves over ground, and what is measured fits that."""
    along = (scan["vx_comp"] * scan["x"] + scan["vy_comp"] * scan["y"]) / np.hypot(scan["x"], scan["y"])
    for name, part in (("vx", "x"), ("vy", "y")):
        scan[name] -= along * scan[part] / np.hypot(scan["x"], scan["y"])
        scan[f"{name}_comp"] = 0


def rear_axle_only(copy: FaultyCopy) -> None:
    """Compensated by the speed of the rear axle along the car: the lever arm forgotten."""
    mounts, poses = copy.mounts(), {row["token"]: row for row in copy.rows("ego_pose")}
    for record in copy.records():
        channel = channel_of(record)
        pose = poses[record["ego_pose_token"]]
        near = min(
            (p for p in poses.values() if abs(p["timestamp"] - pose["timestamp"]) > 2000),
            key=lambda p: abs(p["timestamp"] - pose["timestamp"]),
        )
        seconds = 1e-6 * (near["timestamp"] - pose["timestamp"])
        velocity = np.subtract(near["translation"], pose["translation"]) / seconds
        own = (Quaternion(pose["rotation"]) * Quaternion(mounts[channel]["rotation"])).rotation_matrix.T @ velocity
        path = copy.root / record["filename"]
        scan = copy.returns(path)
        distance = np.hypot(scan["x"], scan["y"])
        along = (own[0] * scan["x"] + own[1] * scan["y"]) / distance
        scan["vx_comp"] = scan["vx"] + along * scan["x"] / distance
        scan["vy_comp"] = scan["vy"] + along * scan["y"] / distance
        copy.write_returns(path, scan)


def left_half_blind(scan: np.ndarray, _: dict) -> np.ndarray:
    """Nothing more than ten degrees to the left."""
    return scan[np.arctan2(scan["y"], scan["x"]) < math.radians(10)]


def permuted_rcs(scan: np.ndarray, record: dict) -> None:
    """RCS given to other returns of the scan."""
    scan["rcs"] = np.random.default_rng(record["timestamp"]).permutation(scan["rcs"])


def louder(decibel: float):
    """RCS too high."""

    def change(scan: np.ndarray, _: dict) -> None:
        scan["rcs"] += decibel

    return change


def linear_rcs(scan: np.ndarray, _: dict) -> None:
    """RCS in square metres."""
    scan["rcs"] = 10 ** (scan["rcs"] / 10)


def poses_of_the_keyframe(copy: FaultyCopy) -> None:
    """Sweeps that carry their keyframe's place under their own time."""
    records, poses = copy.records(), {row["token"]: row for row in copy.rows("ego_pose")}
    keyframes = {(channel_of(r), r["sample_token"]): r for r in records if r["is_key_frame"]}
    for record in records:
        of = poses[keyframes[channel_of(record), record["sample_token"]]["ego_pose_token"]]
        poses[record["ego_pose_token"]].update(translation=of["translation"], rotation=of["rotation"])
    copy.write_rows("ego_pose", list(poses.values()))


def turned_headings(copy: FaultyCopy) -> None:
    """Headings of the sweeps off by a degree."""
    tokens = {record["ego_pose_token"] for record in copy.records(sweeps_only=True)}
    rows = copy.rows("ego_pose")
    for row in rows:
        if row["token"] in tokens:
            turn = Quaternion(axis=[0, 0, 1], degrees=1)
            row["rotation"] = (turn * Quaternion(row["rotation"])).elements.tolist()
    copy.write_rows("ego_pose", rows)


def late_stamps(*, poses_too: bool):
    """Sweeps that say to be 50 ms younger than they are."""

    def damage(copy: FaultyCopy) -> None:
        records = copy.records(sweeps_only=True)
        tokens = {record["ego_pose_token"] for record in records} if poses_too else set()
        for record in records:
            record["timestamp"] += LATE - 1
        copy.write_records(records)
        rows = copy.rows("ego_pose")
        for row in rows:
            if row["token"] in tokens:
                row["timestamp"] += LATE - 1
        copy.write_rows("ego_pose", rows)

    return damage


def exchanged(*, names: bool):
    """The files of two radars exchanged: their contents, or their names in the table."""

    def damage(copy: FaultyCopy) -> None:
        pairs = zip(copy.records(channel="RADAR_FRONT_LEFT"), copy.records(channel="RADAR_FRONT_RIGHT"), strict=False)
        for left, right in list(pairs):
            if names:
                left["filename"], right["filename"] = right["filename"], left["filename"]
                copy.write_records([left, right])
            else:
                paths = [copy.root / record["filename"] for record in (left, right)]
                scans = [copy.returns(path) for path in paths]
                for path, scan in zip(paths, reversed(scans), strict=True):
                    copy.write_returns(path, scan)

    return damage


def stale(copy: FaultyCopy) -> None:
    """Each firing repeats what its radar saw the last time, 50 ms before."""
    records = copy.records()
    scans = [copy.returns(copy.root / record["filename"]) for record in records]
    for before, record, scan in zip(records, records[1:], scans, strict=False):
        if before["next"] == record["token"] and record["timestamp"] - before["timestamp"] < 2 * LATE:
            copy.write_returns(copy.root / record["filename"], scan)


def backwards(copy: FaultyCopy) -> None:
    """The links of sweeps lead the wrong way."""
    records = copy.records()
    for record in records:
        record["prev"], record["next"] = record["next"], record["prev"]
    copy.write_records(records)


SIDE, FRONT = "RADAR_FRONT_LEFT", "RADAR_FRONT"
FAULTS: dict[str, tuple[Callable[[FaultyCopy], None], str]] = {
    "mount of RADAR_FRONT turned by 20 degrees": (turned(20, FRONT), BEARING),
    "mount of RADAR_FRONT turned by 2 degrees": (turned(2, FRONT), BEARING),
    "mount of RADAR_FRONT turned by 1 degree": (turned(1, FRONT), TRAVEL),
    "all mounts turned by 5 degrees": (turned(5), BEARING),
    "all mounts turned by 0.7 degrees": (turned(0.7), TRAVEL),
    "mounts of left and right exchanged": (exchanged_mounts, MOUNTS),
    "mount of RADAR_FRONT 0.7 m too far along its boresight": (moved(0.7, FRONT), RANGE),
    "mount of RADAR_FRONT_LEFT 0.7 m too far along its boresight": (moved(0.7, SIDE), RANGE),
    "vx_comp, vy_comp negated": (returns(negated("vx_comp", "vy_comp")), MOVING),
    "vx, vy negated": (returns(negated("vx", "vy")), SPEED),
    "vx_comp, vy_comp not compensated": (returns(uncompensated), AT_REST),
    "compensated without the lever arm": (rear_axle_only, COMPENSATION),
    "every return at rest over ground": (returns(all_at_rest), MOVING),
    "azimuth mirrored": (returns(negated("y", "vy", "vy_comp")), BEARING),
    "range 3 % too long": (returns(scaled_range(1.03)), RANGE),
    "range 3 % too long, RADAR_FRONT's sweeps only": (
        returns(scaled_range(1.03), channel=FRONT, sweeps_only=True),
        RANGE,
    ),
    "blind to the left": (returns(left_half_blind), FIELD),
    "RCS 10 dB too high": (returns(louder(10)), CARS),
    "RCS permuted within scans": (returns(permuted_rcs), STANDOUT),
    "RCS in square metres": (returns(linear_rcs), POSSIBLE),
    "RCS negated": (returns(negated("rcs")), STANDOUT),
    "sweeps with the pose of their keyframe": (poses_of_the_keyframe, PATH),
    "sweeps with a heading 1 degree off": (turned_headings, HEADING),
    "sweeps stamped 50 ms late": (late_stamps(poses_too=False), STAMPS),
    "sweeps and their poses stamped 50 ms late": (late_stamps(poses_too=True), PATH),
    "scans of left and right exchanged": (exchanged(names=False), BEARING),
    "file names of left and right exchanged": (exchanged(names=True), FILES),
    "each scan that of 50 ms before": (stale, COMPENSATION),
    "sweeps in the wrong order": (backwards, ORDERED),
}
"""By name, what damages a copy and the check that was made to find it."""
