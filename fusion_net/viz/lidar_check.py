"""Draws a keyframe's calibration, LiDAR points and boxes on every image and all sensors from above:
``python -m fusion_net.viz.lidar_check data=nano sample=3 out=check.png``.

A sharp fit of the points to the edges in the images means that extrinsics, intrinsics and ego-motion are read correctly.
Points and boxes of moving objects are drawn where they were when the camera fired, by the velocity of their labels;
``follow=false`` leaves them where the sweep had them. ``error_deg`` adds a third picture of each camera: the same points if
the LiDAR were mounted so far off about the vertical. Settings are in ``configs/lidar_check.yaml``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from omegaconf import DictConfig

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.cli.command import command
from fusion_net.common.drawing import BEVPanel, Image, boxes_on_image, depth_colors, picture_file, points_on_image
from fusion_net.common.nuscenes_format import DEPTH_SCALE, DEPTH_SUFFIX, REFERENCE
from fusion_net.data.readable import refuse_missing_files
from fusion_net.data.samples import Sample, SampleReader
from fusion_net.nuscenes.datasets import open_datasets, sample_of_split
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.sensor_files import read_labels
from fusion_net.nuscenes.table_fields import Record
from fusion_net.viz.calibration import agreement, at_time, follow, turned

BOX, RADAR, PANEL_WIDTH = (255, 220, 60), (255, 90, 200), 960
STEEPEST = 45.0
"""Degrees of error_deg, at most."""


@dataclass(frozen=True)
class TimedView:
    """One camera of a sample. ``time`` s from the reference to its exposure; ``depth`` exact metres, 0 none, or None."""

    name: str
    image: Image  # (H, W, 3)
    cam_K: NDArray[np.float64]  # (3, 3)
    ego_T_cam: NDArray[np.float64]  # (4, 4), ego at the reference time
    time: float
    depth: NDArray[np.float32] | None  # (H, W)


def draw_sample(
    sample: Sample,
    views: list[TimedView],
    *,
    lidar_place: NDArray,
    grid: BEVGrid,
    error_deg: float = 0.0,
    moving: bool = True,
) -> Image:
    """One sheet: the cameras' images on the left, two to a row if there are many, the view from above on the right.

    ``lidar_place`` (3,): where the LiDAR sits in the ego frame. ``moving``: points and boxes go with the objects.
    """
    rows = [_camera(sample, view, lidar_place, error_deg, moving) for view in views]
    if len(rows) > 2:
        rows += [np.zeros_like(rows[-1])] * (len(rows) % 2)
        pairs = zip(rows[::2], rows[1::2], strict=True)
        rows = [np.hstack([_padded(image, max(len(a), len(b))) for image in (a, b)]) for a, b in pairs]
    left = np.vstack(rows) if rows else np.zeros((0, 0, 3), np.uint8)
    height = max(len(left), 600)
    panel = _from_above(sample, grid, min(height, 1000))
    return np.hstack([_padded(left, height), _padded(panel, height)])


def _camera(sample: Sample, view: TimedView, lidar_place: NDArray, error_deg: float, moving: bool) -> Image:
    """The image as it is with its boxes, above the same with LiDAR points, above those of a LiDAR that sits askew."""
    scale = PANEL_WIDTH / view.image.shape[1]
    camera = {"cam_K": view.cam_K, "ego_T_cam": view.ego_T_cam}
    size = (PANEL_WIDTH, round(view.image.shape[0] * scale))
    boxed = np.asarray(cv2.resize(view.image, size, interpolation=cv2.INTER_CUBIC), np.uint8)
    dim = (boxed * 0.6).astype(np.uint8)
    boxes_on_image(boxed, at_time(sample.boxes, view.time if moving else 0.0), color=BOX, scale=scale, **camera)
    _caption(boxed, f"{view.name} {1e3 * view.time:+.0f} ms   {len(sample.boxes)} boxes")
    points, age = sample.lidar_points[:, :3].astype(float), sample.lidar_points[:, 4]
    note = "as the sweep has them"
    if moving:
        points, carried = follow(points, age, sample.boxes, view.time)
        note = f"{carried.sum()} points moved with their objects"
    pictures = [boxed]
    for error in dict.fromkeys((0.0, error_deg)):
        dotted, projected = dim.copy(), turned(points, lidar_place, error)
        points_on_image(dotted, projected, radius=2, scale=scale, **camera)
        fit = (
            ""
            if view.depth is None
            else f"{100 * agreement(projected, view.depth, view.cam_K, view.ego_T_cam):.0f} % on the exact depth   "
        )
        _caption(dotted, f"LiDAR by depth   {fit}" + (f"{error:g} degrees off" if error else note))
        pictures.append(dotted)
    return np.vstack(pictures)


def _from_above(sample: Sample, grid: BEVGrid, height: int) -> Image:
    """LiDAR by height, radar with its compensated velocity over half a second, boxes with theirs over one."""
    panel = BEVPanel(grid, scale=height / (grid.x_max - grid.x_min))
    image = panel.canvas()
    order = np.argsort(sample.lidar_points[:, 2])
    lidar = sample.lidar_points[order]
    panel.points(image, lidar[:, :2], depth_colors(4 ** (3.0 - lidar[:, 2].clip(0, 3))))
    panel.boxes(image, sample.boxes, BOX)
    radar = sample.radar_points
    panel.points(image, radar[:, :2], RADAR, radius=2)
    panel.arrows(image, radar[:, :2], radar[:, 4:6] / 2, RADAR)
    _caption(image, f"LiDAR by height, radar ({len(radar)}) with velocity, boxes; rings of 10 m")
    return image


def _padded(image: Image, height: int) -> Image:
    return np.pad(image, ((0, height - len(image)), (0, 0), (0, 0)))


def _caption(image: Image, text: str) -> None:
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    image[:26, : width + 16] //= 3
    cv2.putText(image, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)


def read_views(nusc: NuScenes, token: str, reader: SampleReader | None = None) -> list[TimedView]:
    """A sample's cameras, each in its own size, with the faults of ``reader``."""
    reader = replace(reader or SampleReader(), modalities=["camera"], image_size=None, label_stride=None)
    reference, views = nusc.reference(token), []
    for channel in nusc.channels("camera"):
        record = nusc.keyframes[token].get(channel)
        exact = None if record is None else _exact_depth(nusc, record)
        time = (record["timestamp"] - reference["timestamp"]) * 1e-6 if record else 0.0
        view = replace(reader, cameras=[channel]).read(nusc, token)
        views.append(TimedView(channel, view.images[0], view.cam_K[0], view.ego_T_cam[0], time, exact))
    return views


