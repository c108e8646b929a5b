"""How well the image plane's class scores tell classes apart: ``python -m benchmarks.class_scores runs/NAME ...``

For each run, over the feature cells of its validation images: average precision of each class's score, and the error of
log-depth on objects. What the camera's own stage has learned, before any bird's-eye view:
``python train.py name=NAME trainer.camera_steps=900 trainer.camera_only_steps=0 trainer.fusion_steps=1`` trains that alone.
"""

import json
import sys
from pathlib import Path

import torch
from torch import Tensor

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.datamodule import make_loader
from fusion_net.models.precision import autocast
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import trained_run


def average_precision(score: Tensor, is_class: Tensor) -> float:
    """Mean over the true cells (M,) of the precision down to each of them, best score first."""
    hit = is_class[score.argsort(descending=True, stable=True)].double()
    precision = hit.cumsum(0) / torch.arange(1, len(hit) + 1)
    return float(precision[hit > 0].mean())


@torch.inference_mode()
def measure(folder: Path) -> tuple[dict[str, float], float]:
    """Average precision by class, and the mean absolute error of log-depth on objects."""
    trained = trained_run(folder, "last")
    samples, network = open_samples(trained), trained.model().image_network
    assert network is not None
    scores, labels, errors = [], [], []
    for batch in make_loader(samples, batch_size=16):
        seen = batch.present[:, MODALITIES.index("camera")]
        with autocast(trained.cfg.trainer.precision):
            found = network(batch)
        assert batch.class_map is not None
        assert batch.dense_depth is not None
        label, depth = batch.class_map[seen], batch.dense_depth[seen]
        scores.append(found.class_logits[seen].float().permute(0, 1, 3, 4, 2).flatten(0, 3))
        labels.append(label.flatten())
        on_object = (label >= 0) & (depth > 0)
        errors.append((found.log_depth[seen].float()[on_object] - depth[on_object].log()).abs())
    score, label = torch.cat(scores), torch.cat(labels)
    each = {name: average_precision(score[:, k], label == k) for k, name in enumerate(samples.classes)}
    return each, float(torch.cat(errors).mean())


def main() -> None:
    """One line a run, and last one JSON object."""
    found = {str(folder): measure(folder) for folder in map(Path, sys.argv[1:])}
    for folder, (each, error) in found.items():
        classes = ", ".join(f"{name} {value:.2f}" for name, value in each.items())
        print(f"{folder}: mean AP {sum(each.values()) / len(each):.3f}, log-depth {error:.3f}; {classes}")
    print(json.dumps({folder: {"AP": each, "log_depth": error} for folder, (each, error) in found.items()}))


if __name__ == "__main__":
    main()
