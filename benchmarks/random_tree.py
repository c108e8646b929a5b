"""A nuScenes tree of tables alone, and a result file for it, with everything in them that the metric treats specially.

No sensor file is written: scoring reads none. Runs with numpy 1 and 2, so that the devkit's environment can use it too.
"""

import json
from pathlib import Path

import numpy as np

CATEGORIES = {
    "car": "vehicle.car", "truck": "vehicle.truck", "bus": "vehicle.bus.rigid", "trailer": "vehicle.trailer",
    "construction_vehicle": "vehicle.construction", "pedestrian": "human.pedestrian.adult",
    "motorcycle": "vehicle.motorcycle", "bicycle": "vehicle.bicycle", "traffic_cone": "movable_object.trafficcone",
    "barrier": "movable_object.barrier",
}  # fmt: skip
ATTRIBUTES = (
    "vehicle.moving", "vehicle.parked", "vehicle.stopped", "cycle.with_rider", "cycle.without_rider", "pedestrian.moving",
    "pedestrian.standing",
)  # fmt: skip
RACK = "static_object.bicycle_rack"
SPLIT = "random_val"


def make_tables(rng, *, scenes: int, keyframes: int, objects: int, absent: str = "") -> dict[str, list[dict]]:
    """The 13 tables. Objects drive straight on at constant speed; every fifth is seen once (so it has no velocity), some
    have no points, no attribute or are out of range; ``absent`` names a class without labels. Half of the bicycles and
    motorcycles stand in or just outside a bicycle rack."""
    names = ("log", "map", "scene", "sample", "sample_data", "ego_pose", "instance", "sample_annotation")
    tables: dict[str, list[dict]] = {name: [] for name in names}
    tables["category"] = [
        {"token": name, "name": name, "description": ""} for name in (*CATEGORIES.values(), "animal", RACK)
    ]
    tables["attribute"] = [{"token": name, "name": name, "description": ""} for name in ATTRIBUTES]
    tables["visibility"] = [{"token": str(level), "level": f"v{level}", "description": ""} for level in (1, 2, 3, 4)]
    tables["sensor"] = [{"token": "lidar", "channel": "LIDAR_TOP", "modality": "lidar"}]
    tables["calibrated_sensor"] = [
        {"token": "mount", "sensor_token": "lidar", "translation": [0.9, 0.0, 1.8], "rotation": [1.0, 0.0, 0.0, 0.0],
         "camera_intrinsic": []}
    ]  # fmt: skip
    tables["map"] = [
        {"token": "map", "log_tokens": ["log"], "category": "semantic_prior", "filename": "maps/empty.png"},
    ]
    tables["log"] = [
        {"token": "log", "logfile": "log", "vehicle": "", "date_captured": "2026-01-01", "location": "none"}
    ]
    for scene in range(scenes):
        _add_scene(tables, rng, f"scene-{scene:04d}", keyframes, objects, absent)
    return tables


def write_tree(root: Path, tables: dict[str, list[dict]]) -> None:
    """Writes the tables as version ``v1.0-random`` with all scenes in one split."""
    folder = root / "v1.0-random"
    folder.mkdir(parents=True, exist_ok=True)
    for name, rows in tables.items():
        (folder / f"{name}.json").write_text(json.dumps(rows), encoding="utf-8")
    (folder / "splits.json").write_text(
        json.dumps({SPLIT: [scene["name"] for scene in tables["scene"]]}), encoding="utf-8"
    )
    (root / "maps").mkdir(exist_ok=True)
    (root / "maps" / "empty.png").touch()


def make_results(tables: dict[str, list[dict]], rng, *, boxes: int, unpredicted: str = "", empty: int = 0) -> dict:
    """A result file: labels found with errors, each perhaps twice, and false alarms up to ``boxes`` a sample. Scores are
    coarse, so that many tie; some velocities are NaN. ``unpredicted`` names a class never predicted; the first ``empty``
    samples have no box."""
    class_of = {category: name for name, category in CATEGORIES.items()}
    category_of = {row["token"]: row["category_token"] for row in tables["instance"]}
    ego_of = {row["token"]: row["translation"] for row in tables["ego_pose"]}
    labels: dict[str, list[tuple[str, dict]]] = {row["token"]: [] for row in tables["sample"]}
    for row in tables["sample_annotation"]:
        name = class_of.get(category_of[row["instance_token"]])
        if name:
            labels[row["sample_token"]].append((name, row))
    known = [name for name in CATEGORIES if name != unpredicted]
    results: dict[str, list[dict]] = {}
    for index, (token, objects) in enumerate(labels.items()):
        found = []
        for name, row in objects * 2:
            if name == unpredicted or rng.random() < 0.35:
                continue
            spread = rng.choice([0.1, 0.4, 1.5])
            center = np.array(row["translation"]) + rng.normal(0, spread, 3)
            found.append(_box(rng, token, name, center, np.array(row["size"]) * rng.uniform(0.8, 1.25, 3)))
        for _ in range(max(0, boxes - len(found))):
            center = np.array([*(np.array(ego_of[token][:2]) + rng.uniform(-60, 60, 2)), 1.0])
            found.append(_box(rng, token, rng.choice(known), center, rng.uniform(0.5, 5, 3)))
        results[token] = [] if index < empty else [found[i] for i in rng.permutation(len(found))][:500]
    meta = {f"use_{name}": False for name in ("camera", "lidar", "radar", "map", "external")}
    return {"meta": meta, "results": results}