def _exact_depth(nusc: NuScenes, record: Record) -> NDArray[np.float32] | None:
    with nusc.file_of(record) as path:
        depth = read_labels(path, DEPTH_SUFFIX, nusc.image_size(record))
    return None if depth is None else depth.astype(np.float32) / DEPTH_SCALE


def write_check(
    root: str | Sequence[str],
    *,
    version: str | None = None,
    split: str = "all",
    sample: int = 0,
    error_deg: float = 0.0,
    follow: bool = True,
    out: str = "lidar_check.png",
) -> Path:
    """Draws the keyframe ``sample`` of a split and writes the picture; returns its path."""
    if not abs(error_deg) <= STEEPEST:
        raise ValueError(f"error_deg={error_deg} is not within {STEEPEST:g} degrees; try error_deg=0.5")
    nusc, token = sample_of_split(open_datasets(root, version), split, sample)
    refuse_missing_files([(nusc, token)], SampleReader(label_stride=None))
    path = picture_file(out, formats=(".png", ".jpg"))
    points = SampleReader(cameras=[], label_stride=None).read(nusc, token)
    all_round = not len(points.lidar_points) or (points.lidar_points[:, 0] < -5).mean() > 0.1
    grid = BEVGrid(-50.0, 50.0, -50.0, 50.0, 1.0) if all_round else BEVGrid(-5.0, 60.0, -35.0, 35.0, 1.0)
    place = nusc.ego_T_sensor(nusc.keyframes[token][REFERENCE])[:3, 3]
    views = read_views(nusc, token)
    sheet = draw_sample(points, views, lidar_place=place, grid=grid, error_deg=error_deg, moving=follow)
    if not cv2.imwrite(str(path), sheet[..., ::-1]):
        raise OSError(f"out={path} could not be written")
    print(f"{path}: sample {sample} of {split}, scene {nusc.scene(token)['name']}")
    return path


@command(config_name="lidar_check")
def main(cfg: DictConfig) -> None:
    """Draws the keyframe that ``cfg`` names."""
    options = {name: cfg[name] for name in ("split", "sample", "error_deg", "follow", "out")}
    write_check(cfg.data.root, version=cfg.data.version, **options)


if __name__ == "__main__":
    main()
