"""Scores a run: its own settings and weights, every subset of sensors, tables and pictures beside it."""

import json
import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig
from torch.utils.data import DataLoader

from fusion_net.common.cli.command_line import as_override, job_folder
from fusion_net.common.cli.composed import composed
from fusion_net.data.datamodule import NuScenesDataset, make_loader
from fusion_net.evaluation import late_calibration
from fusion_net.evaluation.decoys import audit_decoys
from fusion_net.evaluation.drop_table import SUBSETS, DropTable, drop_table, predict
from fusion_net.evaluation.result_folder import result_folder
from fusion_net.evaluation.scoring import GroundTruth, ground_truth
from fusion_net.metrics.results import write_results
from fusion_net.models.encoders.camera_encoder import lift_by
from fusion_net.models.fusion_net import FusionNet, look_mirrored
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
from fusion_net.runs.run_dir import cut_short, environment
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import Trained, ship, trained_of
from fusion_net.viz.picture_sheet import picture_sheet

RESULTS = "results_nusc.json"


@dataclass(frozen=True)
class Evaluation:
    """One detector scored on one set of samples: what every table, picture and report of it is written from."""

    cfg: DictConfig
    trained: Trained
    changes: Mapping[str, str]
    """What of late fusion is other than it was trained: setting to value."""
    dataset: NuScenesDataset
    model: FusionNet | LateFusion
    truth: GroundTruth
    target: Path
    """The folder of its results."""

    @property
    def split(self) -> str:
        return self.cfg.split or self.trained.cfg.dataset.val.split

    @property
    def batches(self) -> DataLoader:
        return make_loader(self.dataset, batch_size=self.cfg.batch_size)

    @property
    def precision(self) -> AbstractContextManager[Any]:
        """That the detector was trained in."""
        return autocast(self.trained.cfg.trainer.precision)


def evaluate_run(cfg: DictConfig) -> None:
    """What ``eval.py`` does: prints the drop table and writes everything into a folder under RUN/eval; of a split without
    labels the result file alone."""
    check_evaluation(cfg)
    audits = chosen_audits(cfg.audits)
    trained, changes = adapted(_trained(cfg), cfg.late)
    dataset = open_samples(trained, split=cfg.split, root=cfg.data.root, version=cfg.data.version, fault=cfg.fault)
    model = _model(cfg, trained)
    target = _target(cfg, trained, dataset, changes)
    one = Evaluation(cfg, trained, changes, dataset, model, ground_truth(dataset), target)
    if not len(one.truth.labels):
        _write_predictions(one)
        return
    with one.precision:
        table = drop_table(model, one.batches, one.truth, seed=trained.cfg.seed, resamples=cfg.bootstrap)
    doc, files = _write_tables(one, table)
    if audits:
        _write_audits(one, table, audits)
        files += ["audits.md", "audits/"]
    if cfg.report:
        _write_report(one, table, doc)
        files = ["report.{html,json}", *files]
    print(f"\nwrote {target}/: {', '.join(files)}", file=sys.stderr)
    if cfg.ship:
        path = ship(Path(cfg.ship), trained, table=doc, manifests=[manifest(nusc.root) for nusc in dataset.datasets])
        print(f"wrote {path}: {path.stat().st_size / 1e6:.1f} MB", file=sys.stderr)
    if cfg.report:
        print(f"report: {target / REPORT}", flush=True)


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
        fault="+".join(_changed(cfg, dataset)),
        variant=job_folder([f"{key}={value}" for key, value in changes.items()]) if changes else "",
    )


def _changed(cfg: DictConfig, dataset: NuScenesDataset) -> list[str]:
    """What is done to the detector's inputs, depth or view, as parts of a folder's name."""
    fault = [f"{cfg.fault.name}_{cfg.fault.severity}"] if dataset.reader.faults else []
    depth = [f"depth_{cfg.depth_source}"] if cfg.depth_source else []
    return [*fault, *depth, *(["mirror_test"] if cfg.mirror_test else [])]


