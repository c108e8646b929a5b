"""Scores a run: its own settings and weights, every subset of sensors, tables and pictures beside it."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from omegaconf import DictConfig
from torch import nn
from torch.utils.data import DataLoader

from fusion_net.common.checks import check_names
from fusion_net.common.cli.command import build
from fusion_net.common.cli.command_line import as_override, job_folder
from fusion_net.common.cli.composed import composed
from fusion_net.data.datamodule import NuScenesDataset, make_loader
from fusion_net.evaluation import late_calibration
from fusion_net.evaluation.decoys import audit_decoys
from fusion_net.evaluation.drop_table import SUBSETS, drop_table, predict
from fusion_net.evaluation.result_folder import is_same_data, result_folder
from fusion_net.evaluation.scoring import GroundTruth, ground_truth
from fusion_net.metrics.results import write_results
from fusion_net.models.encoders.camera_encoder import DEPTH_SOURCES, CameraEncoder
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.late.late_fusion import LateFusion
from fusion_net.models.precision import autocast
from fusion_net.nuscenes.tables import manifest
from fusion_net.reports import decoys
from fusion_net.reports.audits.run import Auditor, chosen_audits
from fusion_net.reports.evaluation import late_calibration as late_report
from fusion_net.reports.evaluation.figures import Scored
from fusion_net.reports.evaluation.page import REPORT, write_report
from fusion_net.reports.plots import plot_drop_table
from fusion_net.reports.run_result import RESULT, run_result, write_result
from fusion_net.reports.tables import as_text, document, of_scenes, write_drop_table
from fusion_net.runs.checks import check_evaluation
from fusion_net.runs.late import adapted
from fusion_net.runs.run_dir import cut_short, environment, refuse_other_data
from fusion_net.runs.trained import Trained, ship, trained_of, trained_run
from fusion_net.viz.picture_sheet import picture_sheet

RESULTS = "results_nusc.json"


def load_run(folder: Path, *, checkpoint: str = "best", **chosen: Any) -> tuple[FusionNet, NuScenesDataset, DictConfig]:
    """A run's model in evaluation mode, samples to show it (:func:`open_samples`), and the settings it was trained with."""
    trained = trained_run(folder, checkpoint)
    return trained.model(), open_samples(trained, **chosen), trained.cfg


def open_samples(
    trained: Trained,
    *,
    split: str | None = None,
    root: str | Sequence[str] | None = None,
    version: str | None = None,
    fault: DictConfig | None = None,
) -> NuScenesDataset:
    """The samples of a split with ``fault`` applied. ``split``, ``root`` and ``version`` are those that the detector was
    validated on where they are None; then the data must be what it was trained on."""
    cfg = trained.cfg
    settings = cfg.dataset.val.copy()
    own_version = cfg.data.get("version")
    is_own_data = (root is None or is_same_data(root, cfg.data.root)) and version in (None, own_version)
    settings.root = cfg.data.root if root is None else root
    is_clean = fault is None or fault.name == "none"
    settings.cache = "disk" if settings.cache == "disk" and is_clean else "none"  # each sample is read once
    settings.version = own_version if is_own_data else version
    settings.split = split or settings.split
    if fault is not None:
        settings.faults = fault
    dataset: NuScenesDataset = build(settings)
    if is_own_data:
        _check_data(trained, dataset)
    return dataset


