"""What it costs to start on a data set and to load a batch: ``python -m benchmarks.loading DATA [FOLDER] [KEYFRAMES ...]``.

DATA is a small generated data set. In FOLDER (else a temporary one) it is made larger: its scenes are repeated under other
tokens, their files linked. A process of its own each measures a first and a second start (tables, training and validation
data, labels of the latter, a batch of each) and its memory after 100 more batches: RSS counts the pages of mapped files, PSS
its part of those that several processes map, own memory is the rest. Then milliseconds of a batch of eight by stage on a core.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from hydra import compose, initialize_config_dir

from fusion_net.common.cli.command import CONFIGS, build
from fusion_net.data.augment import change_view
from fusion_net.data.datamodule import NuScenesDataset, StepSampler, collate
from fusion_net.data.targets import center_targets
from fusion_net.evaluation.scoring import ground_truth

SIZES = (3_700, 37_000)
"""Keyframes."""
OWN = ("log", "map", "scene", "sample", "sample_data", "ego_pose", "instance", "sample_annotation")
"""Tables of which each copy of a scene has records of its own."""
BATCH = 8
TOKEN = re.compile(r'"([0-9a-f]{32})"')


def enlarge(source: Path, target: Path, keyframes: int) -> None:
    """Writes a data set of at least ``keyframes``: the scenes of ``source``, again and again."""
    (tables,) = source.glob("v1.0-*")
    text_of = {name: (tables / f"{name}.json").read_text(encoding="utf-8")[1:-1] for name in OWN}
    own = {record["token"] for name in OWN for record in json.loads(f"[{text_of[name]}]")}
    copies = -(-keyframes // len(json.loads(f"[{text_of['sample']}]")))
    shutil.copytree(tables, target / tables.name, dirs_exist_ok=True)
    shutil.copy(source / "manifest.json", target)
    for name, text in text_of.items():
        text = re.sub(r'"((?:samples|sweeps)/\w+)/', r'"\1/@', text)
        text = text.replace('"name":"scene-', '"name":"@scene-')
        parts = TOKEN.split(text)
        parts[1::2] = [f'"{"@" + token[5:] if token in own else token}"' for token in parts[1::2]]
        pattern = "".join(parts)
        with (target / tables.name / f"{name}.json").open("w", encoding="utf-8") as file:
            file.write(f"[{','.join(pattern.replace('@', f'{copy:05x}') for copy in range(copies))}]")
    splits = json.loads((tables / "splits.json").read_text(encoding="utf-8"))
    many = {key: [f"{copy:05x}{name}" for copy in range(copies) for name in names] for key, names in splits.items()}
    (target / tables.name / "splits.json").write_text(json.dumps(many), encoding="utf-8")
    for path in (file for kind in ("samples", "sweeps") for file in source.glob(f"{kind}/*/*")):
        folder = target / path.parent.relative_to(source)
        folder.mkdir(parents=True, exist_ok=True)
        for copy in range(copies):
            os.link(path, folder / f"{copy:05x}{path.name}")


def open_sets(root: Path, cache: str) -> tuple[NuScenesDataset, NuScenesDataset]:
    """Training and validation samples as ``train.py`` opens them."""
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        cfg = compose("train", overrides=[f"data.root={root}", f"dataset.cache={cache}"])
    train = build(cfg.dataset.train)
    return train, build(cfg.dataset.val, datasets=train.datasets)


def start(root: Path, cache: str) -> dict[str, float]:
    """Seconds of a start in this process and its memory in MB after it, and after 100 batches."""
    begin, work = time.perf_counter(), time.process_time()
    train, val = open_sets(root, cache)
    train.has_labels()
    ground_truth(val)
    for data in (train, val):
        data.collate([data[0, place] for place in range(BATCH)])
    seconds, work = time.perf_counter() - begin, time.process_time() - work
    sampler = StepSampler(range(len(train)), batch_size=BATCH, steps=100)
    for keys in sampler:
        train.collate([train[key] for key in keys])
    return {"samples": len(train) + len(val), "seconds": seconds, "cpu_seconds": work} | memory()


def memory() -> dict[str, float]:
    """RSS, PSS and private memory of this process, MB."""
    text = Path("/proc/self/smaps_rollup").read_text(encoding="utf-8")
    kilobytes = {name: int(value) for name, value in re.findall(r"(\w+): +(\d+) kB", text)}
    return {name.lower(): kilobytes[name] / 1024 for name in ("Rss", "Pss", "Anonymous")}


def stages(root: Path) -> dict[str, float]:
    """Milliseconds of a batch of eight of cached samples, the median of 100."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    data, _ = open_sets(root, "disk")
    augment = data.augment
    assert augment is not None
    held = np.ones(2**24, np.uint8)  # what training frees in every step, after which malloc keeps memory of this size
    del held
    for place in range(len(data)):
        data[0, place]
    clock: dict[str, list[float]] = {}

    def timed(name: str, stage: Callable[[Any], Any], of: Any) -> Any:
        begin = time.process_time()
        result = stage(of)
        clock.setdefault(name, []).append(1e3 * (time.process_time() - begin))
        return result

    for step in range(100):
        rng = np.random.default_rng(step)
        keys = [(step, place) for place in rng.integers(len(data), size=BATCH).tolist()]
        samples = timed("read", lambda keys: [data.decoded(place) for _, place in keys], keys)
        views = [augment.random_view(rng) for _ in keys]
        samples = timed(
            "points and boxes",
            lambda pairs: [change_view(*pair) for pair in pairs],
            [*zip(samples, views, strict=True)],
        )
        batch = timed("collate", collate, samples)
        timed("targets", partial(center_targets, grid=data.grid, num_classes=len(data.classes)), batch.boxes)
        timed("batch", lambda keys: data.collate([data[key] for key in keys]), keys)
    return {name: float(np.median(values)) for name, values in clock.items()}


def _in_a_process(*arguments: str) -> dict[str, float]:
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.loading", *arguments], check=True, stdout=subprocess.PIPE, text=True
    )
    return json.loads(run.stdout.splitlines()[-1])


def main() -> None:
    """Print the tables and, last, one JSON object."""
    if sys.argv[1] == "start":
        return print(json.dumps(start(Path(sys.argv[2]), sys.argv[3])))
    if sys.argv[1] == "stages":
        return print(json.dumps(stages(Path(sys.argv[2]))))
    source = Path(sys.argv[1])
    figures: dict[str, Any] = {}
    print(f"{'':28}{'seconds':>10}{'CPU s':>8}{'RSS':>10}{'PSS':>10}{'own, MB':>12}")
    with tempfile.TemporaryDirectory() as temporary:
        for keyframes in map(int, sys.argv[3:] or SIZES):
            root = Path(sys.argv[2] if len(sys.argv) > 2 else temporary) / str(keyframes)
            if not root.exists():
                enlarge(source, root, keyframes)
            shutil.rmtree(root / ".cache", ignore_errors=True)
            for name, cache in (("first start", "disk"), ("second start", "disk"), ("no cache", "none")):
                each = figures[f"{keyframes} {name}"] = _in_a_process("start", str(root), cache)
                label = f"{keyframes} keyframes, {name}"
                print(
                    f"{label:32}{each['seconds']:6.1f}{each['cpu_seconds']:8.1f}{each['rss']:10.0f}{each['pss']:10.0f}{each['anonymous']:12.0f}"
                )
    figures["ms"] = _in_a_process("stages", str(source))
    print("\n".join(f"{name:20}{ms:8.2f} ms" for name, ms in figures["ms"].items()))
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
