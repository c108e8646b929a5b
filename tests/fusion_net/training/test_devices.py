"""Several processes that train together, and the devices that they may name."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from fusion_net.data.datamodule import StepSampler
from fusion_net.fit import fit
from tests.fixtures import train_with_records
from tests.fixtures.training_setup import SMALL, settings, write_data

STEPS = [
    "trainer.camera_steps=2", "trainer.camera_only_steps=1", "trainer.fusion_steps=3", "trainer.validate_every=2",
    "trainer.save_every=2", "modality_dropout=0.5", "trainer.dropout_from=0.2",
]  # fmt: skip


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_data(tmp_path_factory.mktemp("data") / "tree")


def train(folder: Path, data: Path, *overrides: str) -> subprocess.CompletedProcess:
    """``train.py`` in a folder, with small numbers."""
    command = [sys.executable, train_with_records.__file__, f"data.root={data}", *SMALL, *STEPS, *overrides]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    return subprocess.run(
        command, cwd=folder, env=environment, text=True, capture_output=True, timeout=240, check=False
    )


@pytest.fixture(scope="module")
def two_processes(data, tmp_path_factory) -> tuple[Path, subprocess.CompletedProcess]:
    folder = tmp_path_factory.mktemp("two")
    return folder, train(folder, data, "name=two", "trainer.devices=2", "trainer.strategy=ddp", "trainer.batch_size=2")


@pytest.mark.slow
def test_two_processes_train_one_network_on_different_samples(two_processes):
    folder, done = two_processes
    assert done.returncode == 0, done.stderr
    first, second = (torch.load(folder / f"{rank}.pt", weights_only=True) for rank in (0, 1))
    assert len(first["tokens"]) == len(second["tokens"]) == 6
    for one, other in zip(first["tokens"], second["tokens"], strict=True):
        assert len({*one, *other}) == 4  # two for each, none for both
    assert first["weights"].keys() == second["weights"].keys()
    for name, weights in first["weights"].items():
        assert torch.equal(weights, second["weights"][name]), name


@pytest.mark.slow
def test_only_the_first_process_writes_and_speaks(two_processes):
    folder, done = two_processes
    run = folder / "runs" / "two"
    assert {path.name for path in folder.iterdir()} == {"runs", "0.pt", "1.pt"}
    assert {path.name for path in run.iterdir()} == {
        ".lock",
        "config.yaml",
        "env.json",
        "metrics.csv",
        "checkpoints",
        "tb",
    }
    assert len(list((run / "tb").glob("events*"))) == 1
    with (run / "metrics.csv").open(encoding="utf-8") as file:
        rows = [(row["step"], row["name"]) for row in csv.DictReader(file)]
    assert rows
    assert len(rows) == len(set(rows))
    assert done.stdout.count("M parameters") == done.stdout.count("score it with") == 1


@pytest.mark.slow
def test_two_processes_take_the_mean_of_the_gradients_of_their_halves(two_processes):
    """In every stage. It is not quite the gradient of the whole batch in one process: each half has its own statistics in the
    batch norms and its own number of objects in the losses."""
    first, second = (torch.load(two_processes[0] / f"{rank}.pt", weights_only=True) for rank in (0, 1))
    for own, other, given, same in zip(first["own"], second["own"], first["given"], second["given"], strict=True):
        assert given.keys() == own.keys() | other.keys()
        size = torch.stack([gradient.abs().max() for gradient in given.values()]).max()
        for name, gradient in given.items():
            halves = [part.get(name, torch.zeros_like(gradient)) for part in (own, other)]
            torch.testing.assert_close(gradient, (halves[0] + halves[1]) / 2, rtol=1e-4, atol=1e-6 * size)
            assert torch.equal(gradient, same[name])


@pytest.mark.slow
def test_two_processes_are_resumed(data, tmp_path):
    first = train(tmp_path, data, "name=a", "trainer.devices=2", "trainer.fusion_steps=1")
    assert first.returncode == 0, first.stderr
    again = train(tmp_path, data, "name=a", "trainer.devices=2", "trainer.fusion_steps=1", "resume=true")
    assert again.returncode == 0, again.stderr
    state = torch.load(tmp_path / "runs/a/checkpoints/last.ckpt", weights_only=True)
    assert state["global_step"] in (4, 6)


def test_ranks_share_a_batch_without_overlap(monkeypatch):
    whole = list(StepSampler(range(23), batch_size=6, steps=9, seed=3))
    monkeypatch.setattr(torch.distributed, "get_rank", lambda: rank)
    parts = []
    for rank in (0, 1, 2):  # noqa: B007
        parts.append(list(StepSampler(range(23), batch_size=6, steps=9, seed=3, ranks=3)))
    for batch, *shared in zip(whole, *parts, strict=True):
        assert [len(part) for part in shared] == [2, 2, 2]
        assert sorted(key for part in shared for key in part) == sorted(batch)
    assert np.unique([place for batch in whole[:3] for _, place in batch]).size == 18


@pytest.mark.parametrize(
    ("override", "answer"),
    [
        ("trainer.devices=0", "trainer.devices=0 is not a number of devices; -1 takes every one"),
        ("trainer.strategy=dpp", "unknown strategy of trainer.strategy 'dpp'; did you mean 'ddp'"),
        ("trainer.accelerator=cuda", "unknown trainer.accelerator 'cuda'; did you mean 'cpu'"),
        ("trainer.devices=6", "9 training samples are fewer than trainer.batch_size=2 on each of 6 devices"),
    ],
)
def test_devices_that_cannot_be_are_refused_before_anything_is_written(data, tmp_path, monkeypatch, override, answer):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=answer):
        fit(settings(data, override))
    assert not (tmp_path / "runs").exists()


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_refused(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="there is no GPU here"):
        fit(settings(data, "trainer.accelerator=gpu"))