def evaluate_run(cfg: DictConfig) -> None:
    """What ``eval.py`` does: prints the drop table and writes everything into a folder under RUN/eval; of a split without
    labels the result file alone."""
    check_evaluation(cfg)
    audits = chosen_audits(cfg.audits)
    trained, changes = adapted(_trained(cfg), cfg.late)
    dataset = open_samples(trained, split=cfg.split, root=cfg.data.root, version=cfg.data.version, fault=cfg.fault)
    model = trained.model()
    if cfg.audit_gate is not None and isinstance(model, LateFusion):
        raise ValueError(f"audit_gate={cfg.audit_gate}: late fusion is judged by its own gate; write late.gate=0.99")
    changed = [f"{cfg.fault.name}_{cfg.fault.severity}"] if dataset.reader.faults else []
    if cfg.depth_source:
        lift_by(model, cfg.depth_source)
        changed.append(f"depth_{cfg.depth_source}")
    own_split, own_root = trained.cfg.dataset.val.split, trained.cfg.data.root
    split, root = cfg.split or own_split, cfg.data.root or own_root
    target = result_folder(
        trained.folder,
        dataset.datasets,
        split=split,
        own_split=own_split,
        root=root,
        own_root=own_root,
        version=cfg.data.version,
        own_version=trained.cfg.data.get("version"),
        checkpoint="best" if trained.is_shipped else cfg.checkpoint,
        fault="+".join(changed),
        variant=job_folder([f"{key}={value}" for key, value in changes.items()]) if changes else "",
    )
    truth = ground_truth(dataset)
    batches = make_loader(dataset, batch_size=cfg.batch_size)
    with autocast(trained.cfg.trainer.precision):
        if not len(truth.labels):
            _write_predictions(target, model, batches, truth)
            print(f"split={split} of {root}: nothing to score against, {_no_labels(dataset)}; wrote {target}/{RESULTS}")
            return
        table = drop_table(model, batches, truth, seed=trained.cfg.seed, resamples=cfg.bootstrap)
        honesty = _honesty(model, batches, truth)
    surroundings = environment()
    doc = document(
        table,
        run=str(trained.folder),
        split=split,
        num_samples=len(dataset),
        seed=trained.cfg.seed,
        command=surroundings["command"],
        git=surroundings["git"],
    )
    if dataset.reader.faults:
        doc["fault"] = {"name": cfg.fault.name, "severity": cfg.fault.severity}
    if changes:
        doc["late"] = changes
    doc["notes"] += [*_notes(cfg, trained, changes), *of_scenes(len(set(truth.scenes)))]
    audit = audit_decoys(truth, dataset.index, table.tables)
    if audit:
        doc["decoys"] = audit
    write_drop_table(target, doc)
    scored = {
        "checkpoint": trained.source.name,
        "data": dataset.fingerprint,
        "made_by": dataset.made_by,
        "scenes": len(set(truth.scenes)),
    }
    result = run_result(trained.record, doc, table.resampled, scored=scored)
    write_result(target / Path(RESULT).name, result)
    decoys.write(target, audit)
    if honesty is not None:
        late_report.write(target, honesty)
    (target / "env.json").write_text(json.dumps(surroundings, indent=1) + "\n", encoding="utf-8")
    write_results(target / RESULTS, table.tables[0], tokens=truth.tokens, classes=dataset.classes)
    plot_drop_table(target / "drop_table.png", doc)
    picture_sheet(target / "pictures.png", dataset, table.found[0])
    print(as_text(doc))
    if audit:
        print(f"\n{decoys.as_text(audit)}")
    if audits:
        sound = target.parent if changed else None
        with autocast(trained.cfg.trainer.precision):
            auditor = Auditor(
                target, model, dataset, truth, table, gate=cfg.audit_gate, resamples=cfg.bootstrap, sound=sound
            )
            print("\n" + "\n".join(done.line for done in auditor.write(audits)))
    if cfg.report:
        write_report(
            target,
            scored=Scored.of(truth, dataset.index, table),
            dataset=dataset,
            model=model,
            doc=doc,
            result=result,
            metrics=trained.folder / "metrics.csv",
            resamples=cfg.bootstrap,
        )
    files = ["report.{html,json}"] if cfg.report else []
    files += ["drop_table.{json,csv,md,png}", RESULTS, "pictures.png", *(["decoys.{csv,md}"] if audit else [])]
    files += ["audits.md", "audits/"] if audits else []
    files += ["late_calibration.{json,md}"] if honesty is not None else []
    print(f"\nwrote {target}/: {', '.join(files)}", file=sys.stderr)
    if cfg.ship:
        manifests = [manifest(nusc.root) for nusc in dataset.datasets]
        path = ship(Path(cfg.ship), trained, table=doc, manifests=manifests)
        print(f"wrote {path}: {path.stat().st_size / 1e6:.1f} MB", file=sys.stderr)
    if cfg.report:
        print(f"report: {target / REPORT}", flush=True)


def _notes(cfg: DictConfig, trained: Trained, changes: Mapping[str, str]) -> list[str]:
    """What a reader of the table has to know: how the detector is other than it was to be trained, or was trained."""
    notes = [f"the camera's features were lifted by depth_source={cfg.depth_source}"] if cfg.depth_source else []
    if cut := cut_short(trained.record):
        notes.append(cut)
    if changes:
        notes.append("late fusion other than it was trained: " + ", ".join(f"{k}={v}" for k, v in changes.items()))
    return notes


def lift_by(model: nn.Module, depth_source: str) -> None:
    """Has a trained detector's camera lifted by other depths than it learned with, so that what they are worth shows."""
    check_names("depth_source", [depth_source], DEPTH_SOURCES)
    cameras = [part for part in model.modules() if isinstance(part, CameraEncoder)]
    if not cameras:
        raise ValueError(f"depth_source={depth_source}: this detector has no camera whose features are lifted")
    for camera in cameras:
        camera.depth_source = depth_source


def evaluate_finished(folder: Path) -> None:
    """What ``eval.py run=FOLDER`` does, from within another command."""
    evaluate_run(composed("eval", f"run={as_override(str(folder))}"))


def _trained(cfg: DictConfig) -> Trained:
    """The detector that is scored, with the weights that a file of shipped weights will hold where one is made."""
    trained = trained_of(cfg)
    if cfg.ship and trained.is_shipped:
        raise ValueError(f"ship={cfg.ship} ships a run; write run=runs/NAME")
    return trained.compact() if cfg.ship else trained


def _check_data(trained: Trained, dataset: NuScenesDataset) -> None:
    """A run's own data must be what it was trained on. Shipped weights may be scored on what a later generator made in the
    same place, but then it is said."""
    if not trained.is_shipped:
        refuse_other_data(trained.folder, dataset.fingerprint)
    elif not {*dataset.fingerprint} <= {*trained.record["data"]}:
        here, there = (", ".join(each[:12] for each in both) for both in (dataset.fingerprint, trained.record["data"]))
        print(
            f"warning: {trained.source.name} was trained on data of other settings (manifest {there}, here {here}): its"
            " scores differ, and scenes scored here may be among those it has seen",
            file=sys.stderr,
        )


def _write_predictions(target: Path, model: FusionNet, batches: DataLoader, truth: GroundTruth) -> None:
    """The result file of all sensors together."""
    (found,), _ = predict(model, batches, subsets=SUBSETS[:1])
    table = truth.table([found[token] for token in truth.tokens])
    target.mkdir(parents=True, exist_ok=True)
    write_results(target / RESULTS, table, tokens=truth.tokens, classes=truth.classes)


def _honesty(model: FusionNet | LateFusion, batches: DataLoader, truth: GroundTruth) -> dict[str, Any] | None:
    """How honest the covariances of late fusion are; None of another model."""
    return late_calibration.report(model, batches, truth) if isinstance(model, LateFusion) else None


def _no_labels(dataset: NuScenesDataset) -> str:
    """Why no label of a split counts."""
    labels = sum(len(nusc.annotations(token, dataset.classes)) for nusc, token in dataset.index)
    if not labels:
        return "it has no labels"
    return f"none of its {labels} labels is on the grid and in range and has a LiDAR or radar point"
