"""Draws a sample's calibration: LiDAR points and boxes on every image, and all sensors from above.

    python -m fusion_net.viz.lidar_check data/surround [sample=N] [split=val] [error_deg=0.5] [follow=no] out=check.png
    python -m fusion_net.viz.lidar_check data/nuscenes version=v1.0-mini        of several versions in one folder

A sharp fit of the points to the edges in the images means that extrinsics, intrinsics and ego-motion are read correctly.
Points and boxes of moving objects are drawn where they were when the camera fired, by the velocity of their labels;
``follow=no`` leaves them where the sweep had them. ``error_deg`` adds a third picture of each camera: the same points if the
LiDAR were mounted so far off about the vertical.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.cli.terminal import print_any_text
from fusion_net.common.drawing import BEVPanel, Image, boxes_on_image, depth_colors, points_on_image
from fusion_net.common.nuscenes_format import DEPTH_SCALE, DEPTH_SUFFIX, REFERENCE
from fusion_net.data.readable import refuse_missing_files
from fusion_net.data.samples import Sample, SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.sensor_files import read_labels
from fusion_net.nuscenes.table_fields import Record
from fusion_net.viz.calibration import agreement, at_time, follow, turned

BOX, RADAR, PANEL_WIDTH = (255, 220, 60), (255, 90, 200), 960
OPTIONS = {"sample": "0", "split": "all", "out": "lidar_check.png", "error_deg": "0", "follow": "yes", "version": ""}
USAGE = "usage: ROOT [sample=N] [split=NAME] [error_deg=DEGREES] [follow=yes|no] [out=PNG] [version=NAME]"


@dataclass(frozen=True)
class Shot:
    """One camera of a sample. ``time`` s from the reference to its exposure; ``depth`` exact metres, 0 none, or None."""

    name: str
    image: Image  # (H, W, 3)
    cam_K: NDArray[np.float64]  # (3, 3)
    ego_T_cam: NDArray[np.float64]  # (4, 4), ego at the reference time
    time: float
    depth: NDArray[np.float32] | None  # (H, W)


def draw_sample(
    sample: Sample,
    shots: list[Shot],
    *,
    lidar_place: NDArray,
    grid: BEVGrid,
    error_deg: float = 0.0,
    moving: bool = True,
) -> Image:
    """One sheet: the cameras' images on the left, two to a row if there are many, the view from above on the right.

    ``lidar_place`` (3,): where the LiDAR sits in the ego frame. ``moving``: points and boxes go with the objects.
    """
    rows = [_camera(sample, shot, lidar_place, error_deg, moving) for shot in shots]
    if len(rows) > 2:
        rows += [np.zeros_like(rows[-1])] * (len(rows) % 2)
        pairs = zip(rows[::2], rows[1::2], strict=True)
        rows = [np.hstack([_padded(image, max(len(a), len(b))) for image in (a, b)]) for a, b in pairs]
    left = np.vstack(rows) if rows else np.zeros((0, 0, 3), np.uint8)
    height = max(len(left), 600)
    panel = _from_above(sample, grid, min(height, 1000))
    return np.hstack([_padded(left, height), _padded(panel, height)])


def _camera(sample: Sample, shot: Shot, lidar_place: NDArray, error_deg: float, moving: bool) -> Image:
    """The image as it is with its boxes, above the same with LiDAR points, above those of a LiDAR that sits askew."""
    scale = PANEL_WIDTH / shot.image.shape[1]
    view = {"cam_K": shot.cam_K, "ego_T_cam": shot.ego_T_cam}
    size = (PANEL_WIDTH, round(shot.image.shape[0] * scale))
    boxed = np.asarray(cv2.resize(shot.image, size, interpolation=cv2.INTER_CUBIC), np.uint8)
    dim = (boxed * 0.6).astype(np.uint8)
    boxes_on_image(boxed, at_time(sample.boxes, shot.time if moving else 0.0), color=BOX, scale=scale, **view)
    _caption(boxed, f"{shot.name} {1e3 * shot.time:+.0f} ms   {len(sample.boxes)} boxes")
    points, age = sample.lidar_points[:, :3].astype(float), sample.lidar_points[:, 4]
    note = "as the sweep has them"
    if moving:
        points, carried = follow(points, age, sample.boxes, shot.time)
        note = f"{carried.sum()} points moved with their objects"
    pictures = [boxed]
    for error in dict.fromkeys((0.0, error_deg)):
        dotted, drawn = dim.copy(), turned(points, lidar_place, error)
        points_on_image(dotted, drawn, radius=2, scale=scale, **view)
        fit = (
            ""
            if shot.depth is None
            else f"{100 * agreement(drawn, shot.depth, shot.cam_K, shot.ego_T_cam):.0f} % on the exact depth   "
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


def read_shots(tree: NuScenes, token: str) -> list[Shot]:
    """A sample's cameras, each in its own size."""
    reference, shots = tree.reference(token), []
    for channel in tree.channels("camera"):
        record = tree.keyframes[token].get(channel)
        exact = None if record is None else _exact_depth(tree, record)
        time = (record["timestamp"] - reference["timestamp"]) * 1e-6 if record else 0.0
        view = SampleReader(cameras=[channel], modalities=["camera"], label_stride=None).read(tree, token)
        shots.append(Shot(channel, view.images[0], view.cam_K[0], view.ego_T_cam[0], time, exact))
    return shots


