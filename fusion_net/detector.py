"""A trained detector for arrays of your own: ``Detector.load("nano")(images=..., points=..., radar=..., calibration=...)``.

Everything is in the ego frame at one reference time, nuScenes': x forward, y left, z up, metres, its origin on the ground below
the middle of the rear axle.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from fusion_net.common.boxes import Boxes
from fusion_net.common.geometry import invert
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.data.cameras import fit_image
from fusion_net.data.depth_labels import lidar_depth
from fusion_net.detector_inputs import intrinsics, lidar_table, pictures, poses, radar_table
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.precision import autocast
from fusion_net.runs.sources import names_weights, shipped_names
from fusion_net.runs.trained import Trained, shipped, trained_run

Array = ArrayLike | Tensor


@dataclass(frozen=True)
class Calibration:
    """Of N cameras. ``cam_K`` (N, 3, 3): pinhole matrices of the images as they are given, pixel centres at +0.5. ``ego_T_cam``
    (N, 4, 4): from a camera at its own time (x right, y down, z forward) to the ego frame at the reference time. One camera may
    leave out the first axis."""

    cam_K: Array
    ego_T_cam: Array


@dataclass(frozen=True)
class Detections:
    """N boxes, best first, in the ego frame. An index array, mask or slice picks some: ``found[found.score > 0.3]``."""

    name: NDArray[np.str_]  # (N,) nuScenes' class: car, truck, ..., barrier
    score: NDArray[np.float64]  # (N,) in [0, 1]
    center: NDArray[np.float64]  # (N, 3) x, y, z in m of the box's middle
    wlh: NDArray[np.float64]  # (N, 3) width across, length along the heading, height in m
    yaw: NDArray[np.float64]  # (N,) rad, heading counter-clockwise from x
    velocity: NDArray[np.float64]  # (N, 2) m/s along x and y, over ground
    sigma: NDArray[np.float64]  # (N, 2) m, standard deviation of x and y as the network states it

    def __len__(self) -> int:
        return len(self.score)

    def __getitem__(self, index) -> "Detections":
        """The boxes at an index array, mask or slice."""
        return Detections(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


class Detector:
    """Call it with what there is; whatever is left out counts as a dead sensor."""

    def __init__(self, trained: Trained, *, device: torch.device | str = "cpu") -> None:
        self.model: FusionNet = trained.model().to(device)
        self.device, self.precision = torch.device(device), str(trained.cfg.trainer.precision)
        self.classes: list[str] = list(trained.cfg.classes)
        self.sensors: list[str] = list(trained.cfg.encoders)
        settings = trained.cfg.dataset.val
        self.image_size: list[int] | None = None if settings.image_size is None else list(settings.image_size)
        self.stride: int | None = settings.label_stride

    @staticmethod
    def load(name: str | Path, *, device: torch.device | str = "cpu") -> "Detector":
        """Shipped weights by name ("nano") or by the path of their file (.pt), or the best checkpoint of a run by its folder
        ("runs/mine"). FileNotFoundError where there is none, ValueError for what is no name."""
        if not isinstance(name, str | Path) or not str(name).strip():
            known = ", ".join(f'"{each}"' for each in shipped_names())
            raise ValueError(f'detector: {name!r} names none; give shipped weights ({known}) or a run ("runs/mine")')
        is_file = names_weights(str(name))
        return Detector(shipped(str(name)) if is_file else trained_run(Path(name), "best"), device=device)

    @torch.inference_mode()
    def __call__(
        self,
        *,
        images: Array | Sequence[Array] | None = None,
        points: Array | None = None,
        radar: Array | None = None,
        calibration: Calibration | None = None,
    ) -> Detections:
        """Boxes of one moment. numpy arrays and tensors alike; None: the sensor is not there, or dead.

        ``images``: (N, H, W, 3) uint8 RGB of N cameras, or (H, W, 3) of one, with their ``calibration``; they are scaled and
        cut as the images that the detector was trained with. ``points`` (P, 3 to 5): LiDAR points x, y, z, intensity in [0, 1],
        and age in s (reference time minus the point's); what is left out is 0. ``radar`` (R, 6 or 7): x, y, z, RCS in dBsm,
        the radial velocity over ground as a vector vx, vy in m/s, and age in s. No LiDAR point at all counts as a dead LiDAR,
        and nothing is found where nothing else is given. ValueError or TypeError, with what would be right, when no sensor is
        given or an array is none of these (:mod:`fusion_net.detector_inputs`).
        """
        given = {"camera": images, "lidar": points, "radar": radar}
        there = [sensor for sensor in MODALITIES if given[sensor] is not None]
        if not there:
            raise ValueError("detector: no sensor is given; give images (with calibration=...), points or radar")
        if unknown := [sensor for sensor in there if sensor not in self.sensors]:
            raise ValueError(f"detector: it has no encoder for {unknown[0]}; it takes {', '.join(self.sensors)}")
        lidar = lidar_table(points)
        seen, cam_K, ego_T_cam, depth = self._views(images, calibration, lidar)
        present = {"camera": images is not None, "lidar": len(lidar) > 0, "radar": radar is not None}
        if not any(present.values()):
            return self._named(Boxes.empty())
        returns = radar_table(radar)
        batch = Batch(
            tokens=["array"],
            images=seen[None],
            cam_K=cam_K[None],
            ego_T_cam=ego_T_cam[None],
            lidar_depth=depth[None],
            lidar_points=torch.from_numpy(lidar),
            lidar_batch=torch.zeros(len(lidar), dtype=torch.int64),
            radar_points=torch.from_numpy(returns),
            radar_batch=torch.zeros(len(returns), dtype=torch.int64),
            present=torch.tensor([[present[name] for name in MODALITIES]]),
        ).to(self.device)
        with autocast(self.precision):
            (boxes,) = self.model.decode(self.model(batch))
        return self._named(boxes)

    def _views(
        self, images: Any, calibration: Calibration | None, lidar: NDArray[np.float32]
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Images (N, 3, H, W), cam_K (N, 3, 3), ego_T_cam (N, 4, 4), the LiDAR's depth (N, h, w), as the network sees them."""
        if images is None:
            pixels = torch.zeros(0, 3, 0, 0, dtype=torch.uint8)
            return pixels, torch.zeros(0, 3, 3), torch.zeros(0, 4, 4), torch.zeros(0, 0, 0)
        if calibration is None:
            raise ValueError("detector: images need calibration=Calibration(cam_K=..., ego_T_cam=...)")
        if not isinstance(calibration, Calibration):
            kind = type(calibration).__name__
            raise TypeError(f"detector: calibration is a {kind}; give Calibration(cam_K=..., ego_T_cam=...)")
        views = pictures(images)
        cam_K, ego_T_cam = intrinsics(calibration.cam_K, len(views)), poses(calibration.ego_T_cam, len(views))
        fit = fit_image(views[0].shape[:2], self.image_size, self.stride)
        size = {"height": fit.height, "width": fit.width, "stride": self.stride or 1}
        cam_K = np.stack([fit.cam_K(each) for each in cam_K])
        depth = [lidar_depth(lidar, invert(pose), own, **size) for pose, own in zip(ego_T_cam, cam_K, strict=True)]
        return (
            torch.from_numpy(np.stack([fit.image(each).transpose(2, 0, 1) for each in views])),
            torch.tensor(cam_K, dtype=torch.float32),
            torch.tensor(ego_T_cam, dtype=torch.float32),
            torch.from_numpy(np.stack(depth)),
        )

    def _named(self, boxes: Boxes) -> Detections:
        return Detections(
            name=np.array(self.classes)[boxes.label],
            score=boxes.score,
            center=boxes.center,
            wlh=boxes.wlh,
            yaw=boxes.yaw,
            velocity=boxes.velocity,
            sigma=np.exp(boxes.log_variance / 2),
        )