def _add_scene(tables, rng, name: str, keyframes: int, objects: int, absent: str) -> None:
    samples = [f"{name}-sample-{k}" for k in range(keyframes)]
    start = 1_700_000_000_000_000 + 100_000_000 * len(tables["scene"])
    first, last = samples[0], samples[-1]
    tables["scene"].append(
        {"token": name, "name": name, "description": "", "log_token": "log", "nbr_samples": keyframes,
         "first_sample_token": first, "last_sample_token": last}
    )  # fmt: skip
    for k, sample in enumerate(samples):
        time = start + 500_000 * k
        before, after = samples[k - 1] if k else "", samples[k + 1] if k + 1 < keyframes else ""
        tables["sample"].append(
            {"token": sample, "timestamp": time, "scene_token": name, "prev": before, "next": after}
        )
        yaw = rng.uniform(-3, 3)
        pose = {
            "token": sample,
            "timestamp": time,
            "translation": [100.0 + 4 * k, 80.0, 0.0],
            "rotation": _quaternion(yaw),
        }
        tables["ego_pose"].append(pose)
        tables["sample_data"].append(
            {"token": sample, "sample_token": sample, "ego_pose_token": sample, "calibrated_sensor_token": "mount",
             "filename": f"samples/LIDAR_TOP/{sample}.pcd.bin", "fileformat": "pcd", "width": 0, "height": 0,
             "timestamp": time, "is_key_frame": True, "prev": before, "next": after}
        )  # fmt: skip
    for index in range(objects):
        _add_object(tables, rng, f"{name}-object-{index}", samples, index, absent)


def _add_object(tables, rng, token: str, samples: list[str], index: int, absent: str) -> None:
    names = [name for name in CATEGORIES if name != absent]
    name = names[index % len(names)]
    category = "animal" if index % 23 == 22 else CATEGORIES[name]
    seen = samples[:1] if index % 5 == 4 else samples
    position, velocity = np.array([100.0, 80.0]) + rng.uniform(-45, 45, 2), rng.uniform(-8, 8, 2)
    kind = {"pedestrian": "pedestrian", "motorcycle": "cycle", "bicycle": "cycle"}.get(name, "vehicle")
    if kind == "cycle" and rng.random() < 0.5:
        velocity = np.zeros(2)
        _add_rack(tables, rng, f"{token}-rack", samples, [*position, 1.0])
    choices = [a for a in ATTRIBUTES if a.startswith(kind)] if name not in ("traffic_cone", "barrier") else []
    attribute = [str(rng.choice(choices))] if choices and index % 7 else []
    centers = [[*(position + velocity * 0.5 * k).tolist(), 1.0] for k in range(len(seen))]
    size, rotation = rng.uniform(0.5, 5, 3).tolist(), _quaternion(rng.uniform(-np.pi, np.pi))
    _add_track(tables, rng, token, category, attribute, seen, centers, size, rotation)


def _add_rack(tables, rng, token: str, samples: list[str], cycle: list[float]) -> None:
    """A rack about a cycle's centre, turned and on a slope; a cycle off its middle may be out on any side, above or
    below."""
    size, tilt = rng.uniform(1, 4, 3), rng.uniform(-0.2, 0.2, 2)
    rotation = rng.normal(0, 1, 4) * [1, 0, 0, 1] + [0, *tilt, 0]
    rotation /= np.linalg.norm(rotation)
    center = (np.array(cycle) + rng.uniform(-0.6, 0.6, 3) * size).tolist()
    _add_track(tables, rng, token, RACK, [], samples, [center] * len(samples), size.tolist(), rotation.tolist())


def _add_track(tables, rng, token: str, category: str, attribute, seen: list[str], centers, size, rotation) -> None:
    """An instance and its annotations, one in each of the samples ``seen``."""
    tokens = [f"{token}-{k}" for k in range(len(seen))]
    for k, sample in enumerate(seen):
        tables["sample_annotation"].append(
            {"token": tokens[k], "sample_token": sample, "instance_token": token, "visibility_token": "4",
             "attribute_tokens": attribute, "translation": centers[k], "size": size, "rotation": rotation,
             "num_lidar_pts": int(rng.integers(0, 3)), "num_radar_pts": int(rng.integers(0, 2)),
             "prev": tokens[k - 1] if k else "", "next": tokens[k + 1] if k + 1 < len(seen) else ""}
        )  # fmt: skip
    tables["instance"].append(
        {"token": token, "category_token": category, "nbr_annotations": len(seen), "first_annotation_token": tokens[0],
         "last_annotation_token": tokens[-1]}
    )  # fmt: skip


def _box(rng, token: str, name: str, center, size) -> dict:
    velocity = [float("nan")] * 2 if rng.random() < 0.1 else rng.normal(0, 4, 2).tolist()
    return {
        "sample_token": token,
        "translation": center.tolist(),
        "size": size.tolist(),
        "rotation": _quaternion(rng.uniform(-np.pi, np.pi)),
        "velocity": velocity,
        "detection_name": str(name),
        "detection_score": float(rng.integers(0, 40)) / 40,
        "attribute_name": str(rng.choice(ATTRIBUTES)),
    }


def _quaternion(yaw: float) -> list[float]:
    return [float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))]
