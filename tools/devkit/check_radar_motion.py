"""What a radar says of the car's own motion, against the path of the ego poses; and whether its records belong together."""

import math
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from ego_motion_fit import ego_motion_fit
from ego_path import EgoPath
from findings import Finding, none_of
from nuscenes import NuScenes
from project import nuscenes_format
from pyquaternion import Quaternion
from radar_scans import ALL_AGES, ALL_RADARS, Scan, by_case

DRIVES = 3.0
"""m/s of the sensor from which its direction of travel tells something."""
OFF_PATH, OFF_HEADING = 0.03, 0.4
"""Metres and degrees from the path of the other sensors' poses: braking and steering within half a second."""
OFF_OWN = (0.05, 1.0)
"""m/s, and m/s by the root of the number of returns: where the steering changes, the slope of the path is off by up to 0.3 m/s,
which a case of few scans has many of."""
OFF_TRAVEL = (0.2, 0.01)
"""Degrees, and share of the speed, by which the car's travel may differ from the path's, with four standard errors more."""
AHEAD = 10.0
"""Degrees that RADAR_FRONT may look aside."""
LOPSIDED = 8.0
"""Degrees between the edges of the field of view to the left and to the right: noise at the edge, and a wall on one side."""


def check_mounts(tree: NuScenes) -> Iterator[Finding]:
    """Each radar sits, and looks, where its channel's name says."""
    wrong, count = [], 0
    for mount in tree.calibrated_sensor:
        channel = tree.get("sensor", mount["sensor_token"])["channel"]
        if channel.startswith("RADAR"):
            count += 1
            parts, place = channel.split("_")[1:], mount["translation"]
            ahead, left, _ = Quaternion(mount["rotation"]).rotation_matrix[:, 0]
            sides = {"BACK": -ahead, "LEFT": min(left, place[1]), "RIGHT": -max(left, place[1])}
            if parts == ["FRONT"]:
                sides["FRONT"] = ahead - math.cos(math.radians(AHEAD))
            if min(sides.get(part, 1.0) for part in parts) < 0:
                wrong.append(channel)
    yield none_of("radar mounts: on the side that the channel's name says", sorted(set(wrong)), count)


def check_radar_motion(tree: NuScenes, scans: list[Scan]) -> Iterator[Finding]:
    """Records, poses, own velocity and field of view of ``scans``, by radar and age."""
    suffix = nuscenes_format.FILE_SUFFIX["radar"]
    wrong = [
        f"{scan.channel}, {scan.age}: {scan.record['filename']}" for scan in scans
        if scan.record["channel"] not in scan.record["filename"].split("/")
        or not scan.record["filename"].endswith(f"__{scan.channel}__{scan.record['timestamp']}{suffix}")
    ]  # fmt: skip
    yield none_of("radar files: named after their channel and time", wrong, len(scans))
    wrong = [
        f"{scan.channel}, {scan.age}" for scan in scans
        if scan.record["timestamp"] != tree.get("ego_pose", scan.record["ego_pose_token"])["timestamp"]
    ]  # fmt: skip
    yield none_of("radar ego poses: of the scan's own time", wrong, len(scans))
    known, every = _paths(tree)
    for channel, age, mine in by_case(scans):
        if channel == ALL_RADARS:
            continue
        yield from _on_path(tree, known, channel, age, mine)
        yield from _own_velocity(tree, every, channel, age, mine)
        if age == ALL_AGES:
            bearing = np.degrees(np.concatenate([scan.bearing for scan in mine]))
            edges = np.percentile(bearing, [1, 99]) if len(bearing) else np.zeros(2)
            what = "radar field of view: left edge against right"
            yield Finding(what, abs(edges.sum()), "<=", LOPSIDED, len(bearing), "deg", f"{channel}, {age}", 300)


