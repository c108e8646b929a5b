"""A moving picture of one scene with its detections, in which a sensor dies and comes back.

The detector is the one that was trained; the dead sensor is missing from its ``present`` mask, and nothing else changes.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from omegaconf import DictConfig
from PIL import Image as Pillow

from fusion_net.common.checks import check_names
from fusion_net.common.drawing import Image, picture_file
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.data.samples import labelled_boxes
from fusion_net.evaluation.drop_table import Detector, predict
from fusion_net.models.precision import autocast
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import trained_of
from fusion_net.viz.animation.frame import Moment, draw_frame

FEWEST = 3
"""Keyframes of a scene: one before, one without and one after."""
HOLD = 4
"""The last frame stays so many times as long as the others."""


def animate(cfg: DictConfig) -> Path:
    """Writes the animation; returns its path. ValueError where there is no such scene or sensor."""
    trained = trained_of(cfg)
    sensors = list(trained.cfg.encoders)
    check_names("dies", [cfg.dies], sensors)
    if not 0 < cfg.fps <= 20:
        raise ValueError(f"fps={cfg.fps} must be above 0 and at most 20 keyframes a second; try fps=3")
    if not 2 <= cfg.colors <= 256:
        raise ValueError(f"colors={cfg.colors} is not within 2 to 256; try colors=128")
    path = picture_file(cfg.out, formats=(".gif",))
    dataset = open_samples(trained, split=cfg.split, root=cfg.data.root, version=cfg.data.version)
    scene, places = places_of(dataset, cfg.scene)
    with autocast(trained.cfg.trainer.precision):
        moments = watch(trained.model(), dataset, places, sensors=sensors, dies=cfg.dies, min_score=cfg.min_score)
    options = {"grid": dataset.grid, "dying": cfg.dies, "sensors": sensors}
    frames = [draw_frame(moments, now, min_score=cfg.min_score, **options) for now in range(len(moments))]
    write_gif(path, frames, fps=cfg.fps, colors=cfg.colors)
    print(f"{path}: {scene}, {len(frames)} keyframes, {path.stat().st_size / 1e6:.1f} MB")
    return path


def places_of(dataset: NuScenesDataset, scene: str | None) -> tuple[str, list[int]]:
    """A scene's name and the places of its samples in the order of time; without a name the scene with the most labels."""
    names: dict[str, list[int]] = {}
    for place, (nusc, token) in enumerate(dataset.index):
        names.setdefault(nusc.scene(token)["name"], []).append(place)
    if scene is None:
        scene = max(names, key=lambda name: sum(_labels(dataset, place) for place in names[name]))
    check_names("scene", [scene], list(names))
    places = sorted(names[scene], key=lambda place: _time(dataset, place))
    if len(places) < FEWEST:
        raise ValueError(
            f"scene={scene} has {len(places)} keyframes; {FEWEST} are needed, and python -m data_gen data=sequence makes"
            " scenes of 20"
        )
    return scene, places


def watch(
    model: Detector,
    dataset: NuScenesDataset,
    places: Sequence[int],
    *,
    sensors: Sequence[str],
    dies: str,
    min_score: float,
) -> list[Moment]:
    """What the detector finds in these samples; of the second third without the sensor that ``dies``."""
    samples = [dataset[place] for place in places]
    batches = [dataset.collate([sample]) for sample in samples]
    rest = tuple(sensor for sensor in sensors if sensor != dies)
    (sound, broken), _ = predict(model, batches, subsets=[sensors, rest], show=False)
    moments, start = [], _time(dataset, places[0])
    for number, (place, sample) in enumerate(zip(places, samples, strict=True)):
        is_dead = len(places) // 3 <= number < 2 * len(places) // 3
        found = (broken if is_dead else sound)[sample.token]
        alive = rest if is_dead else tuple(sensors)
        moments.append(Moment(sample, alive, found[found.score > min_score], _time(dataset, place) - start))
    return moments


def write_gif(path: Path, frames: Sequence[Image], *, fps: float, colors: int) -> None:
    """Frames (H, W, 3) of one size as an endless GIF with one palette, so that what stands still costs nothing."""
    palette = Pillow.fromarray(np.concatenate(frames[:: max(1, len(frames) // 6)])).quantize(colors)
    pages = [Pillow.fromarray(frame).quantize(palette=palette, dither=Pillow.Dither.NONE) for frame in frames]
    duration = [round(1000 / fps)] * len(pages)
    duration[-1] *= HOLD
    pages[0].save(path, save_all=True, append_images=pages[1:], duration=duration, loop=0, optimize=True)


def _labels(dataset: NuScenesDataset, place: int) -> int:
    nusc, token = dataset.index[place]
    return int(dataset.grid.contains(labelled_boxes(nusc, token, dataset.classes).center).sum())


def _time(dataset: NuScenesDataset, place: int) -> float:
    """Seconds of a sample's reference time."""
    nusc, token = dataset.index[place]
    return nusc.reference(token)["timestamp"] * 1e-6
