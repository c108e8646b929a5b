"""Scores a run: its own settings and weights, every subset of sensors, tables and pictures beside it."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig
from torch.utils.data import DataLoader

from fusion_net.common.cli.command import build
from fusion_net.data.datamodule import NuScenesDataset, make_loader
from fusion_net.evaluation.decoys import audit_decoys
from fusion_net.evaluation.drop_table import SUBSETS, drop_table, predict
from fusion_net.evaluation.result_folder import is_same_data, result_folder
from fusion_net.evaluation.scoring import GroundTruth, ground_truth
from fusion_net.metrics.results import write_results
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.precision import autocast
from fusion_net.reports import decoys
from fusion_net.reports.plots import plot_drop_table
from fusion_net.reports.tables import as_text, document, write_drop_table
from fusion_net.run_dir import cut_short, environment, load_config, load_weights, refuse_other_data
from fusion_net.viz.picture_sheet import picture_sheet

RESULTS = "results_nusc.json"


def load_run(
    folder: Path,
    *,
    checkpoint: str = "best",
    split: str | None = None,
    root: str | Sequence[str] | None = None,
    version: str | None = None,
    fault: DictConfig | None = None,
) -> tuple[FusionNet, NuScenesDataset, DictConfig]:
    """A trained model in evaluation mode, the samples of a split with ``fault`` applied, and the settings it was trained
    with. ``split``, ``root`` and ``version`` are those that the run validated on where they are None."""
    cfg = load_config(folder)
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
    model = build(cfg.model, "model")
    load_weights(model, folder / "checkpoints" / f"{checkpoint}.ckpt")
    dataset = build(settings, "dataset")
    if is_own_data:
        refuse_other_data(folder, dataset.fingerprint)
    return model.eval(), dataset, cfg


def evaluate_run(cfg: DictConfig) -> None:
    """What ``eval.py`` does: prints the drop table and writes everything into a folder under RUN/eval; of a split without
    labels the result file alone."""
    for name in ("batch_size", "bootstrap"):
        if cfg[name] < 1:
            raise ValueError(f"{name}={cfg[name]} must be at least 1")
    folder = Path(cfg.run)
    model, dataset, trained = load_run(
        folder,
        checkpoint=cfg.checkpoint,
        split=cfg.split,
        root=cfg.data.root,
        version=cfg.data.version,
        fault=cfg.fault,
    )
    own_split, own_root = trained.dataset.val.split, trained.data.root
    split, root = cfg.split or own_split, cfg.data.root or own_root
    target = result_folder(
        folder,
        dataset.datasets,
        split=split,
        own_split=own_split,
        root=root,
        own_root=own_root,
        version=cfg.data.version,
        own_version=trained.data.get("version"),
        checkpoint=cfg.checkpoint,
        fault=f"{cfg.fault.name}_{cfg.fault.severity}" if dataset.reader.faults else "",
    )
    truth = ground_truth(dataset)
    batches = make_loader(dataset, batch_size=cfg.batch_size)
    with autocast(trained.trainer.precision):
        if not len(truth.labels):
            _write_predictions(target, model, batches, truth)
            print(f"split={split} of {root}: nothing to score against, {_no_labels(dataset)}; wrote {target}/{RESULTS}")
            return
        table = drop_table(model, batches, truth, seed=trained.seed, resamples=cfg.bootstrap)
    surroundings = environment()
    doc = document(
        table,
        run=str(folder),
        split=split,
        num_samples=len(dataset),
        seed=trained.seed,
        command=surroundings["command"],
        git=surroundings["git"],
    )
    if dataset.reader.faults:
        doc["fault"] = {"name": cfg.fault.name, "severity": cfg.fault.severity}
    if cut := cut_short(folder):
        doc["notes"].append(cut)
    audit = audit_decoys(truth, dataset.index, table.tables)
    if audit:
        doc["decoys"] = audit
    write_drop_table(target, doc)
    decoys.write(target, audit)
    (target / "env.json").write_text(json.dumps(surroundings, indent=1) + "\n", encoding="utf-8")
    write_results(target / RESULTS, table.tables[0], tokens=truth.tokens, classes=dataset.classes)
    plot_drop_table(target / "drop_table.png", doc)
    picture_sheet(target / "pictures.png", dataset, table.found[0])
    print(as_text(doc))
    if audit:
        print(f"\n{decoys.as_text(audit)}")
    files = ["drop_table.{json,csv,md,png}", RESULTS, "pictures.png", *(["decoys.{csv,md}"] if audit else [])]
    print(f"\nwrote {target}/: {', '.join(files)}", file=sys.stderr)


def _write_predictions(target: Path, model: FusionNet, batches: DataLoader, truth: GroundTruth) -> None:
    """The result file of all sensors together."""
    (found,), _ = predict(model, batches, subsets=SUBSETS[:1])
    table = truth.table([found[token] for token in truth.tokens])
    target.mkdir(parents=True, exist_ok=True)
    write_results(target / RESULTS, table, tokens=truth.tokens, classes=truth.classes)


def _no_labels(dataset: NuScenesDataset) -> str:
    """Why no label of a split counts."""
    labels = sum(len(nusc.annotations(token, dataset.classes)) for nusc, token in dataset.index)
    if not labels:
        return "it has no labels"
    return f"none of its {labels} labels is on the grid and in range and has a LiDAR or radar point"
