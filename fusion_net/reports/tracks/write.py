"""Tracks of a run: scored against the labels, as tables, a picture and result files."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from omegaconf import DictConfig
from torch import Tensor

from fusion_net.common.cli.command import build
from fusion_net.common.cli.command_line import command_line
from fusion_net.common.cli.override_values import nearest
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.data.datamodule import NuScenesDataset, make_loader
from fusion_net.evaluation.bootstrap import over_scenes, resample_scenes
from fusion_net.evaluation.drop_table import RESAMPLING_SEED, predict
from fusion_net.evaluation.result_folder import result_folder
from fusion_net.evaluation.tracks.intervals import bootstrap_amota
from fusion_net.evaluation.tracks.sequences import fuse_scenes, track_scenes
from fusion_net.evaluation.tracks.truth import TrackTruth
from fusion_net.metrics.track_boxes import TrackBoxes
from fusion_net.metrics.track_results import write_tracks
from fusion_net.models.late.estimates import Estimates
from fusion_net.models.late.late_fusion import LateFusion, LateOutputs
from fusion_net.models.precision import autocast
from fusion_net.reports.tables import name_of, of_scenes
from fusion_net.reports.tracks.picture import busiest_scene, draw_tracks
from fusion_net.reports.tracks.table import NOTES, as_row, as_text, write_tables
from fusion_net.runs.checks import check_counts
from fusion_net.runs.environment import environment
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import Trained, trained_of

FUSED_TRACKS = "fused tracks"
"""Name of the row whose tracks are those of each sensor, fused; other rows are named by the sensors whose boxes they track."""


def report(cfg: DictConfig) -> Path:
    """Writes ``tracks.{md,json,png}`` and the result file of each set of tracks; returns their folder. Of a split without
    labels only the result files."""
    check_counts(cfg)
    trained = trained_of(cfg)
    root = trained.cfg.data.root if cfg.data.root is None else cfg.data.root
    dataset = open_samples(trained, split=cfg.split, root=root, version=cfg.data.version)
    truth = TrackTruth(dataset.index, classes=dataset.classes, grid=dataset.grid)
    _refuse_short_scenes(truth, cfg.min_keyframes, f"split={cfg.split} of {root}")
    scene = _scene_number(dataset, truth, cfg.scene)
    found = track_run(trained, dataset, truth, cfg)
    folder = _folder(trained, dataset, cfg, root)
    folder.mkdir(parents=True, exist_ok=True)
    for each in found:
        path = folder / f"tracks_nusc_{each.name.replace(' ', '_')}.json"
        write_tracks(path, each.tracks, tokens=truth.tokens, classes=truth.classes, sensors=each.sensors)
    if not len(truth.labels):
        print(
            f"split={cfg.split} of {root}: no labelled track on the grid to score against; wrote {folder}/tracks_nusc_*.json"
        )
        return folder
    rows = score_rows(found, truth, resamples=cfg.bootstrap)
    around = environment()
    about = {"run": str(trained.folder), "split": cfg.split, "num_scenes": len(set(truth.truth.scenes))}
    about |= {"num_samples": len(dataset), "seed": trained.cfg.seed, "command": around["command"], "git": around["git"]}
    doc = about | {"rows": rows, "notes": [*NOTES, *of_scenes(about["num_scenes"])]}
    write_tables(folder, doc)
    panels = {"labels": truth.labels} | {each.name: truth.on_grid(each.tracks) for each in found}
    draw_tracks(folder / "tracks.png", panels, truth.frames, scene=scene, global_T_ego=truth.truth.global_T_ego)
    print(as_text(doc))
    print(f"\nwrote {folder}/: tracks.{{md,json,png}}, tracks_nusc_*.json", file=sys.stderr)
    return folder


@dataclass(frozen=True)
class Found:
    """A row of the table: tracks that are reported, GLOBAL frame, and the sensors that they were found with."""

    name: str
    sensors: tuple[str, ...]
    tracks: TrackBoxes


def track_run(trained: Trained, dataset: NuScenesDataset, truth: TrackTruth, cfg: DictConfig) -> list[Found]:
    """Tracks of the boxes of all of the run's sensors together and of each alone, and those of each fused."""
    tracker = build(cfg.tracker, "tracker", classes=dataset.classes)
    measurements = build(cfg.measurements, "measurements")
    sensors = tuple(name for name in MODALITIES if name in trained.cfg.encoders)
    subsets = list(dict.fromkeys([sensors, *((name,) for name in sensors)]))
    with autocast(trained.cfg.trainer.precision):
        predicted, _ = predict(
            _with_covariances(trained.model()), make_loader(dataset, cfg.batch_size), subsets=subsets
        )
    lived = {
        subset: track_scenes(
            [boxes[token] for token in truth.tokens], subset, frames=truth.frames,
            global_T_ego=truth.truth.global_T_ego, tracker=tracker, measurements=measurements,
        )
        for subset, boxes in zip(subsets, predicted, strict=True)
    }  # fmt: skip
    rows = {name_of(subset): (subset, tracks) for subset, tracks in lived.items()}
    if len(sensors) > 1:
        apart = {name: lived[name,] for name in sensors}
        rows[FUSED_TRACKS] = sensors, fuse_scenes(apart, frames=truth.frames, fusion=build(cfg.fusion, "fusion"))
    return [Found(name, by, truth.table([tracker.shown(x) for x in tracks])) for name, (by, tracks) in rows.items()]


