"""Scores a run: its own settings and weights, every subset of sensors, tables and pictures beside it."""

import json
import sys
from pathlib import Path

from omegaconf import DictConfig

from fusion_net.cli import build
from fusion_net.data.datamodule import NuScenesDataset, make_loader
from fusion_net.evaluation.decoys import audit_decoys
from fusion_net.evaluation.drop_table import drop_table
from fusion_net.evaluation.scoring import ground_truth
from fusion_net.metrics.results import write_results
from fusion_net.models.fusion_net import FusionNet
from fusion_net.reports import decoys
from fusion_net.reports.plots import plot_drop_table
from fusion_net.reports.tables import as_text, document, write_drop_table
from fusion_net.run_dir import environment, load_config, load_weights, refuse_other_data
from fusion_net.training.precision import autocast
from fusion_net.viz.picture_sheet import picture_sheet


def load_run(
    folder: Path,
    *,
    checkpoint: str = "best",
    split: str = "val",
    root: str | None = None,
    fault: DictConfig | None = None,
) -> tuple[FusionNet, NuScenesDataset, DictConfig]:
    """A trained model in evaluation mode, the samples of a split, spoiled by ``fault``, and the settings it was trained
    with."""
    cfg = load_config(folder)
    if root is not None:
        cfg.data.root = root
    reader = cfg.reader.val
    reader.root, reader.split, reader.cache = cfg.data.root, split, False
    if fault is not None:
        reader.faults = fault
    model = build(cfg.model, "model")
    load_weights(model, folder / "checkpoints" / f"{checkpoint}.ckpt")
    dataset = build(reader, "reader")
    if root is None:
        refuse_other_data(folder, dataset.fingerprint)
    return model.eval(), dataset, cfg


def evaluate_run(cfg: DictConfig) -> None:
    """What ``eval.py`` does: prints the drop table and writes everything under RUN/eval."""
    for name in ("batch_size", "bootstrap"):
        if cfg[name] < 1:
            raise ValueError(f"{name}={cfg[name]} must be at least 1")
    folder = Path(cfg.run)
    model, dataset, trained = load_run(
        folder, checkpoint=cfg.checkpoint, split=cfg.split, root=cfg.data.root, fault=cfg.fault
    )
    if not len(dataset):
        raise ValueError(
            f"split={cfg.split} of {dataset.trees[0].root} has no samples; pass another split or data.root"
        )
    truth = ground_truth(dataset)
    batches = make_loader(dataset, batch_size=cfg.batch_size)
    with autocast(trained.trainer.precision):
        table = drop_table(model, batches, truth, seed=trained.seed, resamples=cfg.bootstrap)
    surroundings = environment()
    doc = document(
        table,
        run=str(folder),
        split=cfg.split,
        num_samples=len(dataset),
        seed=trained.seed,
        command=surroundings["command"],
        git=surroundings["git"],
    )
    audit = audit_decoys(truth, dataset.index, table.tables)
    if audit:
        doc["decoys"] = audit
    target = folder / "eval"
    if dataset.reader.faults:
        doc["fault"] = {"name": cfg.fault.name, "severity": cfg.fault.severity}
        target /= f"{cfg.fault.name}_{cfg.fault.severity}"
    write_drop_table(target, doc)
    decoys.write(target, audit)
    (target / "env.json").write_text(json.dumps(surroundings, indent=1) + "\n")
    write_results(target / "results_nusc.json", table.tables[0], tokens=truth.tokens, classes=dataset.classes)
    plot_drop_table(target / "drop_table.png", doc)
    picture_sheet(target / "pictures.png", dataset, table.found[0])
    print(as_text(doc))
    if audit:
        print(f"\n{decoys.as_text(audit)}")
    files = [
        "drop_table.{json,csv,md,png}",
        "results_nusc.json",
        "pictures.png",
        *(["decoys.{csv,md}"] if audit else []),
    ]
    print(f"\nwrote {target}/: {', '.join(files)}", file=sys.stderr)
