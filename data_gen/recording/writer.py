"""Writes one episode as nuScenes rows and files.

Everything of a scene is written under names and tokens that follow from (data set, scene) alone, and its rows go into one
record file when all of it is on disk: a scene is there or it is not, whoever wrote it and in whatever order.
"""

import hashlib
import json
import math
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from data_gen.assets.shapes.mesh import Asset
from data_gen.recording.capture import Data, Firing, capture, keyframe_times
from data_gen.recording.faults import SceneFaults, spoil
from data_gen.recording.point_files import write_lidar, write_radar
from data_gen.recording.visibility import Seen
from data_gen.rig.mounts import Camera
from data_gen.rig.rig import Rig
from data_gen.scene.scene import Scene
from data_gen.sensors.lidar.lidar import LidarSweep
from data_gen.sensors.radar.radar import RadarScan
from fusion_net.common.faults import FaultPlan
from fusion_net.common.geometry import to_quaternion
from fusion_net.common.nuscenes_format import CATEGORY_TO_CLASS, CLASSES, REFERENCE

Row = dict[str, Any]

EPOCH_US = 1_700_000_000_000_000
"""Time stamp of the first scene's zero; scenes follow at 100 s."""
LABEL_RANGE = 60.0
"""Metres from the ego within which an object is annotated."""
MIN_RAYS = 4
"""Camera and LiDAR rays of a keyframe that must reach an object for it to be annotated there: nuScenes' annotators label
what they can see, and a radar's faint echo from below the truck in front is not seeing."""
DECOY = "movable_object.debris"
"""Category of what is no object but looks like one to some sensor: no detection class, so every metric ignores it, and one
of nuScenes' own, so that the devkit draws it."""
JPEG_QUALITY = 92
DEPTH_SCALE = 256.0  # depth image: 1/256 m, KITTI's convention


def token(*parts: str | int) -> str:
    """32 hexadecimal digits that follow from the parts."""
    return hashlib.blake2b(repr(parts).encode(), digest_size=16).hexdigest()


def write_scene(
    scene: Scene,
    rig: Rig,
    *,
    root: Path,
    dataset: str,
    index: int,
    keyframes: int,
    seed: int,
    layout: str,
    faults: FaultPlan | None = None,
) -> dict[str, list[Row]]:
    """Renders and writes a scene; returns its rows by table name. Raises OSError when the disk does not take them."""
    return _SceneWriter(scene, rig, root, dataset, index, layout).run(keyframes, seed, faults or FaultPlan())