def _write_tables(one: Evaluation, table: DropTable) -> tuple[dict[str, Any], list[str]]:
    """The drop table, the decoys, the honesty of late fusion's covariances, the result files and pictures; the tables are
    printed. Returns the drop table's document and what was written."""
    target, truth, surroundings = one.target, one.truth, environment()
    doc = document(
        table,
        run=str(one.trained.folder),
        split=one.split,
        num_samples=len(one.dataset),
        seed=one.trained.cfg.seed,
        command=surroundings["command"],
        git=surroundings["git"],
    )
    if one.dataset.reader.faults:
        doc["fault"] = {"name": one.cfg.fault.name, "severity": one.cfg.fault.severity}
    if one.changes:
        doc["late"] = one.changes
    doc["notes"] += [*_notes(one), *of_scenes(len(set(truth.scenes)))]
    audit = audit_decoys(truth, one.dataset.index, table.tables)
    if audit:
        doc["decoys"] = audit
    write_drop_table(target, doc)
    write_result(target / Path(RESULT).name, _result(one, table, doc))
    decoys.write(target, audit)
    (target / "env.json").write_text(json.dumps(surroundings, indent=1) + "\n", encoding="utf-8")
    write_results(target / RESULTS, table.tables[0], tokens=truth.tokens, classes=one.dataset.classes)
    plot_drop_table(target / "drop_table.png", doc)
    picture_sheet(target / "pictures.png", one.dataset, table.found[0])
    print(as_text(doc))
    if audit:
        print(f"\n{decoys.as_text(audit)}")
    files = ["drop_table.{json,csv,md,png}", RESULTS, "pictures.png", *(["decoys.{csv,md}"] if audit else [])]
    return doc, [*files, *_write_honesty(one)]


def _result(one: Evaluation, table: DropTable, doc: dict[str, Any]) -> dict[str, Any]:
    """The small result that is committed and compared."""
    scored = {
        "checkpoint": one.trained.source.name,
        "data": one.dataset.fingerprint,
        "made_by": one.dataset.made_by,
        "scenes": len(set(one.truth.scenes)),
    }
    return run_result(one.trained.record, doc, table.resampled, scored=scored)


def _write_honesty(one: Evaluation) -> list[str]:
    """How honest the covariances of late fusion are; nothing of another model."""
    if not isinstance(one.model, LateFusion):
        return []
    with one.precision:
        late_report.write(one.target, late_calibration.report(one.model, one.batches, one.truth))
    return ["late_calibration.{json,md}"]


def _write_audits(one: Evaluation, table: DropTable, audits: Sequence[str]) -> None:
    """Each with a picture and a verdict, which is printed."""
    sound = one.target.parent if _changed(one.cfg, one.dataset) else None
    gate, resamples = one.cfg.audit_gate, one.cfg.bootstrap
    with one.precision:
        auditor = Auditor(
            one.target, one.model, one.dataset, one.truth, table, gate=gate, resamples=resamples, sound=sound
        )
        print("\n" + "\n".join(done.line for done in auditor.write(audits)))


def _write_report(one: Evaluation, table: DropTable, doc: dict[str, Any]) -> None:
    write_report(
        one.target,
        scored=Scored.of(one.truth, one.dataset.index, table),
        dataset=one.dataset,
        model=one.model,
        doc=doc,
        result=_result(one, table, doc),
        metrics=one.trained.folder / "metrics.csv",
        resamples=one.cfg.bootstrap,
    )


def _notes(one: Evaluation) -> list[str]:
    """What a reader of the table has to know: how the detector is other than it was to be trained, or was trained."""
    depth_source, changes = one.cfg.depth_source, one.changes
    notes = [f"the camera's features were lifted by depth_source={depth_source}"] if depth_source else []
    if one.cfg.mirror_test:
        notes.append("each scene was also seen mirrored, and the mean of both answers taken: mirror_test=true")
    if cut := cut_short(one.trained.record):
        notes.append(cut)
    if changes:
        notes.append("late fusion other than it was trained: " + ", ".join(f"{k}={v}" for k, v in changes.items()))
    return notes


def evaluate_finished(folder: Path) -> None:
    """What ``eval.py run=FOLDER`` does, from within another command."""
    evaluate_run(composed("eval", f"run={as_override(str(folder))}"))


def _trained(cfg: DictConfig) -> Trained:
    """The detector that is scored, with the weights that a file of shipped weights will hold where one is made."""
    trained = trained_of(cfg)
    if cfg.ship and trained.is_shipped:
        raise ValueError(f"ship={cfg.ship} ships a run; write run=runs/NAME")
    return trained.compact() if cfg.ship else trained


def _write_predictions(one: Evaluation) -> None:
    """The result file of all sensors together, of samples without labels."""
    with one.precision:
        (found,), _ = predict(one.model, one.batches, subsets=SUBSETS[:1])
    table = one.truth.table([found[token] for token in one.truth.tokens])
    one.target.mkdir(parents=True, exist_ok=True)
    write_results(one.target / RESULTS, table, tokens=one.truth.tokens, classes=one.truth.classes)
    root = one.cfg.data.root or one.trained.cfg.data.root
    why = _no_labels(one.dataset)
    print(f"split={one.split} of {root}: nothing to score against, {why}; wrote {one.target}/{RESULTS}")


def _no_labels(dataset: NuScenesDataset) -> str:
    """Why no label of a split counts."""
    labels = sum(len(nusc.annotations(token, dataset.classes)) for nusc, token in dataset.index)
    if not labels:
        return "it has no labels"
    return f"none of its {labels} labels is on the grid and in range and has a LiDAR or radar point"
