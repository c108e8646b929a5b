"""The map mask: what drives is on the road."""

from collections.abc import Iterator

import numpy as np
from findings import Finding, share
from nuscenes import NuScenes
from project import nuscenes_format

MOVING = 1.0
"""m/s from which a vehicle drives."""


def check_map(tree: NuScenes) -> Iterator[Finding]:
    """Ego poses and centres of driving motor vehicles on the devkit's mask; and how much road there is at all."""
    ego, cars = [0, 0], [0, 0]
    for scene in tree.scene:
        mask = tree.get("map", tree.get("log", scene["log_token"])["map_token"])["mask"]
        samples = [tree.get("sample", token) for token in tree.field2token("sample", "scene_token", scene["token"])]
        poses = [tree.get("ego_pose", sample["data"][nuscenes_format.REFERENCE])["translation"] for sample in samples]
        rows = [tree.get("sample_annotation", token) for sample in samples for token in sample["anns"]]
        driving = [row["translation"] for row in rows if _drives(tree, row)]
        for count, places in ((ego, poses), (cars, driving)):
            xy = np.array(places, float).reshape(-1, 3)
            count[0] += int(mask.is_on_mask(xy[:, 0], xy[:, 1]).sum())
            count[1] += len(xy)
    yield share("ego poses on drivable pixels", *ego, limit=0.97)
    yield share("driving vehicles' centres on drivable pixels", *cars, limit=0.90)
    road = [float((record["mask"].mask() > 0).mean()) for record in tree.map]
    yield Finding("share of the maps that is road (what chance would give)", float(np.mean(road)), "<=", 0.5, len(road))


def _drives(tree: NuScenes, row: dict) -> bool:
    velocity = row.get(nuscenes_format.EXACT_VELOCITY) or tree.box_velocity(row["token"])[:2]
    cycle = row["category_name"] == "vehicle.bicycle"  # these may ride on the pavement
    return row["category_name"].startswith("vehicle.") and not cycle and float(np.hypot(*velocity)) > MOVING