class KeepsCovariances:
    """Late fusion as a detector of estimates: its boxes keep the calibrated covariances that the measurements are."""

    def __init__(self, model: LateFusion) -> None:
        self.model = model

    def __call__(self, batch: Batch, present: Tensor) -> LateOutputs:
        """Outputs of a batch with the sensors of ``present`` (B, M)."""
        return self.model(batch, present=present)

    def decode(self, outputs: LateOutputs) -> list[Estimates]:
        """Estimates of each sample in the reference ego frame."""
        lists = self.model.estimates(outputs, with_truth=self.model.association == "oracle")
        return [self.model.fuse(each) for each in lists]


def _with_covariances(model: Any) -> Any:
    return KeepsCovariances(model) if isinstance(model, LateFusion) else model


def score_rows(found: Sequence[Found], truth: TrackTruth, *, resamples: int) -> list[dict[str, Any]]:
    """The rows of the table, all on the same resampled scenes."""
    copies = resample_scenes(truth.truth.scenes, resamples=resamples, rng=np.random.default_rng(RESAMPLING_SEED))
    of_scene = copies[:, np.unique(truth.frames.scene, return_index=True)[1]]
    rows: list[dict[str, Any]] = []
    resampled: list[NDArray[np.float64]] = []
    for each in found:
        print(f"scoring tracks of {each.name}", file=sys.stderr, flush=True)
        by_class = truth.correspondences(each.tracks)
        resampled.append(bootstrap_amota(truth.metric, by_class, of_scene))
        row = as_row(each.name, truth.metric.summarise(by_class), truth.official(each.tracks))
        intervals = {"AMOTA_ci95": resampled[-1], "delta_AMOTA_ci95": resampled[-1] - resampled[0]}
        rows.append(row | {name: over_scenes(values, of_scene.shape[1]) for name, values in intervals.items()})
    return rows


def _refuse_short_scenes(truth: TrackTruth, least: int, where: str) -> None:
    longest = int(np.bincount(truth.frames.scene).max(initial=0))
    if longest < least:
        raise ValueError(
            f"{where}: the longest scene has {longest} keyframes, too few to track (min_keyframes={least}); make scenes of"
            f" ten seconds: {command_line('-m data_gen', data='sequence')}"
        )


def _scene_number(dataset: NuScenesDataset, truth: TrackTruth, name: str | None) -> int:
    """Number of the scene that is drawn: the one of this name, or the one in which most moves."""
    if name is None:
        return busiest_scene(truth.labels, truth.frames)
    named = {nusc.scene(token)["name"]: nusc.scene(token)["token"] for nusc, token in dataset.index}
    if name not in named:
        raise ValueError(f"there is no scene={name} in the split; {nearest(name, list(named))}")
    return int(truth.frames.scene[truth.truth.scenes == named[name]][0])


def _folder(trained: Trained, dataset: NuScenesDataset, cfg: DictConfig, root) -> Path:
    own = trained.cfg
    where = {"split": cfg.split, "own_split": own.dataset.val.split, "root": root, "own_root": own.data.root}
    versions = {"version": cfg.data.version, "own_version": own.data.get("version")}
    return result_folder(trained.folder, dataset.datasets, checkpoint=cfg.checkpoint, **where, **versions) / "tracks"