class _SceneWriter:
    def __init__(self, scene: Scene, rig: Rig, root: Path, dataset: str, index: int, layout: str) -> None:
        self.scene, self.rig, self.root, self.dataset, self.layout = scene, rig, root, dataset, layout
        self.start = EPOCH_US + index * 100_000_000
        self.log = f"{dataset}-{scene.name}"
        self.rows: dict[str, list[Row]] = {
            name: []
            for name in ("log", "map", "scene", "sample", "sample_data", "ego_pose", "instance", "sample_annotation")
        }

    def run(self, keyframes: int, seed: int, plan: FaultPlan) -> dict[str, list[Row]]:
        times = keyframe_times(self.rig, keyframes, seed=seed)
        samples = [token(self.log, "sample", k) for k in range(keyframes)]
        seen = [Seen(self.scene, t) for t in times.tolist()]
        self._log_and_map()
        faults = SceneFaults(plan, self.rig.modalities, token(self.log, "scene"), samples)
        for firing in capture(self.scene, self.rig, keyframes=keyframes, seed=seed, faults=faults):
            self._sample_data(firing, samples[firing.keyframe])
            if firing.is_keyframe:
                seen[firing.keyframe].add(firing)
        self._link_sample_data()
        for k, sample in enumerate(samples):
            neighbours = {"prev": samples[k - 1] if k else "", "next": samples[k + 1] if k + 1 < keyframes else ""}
            stamp = self._stamp(float(times[k]))
            self.rows["sample"].append(
                {"token": sample, "timestamp": stamp, "scene_token": token(self.log, "scene"), **neighbours}
            )
        self._annotations(times, samples, seen)
        condition = self.scene.condition
        self.rows["scene"].append(
            {
                "token": token(self.log, "scene"),
                "log_token": token(self.log),
                "nbr_samples": keyframes,
                "first_sample_token": samples[0],
                "last_sample_token": samples[-1],
                "name": self.scene.name,
                "description": f"{self.layout}, {condition.name}",
                "layout": self.layout,
                "condition": {name: getattr(condition, name) for name in condition.__dataclass_fields__},
            }
        )
        return self.rows

    def _stamp(self, t: float) -> int:
        return self.start + round(t * 1e6)

    def _log_and_map(self) -> None:
        filename = f"maps/{self.log}.png"
        mask = self.scene.ground.drivable.view(np.uint8)
        cv2.flip(mask, 0, mask)  # image rows run down, y runs up
        # 255 is the devkit's foreground: it reads a picture of one bit a pixel as 0 and 1 and then finds no road.
        _write_image(
            self.root / filename,
            mask * np.uint8(255),
            [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE],
        )
        date = datetime.fromtimestamp(self.start / 1e6, UTC).date().isoformat()
        self.rows["log"].append(
            {"token": token(self.log), "logfile": self.log, "vehicle": self.rig.name, "date_captured": date,
             "location": f"{self.layout}-{self.scene.name}"}  # a place of its own: each has its own map
        )  # fmt: skip
        self.rows["map"].append(
            {"token": token(self.log, "map"), "log_tokens": [token(self.log)], "category": "semantic_prior",
             "filename": filename}
        )  # fmt: skip

    def _sample_data(self, firing: Firing, sample: str) -> None:
        """Writes what the faults leave of a reading. Of a dead sensor nothing is, but for the keyframe that gives a sample its
        time and pose, which is an empty cloud."""
        if firing.faults.dead and firing.channel != REFERENCE:
            return
        mount = self.rig.sensors[firing.channel]
        stamp = self._stamp(firing.time)
        is_camera = isinstance(mount, Camera)
        kind = "samples" if firing.is_keyframe else "sweeps"
        suffix = {"camera": "jpg", "lidar": "pcd.bin", "radar": "pcd"}[self.rig.modalities[firing.channel]]
        filename = f"{kind}/{firing.channel}/{self.log}__{firing.channel}__{stamp}.{suffix}"
        left = spoil(firing.data, firing.faults, mount=mount, stamp=stamp)
        self._write_reading(self.root / filename, left)
        key = token(self.log, firing.channel, stamp)
        position, yaw, _ = self.scene.ego.at(firing.time)
        self.rows["ego_pose"].append(
            {"token": key, "timestamp": stamp, "rotation": _quaternion(float(yaw)), "translation": position.tolist()}
        )
        row = {
            "token": key,
            "sample_token": sample,
            "ego_pose_token": key,
            "calibrated_sensor_token": token(self.dataset, self.rig.name, firing.channel, "calibration"),
            "timestamp": stamp,
            "true_timestamp": self._stamp(firing.true_time),
            "fileformat": "jpg" if is_camera else "pcd",
            "is_key_frame": firing.is_keyframe,
            "height": mount.height if isinstance(mount, Camera) else 0,
            "width": mount.width if isinstance(mount, Camera) else 0,
            "filename": filename,
            "prev": "",
            "next": "",
        }
        if firing.faults and not np.array_equal(firing.ego_T_sensor, mount.ego_T_sensor):
            row["true_translation"] = firing.ego_T_sensor[:3, 3].tolist()
            row["true_rotation"] = to_quaternion(firing.ego_T_sensor).tolist()
        self.rows["sample_data"].append(row)

    def _write_reading(self, path: Path, data: Data) -> None:
        if isinstance(data, LidarSweep):
            write_lidar(path, data)
        elif isinstance(data, RadarScan):
            write_radar(path, data)
        else:
            _write_image(path, data.image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            depth = np.where(data.depth * DEPTH_SCALE < 65_535, np.round(data.depth * DEPTH_SCALE), 0)
            _write_image(path.with_suffix(".depth.png"), depth.astype(np.uint16), [cv2.IMWRITE_PNG_COMPRESSION, 1])
            classes = np.array([class_id(actor.asset) for actor in self.scene.actors] + [0, 0], np.uint8)
            _write_image(path.with_suffix(".class.png"), classes[data.body], [cv2.IMWRITE_PNG_COMPRESSION, 1])

    def _link_sample_data(self) -> None:
        channels: dict[str, list[Row]] = {}
        for row in self.rows["sample_data"]:
            channels.setdefault(row["calibrated_sensor_token"], []).append(row)
        for rows in channels.values():
            for before, after in pairwise(rows):
                before["next"], after["prev"] = after["token"], before["token"]

    def _annotations(self, times: np.ndarray, samples: list[str], seen: list[Seen]) -> None:
        ego = self.scene.ego.at(times)[0]
        for index, actor in enumerate(self.scene.actors):
            category = actor.asset.category or (DECOY if actor.asset.imitates else "")
            if not category:
                continue
            position, yaw, velocity = actor.track.at(times)
            in_sight = np.array([s.reached[index] >= MIN_RAYS for s in seen])
            near = np.flatnonzero((np.hypot(*(position - ego)[:, :2].T) < LABEL_RANGE) & in_sight)
            if not len(near):
                continue
            instance = token(self.log, "instance", actor.instance)
            keys = [token(instance, int(k)) for k in near]
            length, width, height = actor.asset.size
            for place, k in enumerate(near):
                center = position[k] + (0, 0, height / 2)
                attribute = actor.attribute_at(float(np.linalg.norm(velocity[k])))
                self.rows["sample_annotation"].append(
                    {
                        "token": keys[place],
                        "sample_token": samples[k],
                        "instance_token": instance,
                        "visibility_token": str(seen[k].visibility(index)),
                        "attribute_tokens": [token("attribute", attribute)] if attribute else [],
                        "translation": center.tolist(),
                        "size": [width, length, height],
                        "rotation": _quaternion(yaw[k]),
                        "prev": keys[place - 1] if place else "",
                        "next": keys[place + 1] if place + 1 < len(near) else "",
                        "num_lidar_pts": int(seen[k].lidar_points[index]),
                        "num_radar_pts": int(seen[k].radar_points[index]),
                        "num_lidar_echoes": int(seen[k].lidar_echoes[index]),
                        "num_radar_echoes": int(seen[k].radar_echoes[index]),
                        "velocity": velocity[k][:2].tolist(),  # exact; the official one is by finite differences
                        "imitates": actor.asset.imitates,
                    }
                )
            self.rows["instance"].append(
                {"token": instance, "category_token": token("category", category), "nbr_annotations": len(near),
                 "first_annotation_token": keys[0], "last_annotation_token": keys[-1]}
            )  # fmt: skip


def _quaternion(yaw: float) -> list[float]:
    """(w, x, y, z), w >= 0, of a turn about z by ``yaw`` radians."""
    half = math.remainder(yaw, math.tau) / 2
    return [math.cos(half), 0.0, 0.0, math.sin(half)]


def class_id(asset: Asset) -> int:
    """1 + the index of the asset's detection class, 0 for what is no object."""
    return 1 + CLASSES.index(CATEGORY_TO_CLASS[asset.category]) if asset.category else 0


def write_json(path: Path, value: Any) -> None:
    """Writes JSON so that a reader sees the whole file or none of it."""
    partial = path.with_name(path.name + ".part")
    partial.write_text(json.dumps(value, separators=(",", ":")), encoding="utf-8")
    partial.replace(path)


def _write_image(path: Path, image: np.ndarray, options: list[int]) -> None:
    ok, encoded = cv2.imencode(path.suffix, image, options)
    if not ok:
        raise OSError(f"could not encode {path.name}")
    path.write_bytes(encoded.tobytes())
