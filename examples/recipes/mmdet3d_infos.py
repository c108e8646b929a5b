"""Writes mmdetection3d's info files (``info_version`` 1.1: mmdet3d 1.1 to 1.4) for a generated tree, whatever its rig.

``.venv-devkit/bin/python examples/recipes/mmdet3d_infos.py data/surround`` makes data/surround/generated_infos_{train,val}.pkl.
mmdet3d's own converter asks for the official scene names and six cameras; what it would write is written here for any. It needs
nuscenes-devkit and no mmdet3d.
"""

import json
import pickle
import sys
from pathlib import Path

import numpy as np
from nuscenes.eval.detection.utils import category_to_detection_name
from nuscenes.nuscenes import NuScenes
from nuscenes.utils.geometry_utils import transform_matrix
from pyquaternion import Quaternion

CLASSES = (
    "car", "truck", "trailer", "bus", "construction_vehicle", "bicycle", "motorcycle", "pedestrian", "traffic_cone", "barrier",
)  # fmt: skip
"""In mmdet3d's order, which is not that of the nuScenes benchmark."""
SWEEPS = 10


def matrix(record: dict) -> np.ndarray:
    """(4, 4) of a pose or a mount."""
    return transform_matrix(record["translation"], Quaternion(record["rotation"]))


def reading(nusc: NuScenes, token: str) -> tuple[dict, np.ndarray, np.ndarray]:
    """A sample_data record, where its sensor sits, and where the car was: (4, 4) each."""
    record = nusc.get("sample_data", token)
    mount = nusc.get("calibrated_sensor", record["calibrated_sensor_token"])
    return record, matrix(mount), matrix(nusc.get("ego_pose", record["ego_pose_token"]))


def info_of(nusc: NuScenes, index: int, sample: dict) -> dict:
    """The info of one keyframe."""
    token = sample["data"]["LIDAR_TOP"]
    lidar, lidar2ego, ego2global = reading(nusc, token)
    info = {
        "sample_idx": index, "token": sample["token"], "timestamp": sample["timestamp"] / 1e6,
        "ego2global": ego2global.tolist(), "images": {}, "lidar_sweeps": [], "instances": [],
        "lidar_points": {
            "num_pts_feats": 5, "lidar_path": Path(lidar["filename"]).name, "lidar2ego": lidar2ego.tolist(),
        },
    }  # fmt: skip

    def seen_from(sensor2ego: np.ndarray, pose: np.ndarray) -> list:
        """The transform from this LiDAR to another sensor at its own time."""
        return np.linalg.solve(pose @ sensor2ego, ego2global @ lidar2ego).tolist()

    for channel in sorted(name for name in sample["data"] if name.startswith("CAM")):
        record, cam2ego, pose = reading(nusc, sample["data"][channel])
        mount = nusc.get("calibrated_sensor", record["calibrated_sensor_token"])
        info["images"][channel] = {
            "img_path": Path(record["filename"]).name, "cam2img": mount["camera_intrinsic"], "cam2ego": cam2ego.tolist(),
            "lidar2cam": seen_from(cam2ego, pose), "sample_data_token": record["token"], "timestamp": record["timestamp"] / 1e6,
        }  # fmt: skip
    while lidar["prev"] and len(info["lidar_sweeps"]) < SWEEPS:
        lidar, mount, pose = reading(nusc, lidar["prev"])
        points = {
            "lidar_path": nusc.get_sample_data_path(lidar["token"]), "num_pts_feats": 5,
            "lidar2ego": mount.tolist(), "lidar2sensor": seen_from(mount, pose),
        }  # fmt: skip
        sweep = {
            "timestamp": lidar["timestamp"] / 1e6,
            "sample_data_token": lidar["token"],
            "ego2global": pose.tolist(),
        }
        info["lidar_sweeps"].append(sweep | {"lidar_points": points})
    lidar_R_global = np.linalg.inv((ego2global @ lidar2ego)[:3, :3])
    for box in nusc.get_sample_data(token)[1]:
        label = nusc.get("sample_annotation", box.token)
        name = category_to_detection_name(label["category_name"])  # None of decoys
        number = CLASSES.index(name) if name else -1
        width, length, height = box.wlh
        info["instances"].append({
            "bbox_3d": [*box.center, length, width, height, box.orientation.yaw_pitch_roll[0]],
            "bbox_label": number, "bbox_label_3d": number,
            "velocity": (lidar_R_global @ [*nusc.box_velocity(box.token)[:2], 0.0])[:2].tolist(),
            "num_lidar_pts": label["num_lidar_pts"], "num_radar_pts": label["num_radar_pts"],
            "bbox_3d_isvalid": label["num_lidar_pts"] + label["num_radar_pts"] > 0,
        })  # fmt: skip
    return info


def main(root: Path) -> None:
    """Writes both files into the tree."""
    version = next(root.glob("v1.0-*")).name
    nusc = NuScenes(version=version, dataroot=str(root), verbose=False)
    splits = json.loads((root / version / "splits.json").read_text())
    scene_name = {scene["token"]: scene["name"] for scene in nusc.scene}
    about = {"categories": {name: i for i, name in enumerate(CLASSES)}, "dataset": "nuscenes", "version": version}
    for split, scenes in splits.items():
        kept = [sample for sample in nusc.sample if scene_name[sample["scene_token"]] in scenes]
        content = {
            "metainfo": about | {"info_version": "1.1"},
            "data_list": [info_of(nusc, index, sample) for index, sample in enumerate(kept)],
        }
        path = root / f"generated_infos_{split.rpartition('_')[2]}.pkl"
        path.write_bytes(pickle.dumps(content))
        print(f"{path}: {len(kept)} samples, {sum(len(each['instances']) for each in content['data_list'])} boxes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
