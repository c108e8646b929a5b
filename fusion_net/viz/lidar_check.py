"""Draws a sample's calibration: LiDAR points and boxes on every image, and all sensors from above.

    python -m fusion_net.viz.lidar_check data/nano [sample=N] [split=val] out=check.png

A sharp fit of the points to the edges in the images means that extrinsics, intrinsics and ego-motion are read correctly.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from fusion_net.bev_grid import BEVGrid
from fusion_net.data.nuscenes import NuScenes
from fusion_net.data.samples import Sample, SampleReader
from fusion_net.viz.bev import BEVPanel, Image, boxes_on_image, depth_colors, points_on_image

BOX, RADAR, PANEL_WIDTH = (255, 220, 60), (255, 90, 200), 960
OPTIONS = {"sample": "0", "split": "all", "out": "lidar_check.png"}


def draw_sample(sample: Sample, *, channels: list[str], grid: BEVGrid) -> Image:
    """One sheet: the cameras' images on the left, two to a row if there are many, the view from above on the right."""
    rows = [_camera(sample, camera, name) for camera, name in enumerate(channels)]
    if len(rows) > 2:
        blank = np.zeros_like(rows[0])
        rows = [np.hstack([*rows[i : i + 2], blank][:2]) for i in range(0, len(rows), 2)]
    height = max(sum(row.shape[0] for row in rows), 600)
    panel = _from_above(sample, grid, min(height, 1000))
    left = np.zeros((height, max((row.shape[1] for row in rows), default=0), 3), np.uint8)
    top = 0
    for row in rows:
        left[top : top + row.shape[0]] = row
        top += row.shape[0]
    panel = np.pad(panel, ((0, height - panel.shape[0]), (0, 0), (0, 0)))
    return np.hstack([left, panel])


def _camera(sample: Sample, camera: int, name: str) -> Image:
    """The image as it is with its boxes, above the same with LiDAR points."""
    scale = PANEL_WIDTH / sample.images.shape[2]
    view = {"cam_K": sample.cam_K[camera], "ego_T_cam": sample.ego_T_cam[camera], "scale": scale}
    size = (PANEL_WIDTH, round(sample.images.shape[1] * scale))
    boxed = cv2.resize(sample.images[camera], size, interpolation=cv2.INTER_CUBIC)
    dotted = (boxed * 0.6).astype(np.uint8)
    boxes_on_image(boxed, sample.boxes, color=BOX, **view)
    points_on_image(dotted, sample.lidar_points, radius=2, **view)
    _caption(boxed, f"{name}   {len(sample.boxes)} boxes")
    _caption(dotted, f"LiDAR by depth   {len(sample.lidar_points)} points")
    return np.vstack([boxed, dotted])


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


def _caption(image: Image, text: str) -> None:
    cv2.putText(image, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)


def main(arguments: list[str]) -> None:
    """Reads the arguments, draws, writes."""
    root = next((a for a in arguments if "=" not in a), None)
    given = dict(a.split("=", 1) for a in arguments if "=" in a)
    wrong = sorted(given.keys() - OPTIONS.keys())
    if root is None or wrong:
        raise ValueError(f"{f'unknown {wrong[0]}=; ' if wrong else ''}usage: ROOT [sample=N] [split=NAME] [out=PNG]")
    options = OPTIONS | given
    out = Path(options["out"])
    if out.suffix not in (".png", ".jpg"):
        raise ValueError(f"out={out} is no picture; end it with .png or .jpg")
    tree = NuScenes(root)
    tokens = tree.split(options["split"])
    if not options["sample"].isdecimal() or int(options["sample"]) >= len(tokens):
        raise ValueError(f"sample={options['sample']}: split {options['split']} has samples 0 to {len(tokens) - 1}")
    sample = SampleReader(label_stride=None).read(tree, tokens[int(options["sample"])])
    all_round = not len(sample.lidar_points) or (sample.lidar_points[:, 0] < -5).mean() > 0.1
    grid = BEVGrid(-50.0, 50.0, -50.0, 50.0, 1.0) if all_round else BEVGrid(-5.0, 60.0, -35.0, 35.0, 1.0)
    sheet = draw_sample(sample, channels=tree.channels("camera"), grid=grid)
    out.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(out), sheet[..., ::-1]):
        raise ValueError(f"out={out} could not be written")
    print(f"{out}: sample {options['sample']} of {len(tokens)}, scene {tree.scene(sample.token)['name']}")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except ValueError as error:
        sys.exit(f"lidar_check: {error}")