def _paths(tree: NuScenes) -> tuple[dict[str, EgoPath], dict[str, EgoPath]]:
    """By scene: the path without the radars' sweeps, which are to be checked, and the path of all records."""
    known, every = defaultdict(list), defaultdict(list)
    for record in tree.sample_data:
        scene = tree.get("sample", record["sample_token"])["scene_token"]
        every[scene].append(record)
        if record["is_key_frame"] or record["sensor_modality"] != "radar":
            known[scene].append(record)
    return tuple({scene: EgoPath(tree, records) for scene, records in each.items()} for each in (known, every))


def _scene_of(tree: NuScenes, scan: Scan) -> str:
    return tree.get("sample", scan.record["sample_token"])["scene_token"]


def _on_path(tree: NuScenes, paths: dict, channel: str, age: str, scans: list[Scan]) -> Iterator[Finding]:
    """The farthest that a scan's own pose lies off the path of the others, in place and heading."""
    off, turned = [], []
    for scan in scans:
        expected = paths[_scene_of(tree, scan)].pose_without(scan.record)
        if expected:
            pose = tree.get("ego_pose", scan.record["ego_pose_token"])
            off.append(math.dist(pose["translation"], expected[0]))
            yaw = Quaternion(pose["rotation"]).yaw_pitch_roll[0]
            turned.append(abs(math.degrees(math.remainder(yaw - expected[1], math.tau))))
    case = f"{channel}, {age}"
    yield Finding("radar ego poses: off the path", max(off, default=0), "<=", OFF_PATH, len(off), "m", case)
    yield Finding("radar ego poses: off the heading", max(turned, default=0), "<=", OFF_HEADING, len(off), "deg", case)


def _own_velocity(tree: NuScenes, paths: dict, channel: str, age: str, scans: list[Scan]) -> Iterator[Finding]:
    """Compensated less measured velocity is the sensor's own along the ray, which the ego path knows; and most returns stand
    still, so that the measured one alone tells where the sensor travels (Kellner et al., 2013)."""
    errors, ahead, across, doppler = ([np.zeros(0)] for _ in range(4))
    for scan in scans:
        mount = tree.get("calibrated_sensor", scan.record["calibrated_sensor_token"])
        own = paths[_scene_of(tree, scan)].velocity(scan.record, np.array(mount["translation"]))
        if own is None:
            continue
        own = Quaternion(mount["rotation"]).rotation_matrix[:2, :2].T @ own
        ray = np.stack([np.cos(scan.bearing), np.sin(scan.bearing)])
        errors.append(np.abs(scan.ground_speed - scan.speed - own @ ray)[scan.unfolded])
        if np.hypot(*own) > DRIVES:
            ray = ray[:, scan.unfolded]
            ahead.append(own @ ray)
            across.append(np.array([-own[1], own[0]]) @ ray)
            doppler.append(-scan.speed[scan.unfolded])
    case, off = f"{channel}, {age}", np.concatenate(errors)
    what = "radar vx_comp: off vx and the car's own speed, 90 % below"
    limit = OFF_OWN[0] + OFF_OWN[1] / math.sqrt(max(len(off), 1))
    yield Finding(what, float(np.percentile(off, 90)) if len(off) else 0.0, "<=", limit, len(off), "m/s", case, 50)
    rows = np.stack([np.concatenate(ahead), np.concatenate(across)], axis=1)
    along, aside, sigma = ego_motion_fit(rows, np.concatenate(doppler))
    turned = abs(math.degrees(math.atan2(aside, along)))
    what, limit = "radar vx: direction of the car's travel, from what stands still", OFF_TRAVEL[0] + 4 * sigma
    yield Finding(what, turned, "<=", limit, len(rows), "deg", case, 100)
    what = "radar vx: speed of the car, from what stands still, of that of its path"
    limit = OFF_TRAVEL[1] + 4 * math.radians(sigma)
    yield Finding(what, abs(along - 1) if len(rows) else 0.0, "<=", limit, len(rows), "", case, 100)
