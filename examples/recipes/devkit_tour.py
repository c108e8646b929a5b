"""A generated tree in the official devkit: ``.venv-devkit/bin/python examples/recipes/devkit_tour.py data/nano``."""

import json
import sys
from pathlib import Path

import numpy as np
from nuscenes.nuscenes import NuScenes
from nuscenes.utils.data_classes import LidarPointCloud, RadarPointCloud
from PIL import Image

root = Path(sys.argv[1])
version = next(root.glob("v1.0-*")).name
nusc = NuScenes(version=version, dataroot=str(root), verbose=False)

# Splits are ours: the devkit's own lists know the scenes of nuScenes only.
splits = json.loads((root / version / "splits.json").read_text())
names = {scene["name"]: scene["token"] for scene in nusc.scene}
train = {names[name] for name in next(scenes for split, scenes in splits.items() if split.endswith("train"))}
sample = next(sample for sample in nusc.sample if sample["scene_token"] in train)

path, boxes, cam_K = nusc.get_sample_data(sample["data"]["CAM_FRONT"])
print(f"CAM_FRONT: {Image.open(path).size}, f = {cam_K[0, 0]:.0f} px, {len(boxes)} boxes in its picture")
cloud, ages = LidarPointCloud.from_file_multisweep(nusc, sample, "LIDAR_TOP", "LIDAR_TOP", nsweeps=3)
print(f"LIDAR_TOP: {cloud.nbr_points()} points, the oldest {ages.max():.2f} s old")
for channel in (name for name in sample["data"] if name.startswith("RADAR")):
    scan = RadarPointCloud.from_file(nusc.get_sample_data_path(sample["data"][channel]))
    print(f"{channel}: {scan.nbr_points()} detections that the devkit's default filter lets through")

# What a real recording has not: side files, and keys that the devkit passes over.
depth = np.asarray(Image.open(Path(path).with_suffix(".depth.png"))) / 256
print(f"exact depth: {depth.shape}, {depth[depth > 0].min():.1f} to {depth.max():.1f} m")
print("condition:", nusc.get("scene", sample["scene_token"])["condition"])
label = nusc.get("sample_annotation", sample["anns"][0])
off = np.abs(np.array(label["velocity"]) - nusc.box_velocity(label["token"])[:2]).max()
print(
    f"velocity of {label['category_name']}: exact {np.round(label['velocity'], 2)}, the devkit's is {off:.2f} m/s off"
)
