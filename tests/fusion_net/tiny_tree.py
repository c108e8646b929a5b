"""A nuScenes tree of a few keyframes written by the tests: a car on a banked curve past landmarks that its sensors see exactly.

Nothing is level, square or symmetric, and no two sensors fire at the same time.
"""

import json
from pathlib import Path

import cv2
import numpy as np

from fusion_net.data.sensor_files import RADAR_FIELDS
from fusion_net.geometry import from_rpy, from_yaw, invert, rigid, to_quaternion, transform

START = 1_700_000_000_000_000
PERIOD = 0.5
HEIGHT, WIDTH = 48, 80
CAM_K = np.array([[60.0, 0.0, 38.0], [0.0, 60.0, 22.0], [0.0, 0.0, 1.0]])
OPTICAL = rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.zeros(3))
MOUNTS = {
    "CAM_FRONT": from_rpy(0.01, 0.03, -0.02, (1.7, 0.1, 1.5)) @ OPTICAL,
    "CAM_BACK": from_rpy(-0.02, 0.02, 3.1, (0.1, -0.1, 1.5)) @ OPTICAL,
    "LIDAR_TOP": from_rpy(-0.02, 0.01, 0.01, (0.9, 0.0, 1.8)) @ from_yaw(-np.pi / 2),
    "RADAR_FRONT": from_rpy(0.0, 0.0, 0.03, (3.4, 0.0, 0.5)),
    "RADAR_FRONT_LEFT": from_rpy(0.0, 0.01, 0.6, (2.4, 0.8, 0.7)),
}
MODALITY = {c: {"C": "camera", "L": "lidar", "R": "radar"}[c[0]] for c in MOUNTS}
AGE = {"CAM_FRONT": 0.02, "CAM_BACK": 0.03, "LIDAR_TOP": 0.0, "RADAR_FRONT": 0.01, "RADAR_FRONT_LEFT": 0.04}
"""Seconds from a sensor's keyframe firing to the keyframe's time."""
SWEEP_PERIOD = 0.05
FLOATS = ("x", "y", "z", "rcs", "vx", "vy", "vx_comp", "vy_comp")
RADAR_DTYPE = np.dtype([(n, "<f4" if n in FLOATS else "<i2" if n == "id" else "i1") for n in RADAR_FIELDS])
LANDMARKS = np.random.default_rng(3).uniform((20, -10, 0), (80, 45, 4), (60, 3))
"""Static global points (60, 3)."""
MOVER_START, MOVER_VELOCITY = np.array([45.0, 8.0, 1.0]), np.array([16.0, -12.0, 0.0])
"""A point at 20 m/s that the radars see last."""


def ego_pose(t: float) -> np.ndarray:
    """``global_T_ego`` (4, 4) of a car that drives at 12 m/s, turns at 0.5 rad/s and leans."""
    yaw = 0.3 + 0.5 * t
    x, y = 10 + 24 * (np.sin(yaw) - np.sin(0.3)), 5 - 24 * (np.cos(yaw) - np.cos(0.3))
    return from_rpy(0.03, 0.02, yaw, (x, y, 0.4))


def write_tree(
    root: Path, *, scenes: int = 2, keyframes: int = 3, sweeps: int = 2, boxes: list[dict] | None = None
) -> Path:
    """Writes the tree, ``sweeps`` firings of LiDAR and radar before each keyframe. ``boxes``: of every scene, dicts with
    category, center(t), and optionally frames, size, yaw(t), points, attribute. Splits tiny_train (all but the last scene) and
    tiny_val."""
    rows: dict[str, list[dict]] = {name: [] for name in ("ego_pose", "scene", "sample", "sample_data")}
    rows |= {"instance": [], "sample_annotation": [], "category": [], "attribute": []}
    rows["sensor"] = [{"token": c, "channel": c, "modality": MODALITY[c]} for c in MOUNTS]
    rows["calibrated_sensor"] = [
        {"token": f"calib-{c}", "sensor_token": c, "translation": m[:3, 3].tolist(), "rotation": to_quaternion(m).tolist(),
         "camera_intrinsic": CAM_K.tolist() if MODALITY[c] == "camera" else []}
        for c, m in MOUNTS.items()
    ]  # fmt: skip
    for s in range(scenes):
        _write_scene(root, rows, f"scene-{s:04d}", START + s * 100_000_000, keyframes, sweeps, boxes or [])
    names = [f"scene-{s:04d}" for s in range(scenes)]
    folder = root / "v1.0-tiny"
    folder.mkdir(parents=True)
    for name, table in (rows | {"splits": {"tiny_train": names[:-1], "tiny_val": names[-1:]}}).items():
        (folder / f"{name}.json").write_text(json.dumps(table))
    return root


