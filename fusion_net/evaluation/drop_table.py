"""The drop table: one trained model scored with every subset of its sensors, through the ``present`` mask alone."""

import sys
import time
from collections.abc import Iterable, Sequence, Sized
from dataclasses import dataclass
from statistics import median
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from fusion_net.common.boxes import Boxes
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import Batch
from fusion_net.evaluation.bootstrap import bootstrap_map, over_scenes, resample_scenes
from fusion_net.evaluation.random_guess import random_guess
from fusion_net.evaluation.scoring import GroundTruth
from fusion_net.metrics.detection import DetectionMetrics
from fusion_net.metrics.matching import TP_ERRORS
from fusion_net.metrics.sample_boxes import SampleBoxes
from fusion_net.models.threads import ThreadsBeside

SUBSETS = (
    ("camera", "lidar", "radar"), ("camera", "lidar"), ("camera", "radar"), ("lidar", "radar"), ("camera",), ("lidar",),
    ("radar",),
)  # fmt: skip
"""The rows of the table, always these and in this order."""
RESAMPLING_SEED = 0
"""Of the resampled scenes: not the run's own, so that the differences of two runs are paired too."""


class Detector(Protocol):
    """What is evaluated: early, mid or late fusion alike."""

    def __call__(self, batch: Batch, present: Tensor) -> Any:
        """Outputs of a batch with the sensors of ``present`` (B, M)."""

    def decode(self, outputs: Any) -> list[Boxes]:
        """Boxes of each sample in the reference ego frame."""


@dataclass(frozen=True)
class DropTable:
    """The rows as ``drop_table.json`` stores them, and the boxes behind them."""

    rows: list[dict[str, Any]]
    random: dict[str, Any]
    tables: list[SampleBoxes]  # of each row; the first is what results_nusc.json holds
    found: list[dict[str, Boxes]]  # of each row: predictions by token in the ego frame
    resampled: NDArray[np.float64]  # (rows, R) mAP of each row on each resample of the scenes


def drop_table(
    model: Detector,
    batches: Iterable[Batch],
    truth: GroundTruth,
    *,
    seed: int,
    resamples: int = 200,
    device: str = "cpu",
) -> DropTable:
    """Scores all subsets. ``batches`` hold every sample of ``truth`` once, in any order; each is read once and shown to the
    model seven times. All rows, and all models that are scored on the same data, are scored on the same ``resamples`` sets of
    resampled scenes: differences are paired. ``seed``: of the random guess."""
    found, milliseconds = predict(model, batches, device=device)
    missing = [token for token in truth.tokens if token not in found[0]]
    if missing:
        raise ValueError(
            f"drop table: no predictions for {len(missing)} of {len(truth.tokens)} samples, first {missing[0]}"
        )
    scenes = len(set(truth.scenes))
    copies = resample_scenes(truth.scenes, resamples=resamples, rng=np.random.default_rng(RESAMPLING_SEED))
    tables = [truth.table([boxes[token] for token in truth.tokens]) for boxes in found]
    chance = truth.table(random_guess(truth, rng=np.random.default_rng([seed, 1])))
    rows: list[dict[str, Any]] = []
    resampled: list[NDArray[np.float64]] = []
    for subset, table, ms in [*zip(SUBSETS, tables, milliseconds, strict=True), ((), chance, 0.0)]:
        matches = truth.matches(table)
        resampled.append(bootstrap_map(truth.metric, matches, copies))
        score = truth.metric.summarise(matches)
        row = {"sensors": list(subset)} | describe(score) | {"mAP_ci95": over_scenes(resampled[-1], scenes)}
        official = truth.official(table)
        row |= {"mAP_official": official.mAP, "NDS_official": official.NDS, "ms_per_sample": ms}
        first = rows[0] if rows else row
        row |= {"delta_mAP": row["mAP"] - first["mAP"]}
        row |= {"delta_mAP_ci95": over_scenes(resampled[-1] - resampled[0], scenes)}
        rows.append(row)
    return DropTable(rows[:-1], rows[-1], tables, found, np.stack(resampled[:-1]))


def describe(score: DetectionMetrics) -> dict[str, Any]:
    """The figures of a score by name; an error that no class defines is None."""
    errors = [None if np.isnan(error) else float(error) for error in score.mean_errors]
    return {
        "mAP": score.mAP,
        "NDS": score.NDS,
        **dict(zip(TP_ERRORS, errors, strict=True)),
        "AP": dict(zip(score.classes, score.class_ap.tolist(), strict=True)),
        "num_gt": dict(zip(score.classes, score.num_gt.tolist(), strict=True)),
    }


@torch.inference_mode()
def predict(
    model: Detector,
    batches: Iterable[Batch],
    *,
    subsets: Sequence[Sequence[str]] = SUBSETS,
    device: str = "cpu",
    show: bool = True,
) -> tuple[list[dict[str, Boxes]], list[float]]:
    """Boxes by token for each subset, and its milliseconds per sample (forward and decoding; the median over batches).
    ``show``: a bar or lines of progress, and a first pass of each subset that is not timed, since it sets things up. Beside
    other programs it takes fewer of torch's threads, with the same boxes to the bit."""
    found: list[dict[str, Boxes]] = [{} for _ in subsets]
    times: list[list[float]] = [[] for _ in subsets]
    with ThreadsBeside(watches=device == "cpu") as threads:
        for step, batch in enumerate(_progress(batches) if show else batches):
            batch = batch.to(device)
            for row, subset in enumerate(subsets):
                if step == 0 and show:
                    _timed(model, batch, subset, device=device)
                boxes, seconds = _timed(model, batch, subset, device=device)
                times[row].append(1e3 * seconds / batch.size)
                found[row].update(zip(batch.tokens, boxes, strict=True))
                if (change := threads.look()) and show:
                    tqdm.write(f"evaluation: {change}", file=sys.stderr)
    return found, [median(values) if values else 0.0 for values in times]


def _timed(model: Detector, batch: Batch, subset: Sequence[str], *, device: str) -> tuple[list[Boxes], float]:
    """Boxes of a batch's samples with these sensors alone, and how many seconds they took."""
    chosen = torch.tensor([name in subset for name in MODALITIES], device=device)
    start = _now(device)
    boxes = model.decode(model(batch, present=batch.present & chosen))
    return boxes, _now(device) - start


def _now(device: str) -> float:
    if device.startswith("cuda"):
        torch.cuda.synchronize()
    return time.perf_counter()


def _progress(batches: Iterable[Batch]) -> Iterable[Batch]:
    """A bar on a terminal, a line every tenth of the work elsewhere."""
    total = len(batches) if isinstance(batches, Sized) else None
    if sys.stderr.isatty():
        yield from tqdm(batches, total=total, unit="batch", desc="evaluate", ascii=True)
        return
    every = max(1, (total or 100) // 10)
    for step, batch in enumerate(batches, start=1):
        yield batch
        if step % every == 0 or step == total:
            print(f"evaluated {step}{f'/{total}' if total else ''} batches", flush=True)
