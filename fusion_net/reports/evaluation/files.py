"""What an evaluation writes: tables, result, pictures, audits and report, and the notes that a reader of them needs."""

import json
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig
from torch.utils.data import DataLoader

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.datamodule import NuScenesDataset, make_loader
from fusion_net.evaluation import late_calibration
from fusion_net.evaluation.decoys import audit_decoys
from fusion_net.evaluation.drop_table import SUBSETS, DropTable, predict
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.metrics.results import write_results
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.late.late_fusion import LateFusion
from fusion_net.models.precision import autocast, device_of
from fusion_net.reports import decoys
from fusion_net.reports.audits.run import Auditor
from fusion_net.reports.evaluation import late_calibration as late_report
from fusion_net.reports.plots import plot_drop_table
from fusion_net.reports.run_result import RESULT, run_result, write_result
from fusion_net.reports.tables import as_text, document, of_scenes, write_drop_table
from fusion_net.runs.environment import environment
from fusion_net.runs.run_dir import cut_short
from fusion_net.runs.trained import Trained
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


def changed_inputs(cfg: DictConfig, dataset: NuScenesDataset) -> list[str]:
    """What is done to the detector's inputs, depth or view, as parts of a folder's name."""
    fault = [f"{cfg.fault.name}_{cfg.fault.severity}"] if dataset.reader.faults else []
    depth = [f"depth_{cfg.depth_source}"] if cfg.depth_source else []
    return [*fault, *depth, *(["mirror_test"] if cfg.mirror_test else [])]


def write_tables(one: Evaluation, table: DropTable) -> tuple[dict[str, Any], dict[str, Any], list[str]]:
    """The drop table, the decoys, the honesty of late fusion's covariances, the result files and pictures; the tables are
    printed. Returns what drop_table.json and result.json hold, and what was written."""
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
    result = _result(one, table, doc)
    write_result(target / Path(RESULT).name, result)
    decoys.write(target, audit)
    (target / "env.json").write_text(json.dumps(surroundings, indent=1) + "\n", encoding="utf-8")
    write_results(target / RESULTS, table.tables[0], tokens=truth.tokens, classes=one.dataset.classes)
    plot_drop_table(target / "drop_table.png", doc)
    picture_sheet(target / "pictures.png", one.dataset, table.found[0])
    print(as_text(doc))
    if audit:
        print(f"\n{decoys.as_text(audit)}")
    files = ["drop_table.{json,csv,md,png}", RESULTS, "pictures.png", *(["decoys.{csv,md}"] if audit else [])]
    return doc, result, [*files, *_write_honesty(one)]


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


def write_audits(one: Evaluation, table: DropTable, audits: Sequence[str]) -> None:
    """Each with a picture and a verdict, which is printed."""
    sound = one.target.parent if changed_inputs(one.cfg, one.dataset) else None
    gate, resamples = one.cfg.audit_gate, one.cfg.bootstrap
    with one.precision:
        auditor = Auditor(
            one.target, one.model, one.dataset, one.truth, table, gate=gate, resamples=resamples, sound=sound
        )
        print("\n" + "\n".join(done.line for done in auditor.write(audits)))


def _notes(one: Evaluation) -> list[str]:
    """What a reader of the table has to know: how the detector is other than it was to be trained, or was trained."""
    depth_source, changes = one.cfg.depth_source, one.changes
    notes = [f"the camera's features were lifted by depth_source={depth_source}"] if depth_source else []
    if one.cfg.mirror_test:
        notes.append("each scene was also seen mirrored, and the mean of both answers taken: mirror_test=true")
    if device_of(one.cfg.accelerator, setting="accelerator") == "cuda":
        notes.append("the boxes were found on a GPU, whose milliseconds these are")
    if unread := [name for name in MODALITIES if name not in one.trained.cfg.encoders]:
        notes.append(f"the network is built without {' and '.join(unread)}: rows with and without them are the same")
    if cut := cut_short(one.trained.record):
        notes.append(cut)
    if changes:
        notes.append("late fusion other than it was trained: " + ", ".join(f"{k}={v}" for k, v in changes.items()))
    return notes


def write_predictions(one: Evaluation) -> None:
    """The result file of all sensors together, of samples without labels."""
    with one.precision:
        (found,), _ = predict(one.model, one.batches, subsets=SUBSETS[:1])
    table = one.truth.table([found[token] for token in one.truth.tokens])
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