def _exact_depth(tree: NuScenes, record: Record) -> NDArray[np.float32] | None:
    with tree.file_of(record) as path:
        depth = read_labels(path, DEPTH_SUFFIX, tree.image_size(record))
    return None if depth is None else depth.astype(np.float32) / DEPTH_SCALE


def main(arguments: list[str]) -> None:
    """Reads the arguments, draws, writes."""
    root = next((a for a in arguments if "=" not in a), None)
    given = dict(a.split("=", 1) for a in arguments if "=" in a)
    wrong = sorted(given.keys() - OPTIONS.keys())
    if root is None or wrong:
        raise ValueError(f"{f'unknown {wrong[0]}=; ' if wrong else ''}{USAGE}")
    options = OPTIONS | given
    out, error_deg = Path(options["out"]), _degrees(options["error_deg"])
    if out.suffix not in (".png", ".jpg"):
        raise ValueError(f"out={out} is no picture; end it with .png or .jpg")
    if options["follow"] not in ("yes", "no"):
        raise ValueError(f"follow={options['follow']}: write follow=yes or follow=no")
    tree = NuScenes(root, options["version"] or None)
    tokens = tree.split(options["split"])
    if not options["sample"].isdecimal() or int(options["sample"]) >= len(tokens):
        raise ValueError(f"sample={options['sample']}: split {options['split']} has samples 0 to {len(tokens) - 1}")
    token = tokens[int(options["sample"])]
    refuse_missing_files([(tree, token)], SampleReader(label_stride=None))
    sample = SampleReader(cameras=[], label_stride=None).read(tree, token)
    all_round = not len(sample.lidar_points) or (sample.lidar_points[:, 0] < -5).mean() > 0.1
    grid = BEVGrid(-50.0, 50.0, -50.0, 50.0, 1.0) if all_round else BEVGrid(-5.0, 60.0, -35.0, 35.0, 1.0)
    place = tree.ego_T_sensor(tree.keyframes[token][REFERENCE])[:3, 3]
    shots, moving = read_shots(tree, token), options["follow"] == "yes"
    sheet = draw_sample(sample, shots, lidar_place=place, grid=grid, error_deg=error_deg, moving=moving)
    out.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(out), sheet[..., ::-1]):
        raise ValueError(f"out={out} could not be written")
    print(f"{out}: sample {options['sample']} of {len(tokens)}, scene {tree.scene(sample.token)['name']}")


def _degrees(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) <= 45:
        raise ValueError(f"error_deg={text} is no angle within 45 degrees; try error_deg=0.5")
    return value


if __name__ == "__main__":
    print_any_text()
    try:
        main(sys.argv[1:])
    except (ValueError, OSError) as error:
        sys.exit(f"lidar_check: {error}")
