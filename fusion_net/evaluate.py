"""Scores a run with every subset of its sensors: which weights, on which samples, into which folder."""

import sys
from collections.abc import Mapping
from pathlib import Path

from omegaconf import DictConfig

from fusion_net.common.cli.command_line import as_override, job_folder
from fusion_net.common.cli.composed import composed
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.evaluation.drop_table import drop_table
from fusion_net.evaluation.result_folder import result_folder
from fusion_net.evaluation.scoring import ground_truth
from fusion_net.models.encoders.camera_encoder import lift_by
from fusion_net.models.fusion_net import FusionNet, look_mirrored
from fusion_net.models.late.late_fusion import LateFusion
from fusion_net.models.precision import autocast, device_of
from fusion_net.nuscenes.tables import manifest
from fusion_net.reports.audits.run import chosen_audits
from fusion_net.reports.evaluation.figures import Scored
from fusion_net.reports.evaluation.files import (
    Evaluation,
    changed_inputs,
    write_audits,
    write_predictions,
    write_tables,
)
from fusion_net.reports.evaluation.page import REPORT, write_report
from fusion_net.runs.checks import check_evaluation
from fusion_net.runs.late import adapted
from fusion_net.runs.run_dir import load_config
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import Trained, ship, trained_of


def evaluate_run(cfg: DictConfig) -> None:
    """What ``eval.py`` does: prints the drop table and writes everything into a folder under RUN/eval; of a split without
    labels the result file alone."""
    check_evaluation(cfg)
    audits = chosen_audits(cfg.audits)
    trained, changes = adapted(_trained(cfg), cfg.late)
    dataset = open_samples(trained, split=cfg.split, root=cfg.data.root, version=cfg.data.version, fault=cfg.fault)
    model, device = _model(cfg, trained), device_of(cfg.accelerator, setting="accelerator")
    target = _target(cfg, trained, dataset, changes)
    target.mkdir(parents=True, exist_ok=True)  # now: where that cannot be, nothing is scored for nothing
    one = Evaluation(cfg, trained, changes, dataset, model, ground_truth(dataset), target)
    if not len(one.truth.labels):
        write_predictions(one)
        return
    with autocast(trained.cfg.trainer.precision, device):
        seed, resamples = trained.cfg.seed, cfg.bootstrap
        table = drop_table(model.to(device), one.batches, one.truth, seed=seed, resamples=resamples, device=device)
    model.cpu()
    doc, result, files = write_tables(one, table)
    if audits:
        write_audits(one, table, audits)
        files += ["audits.md", "audits/"]
    if cfg.report:
        write_report(
            target,
            scored=Scored.of(one.truth, dataset.index, table),
            dataset=dataset,
            model=model,
            doc=doc,
            result=result,
            metrics=trained.folder / "metrics.csv",
            resamples=cfg.bootstrap,
        )
        files = ["report.{html,json}", *files]
    print(f"\nwrote {target}/: {', '.join(files)}", file=sys.stderr)
    if cfg.ship:
        path = ship(Path(cfg.ship), trained, table=doc, manifests=[manifest(nusc.root) for nusc in dataset.datasets])
        print(f"wrote {path}: {path.stat().st_size / 1e6:.1f} MB", file=sys.stderr)
    if cfg.report:
        print(f"report: {target / REPORT}", flush=True)


def evaluate_finished(folder: Path) -> None:
    """What ``eval.py run=FOLDER`` does, from within another command, on what the run was trained on."""
    accelerator = load_config(folder).trainer.accelerator
    evaluate_run(composed("eval", f"run={as_override(str(folder))}", f"accelerator={accelerator}"))


def _trained(cfg: DictConfig) -> Trained:
    """The detector that is scored, with the weights that a file of shipped weights will hold where one is made."""
    trained = trained_of(cfg)
    if cfg.ship and trained.is_shipped:
        raise ValueError(f"ship={cfg.ship} ships a run; write run=runs/NAME")
    return trained.compact() if cfg.ship else trained


def _model(cfg: DictConfig, trained: Trained) -> FusionNet | LateFusion:
    """The detector, its camera lifted as ``depth_source`` says, the scene seen as ``mirror_test`` does."""
    model = trained.model()
    if cfg.audit_gate is not None and isinstance(model, LateFusion):
        raise ValueError(f"audit_gate={cfg.audit_gate}: late fusion is judged by its own gate; write late.gate=0.99")
    if cfg.depth_source:
        lift_by(model, cfg.depth_source)
    if cfg.mirror_test:
        look_mirrored(model)
    return model


def _target(cfg: DictConfig, trained: Trained, dataset: NuScenesDataset, changes: Mapping[str, str]) -> Path:
    """The folder of the results, named by all that is other than the detector's own validation."""
    return result_folder(
        trained.folder,
        dataset.datasets,
        split=cfg.split or trained.cfg.dataset.val.split,
        own_split=trained.cfg.dataset.val.split,
        root=cfg.data.root or trained.cfg.data.root,
        own_root=trained.cfg.data.root,
        version=cfg.data.version,
        own_version=trained.cfg.data.get("version"),
        checkpoint="best" if trained.is_shipped else cfg.checkpoint,
        fault="+".join(changed_inputs(cfg, dataset)),
        variant=job_folder([f"{key}={value}" for key, value in changes.items()]) if changes else "",
    )
