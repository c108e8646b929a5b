"""Writes a scene as a recording for the Rerun viewer, with or without what a detector finds in it."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from omegaconf import DictConfig

from fusion_net.common.boxes import Boxes
from fusion_net.common.checks import check_names
from fusion_net.common.modalities import letters
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.evaluation.drop_table import SUBSETS, predict
from fusion_net.models.precision import autocast
from fusion_net.nuscenes.datasets import open_datasets, samples_of_split
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import Trained, trained_of
from fusion_net.viz.rerun_log.check import ROOT, shows_detections
from fusion_net.viz.rerun_log.readings import Scene


def record(cfg: DictConfig) -> Path:
    """Writes the recording; returns its path. ValueError where the scene or a sensor is not there."""
    found: Mapping[str, Sequence[Boxes]] = {}
    if shows_detections(cfg):
        trained = trained_of(cfg)
        subsets = subsets_of(cfg.subset, list(trained.cfg.encoders))
        dataset = open_samples(trained, split=cfg.split, root=cfg.data.root, version=cfg.data.version)
        scene = choose(dataset.index, cfg.scene, sweeps=cfg.sweeps)
        path = output(cfg.out, scene, overwrite=cfg.overwrite)
        found = detect(trained, dataset, scene, subsets, min_score=cfg.min_score)
    else:
        samples = samples_of_split(open_datasets(cfg.data.root or ROOT, cfg.data.version), cfg.split or "all")
        scene = choose(samples, cfg.scene, sweeps=cfg.sweeps)
        path = output(cfg.out, scene, overwrite=cfg.overwrite)
    from fusion_net.viz.rerun_log.recording import write_recording

    write_recording(path, scene, found, color=cfg.lidar_color)
    size, name = path.stat().st_size / 1e6, scene.record["name"]
    contents = f"{len(scene.tokens)} keyframes, {len(scene.readings)} readings"
    print(f"{path}: {name}, {contents}, {size:.1f} MB; open it with: rerun {path}")
    return path


def choose(samples: Sequence[tuple[NuScenes, str]], scene: str | int | None, *, sweeps: bool = True) -> Scene:
    """The scene of a split with this name or, from 0, in this place; without either the first."""
    tokens: dict[tuple[NuScenes, str], list[str]] = {}
    for nusc, token in samples:
        tokens.setdefault((nusc, nusc.scene(token)["token"]), []).append(token)
    scenes = [Scene(nusc, nusc.get("scene", key), own, sweeps) for (nusc, key), own in tokens.items()]
    names = [each.record["name"] for each in scenes]
    if scene is None or isinstance(scene, int):
        place = scene or 0
        if not 0 <= place < len(scenes):
            raise ValueError(f"scene={scene}: the split has scenes 0 to {len(scenes) - 1}")
        return scenes[place]
    if scene not in names:
        near = difflib.get_close_matches(scene, names, 1, 0.0)[0]
        raise ValueError(f"there is no scene={scene} in the split; did you mean {near}? There are {len(names)}")
    return scenes[names.index(scene)]


def output(out: str | None, scene: Scene, *, overwrite: bool) -> Path:
    """The file that is written, its folder made; without a name that of the scene, in the working folder."""
    path = Path(f"{scene.record['name']}.rrd" if out is None else out)
    if path.suffix != ".rrd":
        raise ValueError(f"out={out} is no recording; end it with .rrd")
    if path.exists() and not overwrite:
        raise ValueError(f"{path} exists; pass out=ANOTHER.rrd, or overwrite=true")
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def subsets_of(chosen: str | Sequence[str] | None, sensors: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """The sensors of each subset by its letters (C+L); without a choice all that the detector has."""
    known = {letters(subset): subset for subset in SUBSETS if {*subset} <= {*sensors}}
    names = [next(iter(known))] if chosen is None else [chosen] if isinstance(chosen, str) else list(chosen)
    check_names("subset", names, list(known))
    return {name: known[name] for name in names}


def detect(
    trained: Trained,
    dataset: NuScenesDataset,
    scene: Scene,
    subsets: Mapping[str, Sequence[str]],
    *,
    min_score: float,
) -> dict[str, list[Boxes]]:
    """What the detector finds in each keyframe, in its reference ego frame, with each subset; labels index CLASSES."""
    place_of = {token: place for place, (_, token) in enumerate(dataset.index)}
    batches = [dataset.collate([dataset[place_of[token]]]) for token in scene.tokens]
    with autocast(trained.cfg.trainer.precision):
        found, _ = predict(trained.model(), batches, subsets=list(subsets.values()), show=False)
    label = np.array([CLASSES.index(name) for name in dataset.classes])

    def kept(boxes: Boxes) -> Boxes:
        chosen = boxes[boxes.score > min_score]
        return replace(chosen, label=label[chosen.label])

    return {name: [kept(of[token]) for token in scene.tokens] for name, of in zip(subsets, found, strict=True)}