def _write_scene(root, rows, scene, start, keyframes, sweeps, boxes):
    samples = [f"{scene}-{k}" for k in range(keyframes)]
    links = {"first_sample_token": samples[0], "last_sample_token": samples[-1], "nbr_samples": keyframes}
    rows["scene"].append({"token": scene, "name": scene, "description": "", "log_token": "", **links})
    last = dict.fromkeys(MOUNTS, "")
    for k, sample in enumerate(samples):
        t_key = 1.0 + k * PERIOD
        rows["sample"].append(
            {"token": sample, "timestamp": start + round(t_key * 1e6), "scene_token": scene,
             "prev": samples[k - 1] if k else "", "next": samples[k + 1] if k + 1 < keyframes else ""}
        )  # fmt: skip
        for channel in MOUNTS:
            for back in range(0 if MODALITY[channel] == "camera" else sweeps, -1, -1):
                t = t_key - AGE[channel] - back * SWEEP_PERIOD
                last[channel] = _write_firing(root, rows, scene, sample, channel, t, start, back == 0, last[channel])
    for number, box in enumerate(boxes):
        _annotate(rows, scene, samples, number, box)


def _write_firing(root, rows, scene, sample, channel, t, start, is_key, previous) -> str:
    stamp = start + round(t * 1e6)
    token = f"{scene}-{channel}-{stamp}"
    suffix = {"camera": "jpg", "lidar": "pcd.bin", "radar": "pcd"}[MODALITY[channel]]
    filename = f"{'samples' if is_key else 'sweeps'}/{channel}/{token}.{suffix}"
    path = root / filename
    path.parent.mkdir(parents=True, exist_ok=True)
    pose = ego_pose(t)
    sensor_T_global = invert(pose @ MOUNTS[channel])
    {"camera": write_camera, "lidar": write_lidar, "radar": write_radar}[MODALITY[channel]](path, sensor_T_global, t)
    if previous:
        rows["sample_data"][_row(rows, previous)]["next"] = token
    rows["ego_pose"].append(
        {
            "token": token,
            "timestamp": stamp,
            "translation": pose[:3, 3].tolist(),
            "rotation": to_quaternion(pose).tolist(),
        }
    )
    rows["sample_data"].append(
        {"token": token, "sample_token": sample, "ego_pose_token": token, "calibrated_sensor_token": f"calib-{channel}",
         "filename": filename, "fileformat": suffix, "height": HEIGHT * (suffix == "jpg"), "width": WIDTH * (suffix == "jpg"),
         "timestamp": stamp, "is_key_frame": is_key, "prev": previous, "next": ""}
    )  # fmt: skip
    return token


def _row(rows, token):
    return next(i for i, record in enumerate(rows["sample_data"]) if record["token"] == token)


