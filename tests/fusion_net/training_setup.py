"""Settings and data small enough to train on in a test."""

from pathlib import Path

import torch
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig
from tiny_tree import ego_pose, write_tree

from fusion_net.cli import CONFIGS
from fusion_net.geometry import transform

BODIES = [
    {"category": "vehicle.car", "center": (14.0, 3.0, 1.0)},
    {"category": "vehicle.truck", "center": (24.0, -6.0, 1.5), "size": [2.5, 8.0, 3.0]},
    {"category": "human.pedestrian.adult", "center": (10.0, -4.0, 0.9), "size": [0.6, 0.7, 1.7]},
]
SMALL = [
    "trainer=smoke", "grid.x_max=32.0", "grid.y_min=-12.8", "grid.y_max=16.0", "trainer.precision=float32",
    "model.encoders.camera.widths=[8,8,16,16]", "model.encoders.camera.features=16",
    "model.encoders.camera.view.bins.count=8", "model.decoder.half=16", "model.decoder.quarter=16",
    "model.head.hidden=16", "trainer.augment.rotation_deg=5.0", "modality_dropout=0.9",
]  # fmt: skip


def write_data(root: Path, *, scenes: int = 4) -> Path:
    """``scenes`` scenes of three keyframes, the last for validation, with three standing objects in each."""
    bodies = []
    for made in BODIES:
        center = transform(ego_pose(1.0), [made["center"]])[0]
        bodies.append(made | {"center": lambda t, center=center: center})
    return write_tree(root, scenes=scenes, boxes=bodies)


def settings(root: Path, *overrides: str) -> DictConfig:
    """The composed config of ``train.py`` with small numbers and these overrides."""
    torch.set_num_threads(1)
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        return compose("train", overrides=[f"data.root={root}", *SMALL, *overrides])
