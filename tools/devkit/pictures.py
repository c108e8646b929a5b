"""A keyframe as the devkit draws it: every camera with boxes, LiDAR and radar over the map, LiDAR points in the image."""

from collections.abc import Iterator
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from nuscenes import NuScenes
from project import nuscenes_format

AXES_LIMIT = 40.0
"""Metres that the views from above reach."""


def draw(tree: NuScenes, sample: dict, out: Path) -> Iterator[Path]:
    """Writes one JPEG a view; yields the paths."""
    out.mkdir(parents=True, exist_ok=True)
    cameras = [channel for channel in sample["data"] if channel.startswith("CAM")]
    radars = [channel for channel in sample["data"] if channel.startswith("RADAR")]
    yield _cameras(tree, sample, cameras, out / "cameras.jpg")
    yield _points(tree, sample, cameras, out / "points.jpg")
    figure, axes = plt.subplots(1, 2, figsize=(11, 5.6), dpi=110, layout="constrained")
    for axis, channels, sweeps in zip(axes, ([nuscenes_format.REFERENCE], radars), (1, 3), strict=True):
        for channel in channels:
            tree.render_sample_data(
                sample["data"][channel], axes_limit=AXES_LIMIT, ax=axis, nsweeps=sweeps,
                underlay_map=channel == channels[0], verbose=False,
            )  # fmt: skip
        axis.set_title(channels[0] if sweeps == 1 else f"{len(channels)} radars, {sweeps} scans of each", fontsize=8)
        axis.axis("off")
    yield _save(figure, out / "above.jpg")
    scene = tree.get("scene", sample["scene_token"])
    place = tree.get("log", scene["log_token"])["location"]
    tree.explorer.render_egoposes_on_map(place, [scene["token"]])
    yield _save(plt.gcf(), out / "map.jpg", dpi=60)


def _cameras(tree: NuScenes, sample: dict, channels: list[str], path: Path) -> Path:
    figure, axes = _grid(tree, sample, channels)
    for channel, axis in zip(channels, axes, strict=False):
        tree.render_sample_data(sample["data"][channel], ax=axis, verbose=False)
        axis.set_title(channel, fontsize=8)
    return _save(figure, path)


def _points(tree: NuScenes, sample: dict, channels: list[str], path: Path) -> Path:
    figure, axes = _grid(tree, sample, channels)
    for channel, axis in zip(channels, axes, strict=False):
        tree.explorer.render_pointcloud_in_image(
            sample["token"], dot_size=1, camera_channel=channel, ax=axis, verbose=False
        )
        axis.set_title(f"{nuscenes_format.REFERENCE} in {channel}", fontsize=8)
    return _save(figure, path)


def _grid(tree: NuScenes, sample: dict, channels: list[str]):
    """Axes of the images' shape, three in a row."""
    first = tree.get("sample_data", sample["data"][channels[0]])
    columns = min(len(channels), 3)
    rows = -(-len(channels) // columns)
    width = 9.0 if columns == 1 else 4.0
    height = width * first["height"] / first["width"] + 0.25
    figure, axes = plt.subplots(
        rows, columns, figsize=(columns * width, rows * height), dpi=110, squeeze=False, layout="constrained"
    )
    for axis in axes.flat:
        axis.axis("off")
    return figure, axes.flat


def _save(figure, path: Path, dpi: int | None = None) -> Path:
    figure.savefig(path, dpi=dpi or "figure", pil_kwargs={"quality": 85})
    plt.close("all")
    return path