def _annotate(rows, scene, samples, number, box):
    frames = [k for k in box.get("frames", range(len(samples))) if k < len(samples)]
    instance, category, attribute = f"{scene}-object-{number}", box["category"], box.get("attribute", "")
    rows["category"] += [{"token": category, "name": category}]
    rows["attribute"] += [{"token": attribute, "name": attribute}] if attribute else []
    rows["instance"].append({"token": instance, "category_token": category, "nbr_annotations": len(frames)})
    for place, k in enumerate(frames):
        t, yaw = 1.0 + k * PERIOD, box.get("yaw", lambda t: 0.0)(1.0 + k * PERIOD)
        rows["sample_annotation"].append(
            {"token": f"{instance}-{k}", "sample_token": samples[k], "instance_token": instance,
             "visibility_token": "3", "attribute_tokens": [attribute] if attribute else [],
             "translation": list(map(float, box["center"](t))), "size": box.get("size", [1.9, 4.6, 1.6]),
             "rotation": [np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)],
             "num_lidar_pts": box.get("points", 5), "num_radar_pts": 0,
             "prev": f"{instance}-{frames[place - 1]}" if place else "",
             "next": f"{instance}-{frames[place + 1]}" if place + 1 < len(frames) else ""}
        )  # fmt: skip


def write_camera(path: Path, sensor_T_global: np.ndarray, t: float) -> None:
    """A smooth picture; depth 10 m in the upper half but 6 m in one pixel, sky below; a truck and before it a bicycle."""
    ramp = np.add.outer(np.linspace(40, 160, HEIGHT), np.linspace(0, 60, WIDTH))
    cv2.imwrite(str(path), np.stack([ramp, ramp[::-1], np.full_like(ramp, 90)], axis=-1).astype(np.uint8))
    depth, classes = np.zeros((HEIGHT, WIDTH), np.uint16), np.zeros((HEIGHT, WIDTH), np.uint8)
    depth[: HEIGHT // 2] = 10 * 256
    depth[3, 5] = 6 * 256
    classes[:8, :8], classes[3, 5] = 2, 8
    cv2.imwrite(str(path.with_suffix(".depth.png")), depth)
    cv2.imwrite(str(path.with_suffix(".class.png")), classes)


def write_lidar(path: Path, sensor_T_global: np.ndarray, t: float) -> None:
    """All landmarks, the car's own roof and one NaN point."""
    points = np.vstack([transform(sensor_T_global, LANDMARKS), [[0.3, -0.4, -0.2], [np.nan, 1, 1]]])
    columns = np.column_stack([points, np.full(len(points), 51.0), np.zeros(len(points))]).astype("<f4")
    path.write_bytes(columns.tobytes())
    np.save(path.with_name(path.name.removesuffix(".pcd.bin") + ".time.npy"), np.full(len(points), -0.025, "<f4"))


def write_radar(path: Path, sensor_T_global: np.ndarray, t: float) -> None:
    """All landmarks, then the mover with its whole velocity vector as the compensated one."""
    points = transform(sensor_T_global, np.vstack([LANDMARKS, MOVER_START + MOVER_VELOCITY * t]))
    velocity = np.vstack([np.zeros_like(LANDMARKS), sensor_T_global[:3, :3] @ MOVER_VELOCITY])
    write_detections(
        path, x=points[:, 0], y=points[:, 1], z=points[:, 2], vx_comp=velocity[:, 0], vy_comp=velocity[:, 1]
    )


def write_detections(path: Path, **columns) -> None:
    """A radar .pcd of these columns, zeros elsewhere (RCS 10, unambiguous)."""
    records = np.zeros(len(columns["x"]), RADAR_DTYPE)
    records["rcs"], records["ambig_state"] = 10.0, 3
    for name, values in columns.items():
        records[name] = values
    kinds = {"f": "F", "i": "I"}
    dtypes = [RADAR_DTYPE[name] for name in RADAR_FIELDS]
    header = [
        "# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", f"FIELDS {' '.join(RADAR_FIELDS)}",
        f"SIZE {' '.join(str(d.itemsize) for d in dtypes)}", f"TYPE {' '.join(kinds[d.kind] for d in dtypes)}",
        f"COUNT {' '.join('1' for _ in dtypes)}", f"WIDTH {len(records)}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(records)}", "DATA binary",
    ]  # fmt: skip
    path.write_bytes("\n".join(header).encode() + b"\n" + records.tobytes() + b"\n")
