"""Ctrl-C, a signal, a full disk: one line, what was written stays, and the same command goes on."""

import errno
import signal
import time

import pytest
import torch

from tests.fixtures.typed_commands import DATA_GEN, TRAIN, press, run

CUT = ("trainer.camera_steps=30", "trainer.camera_only_steps=4", "trainer.fusion_steps=26", "trainer.save_every=7")


@pytest.fixture(scope="module")
def unbroken(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("unbroken")
    code, _, error = run([*TRAIN, f"data.root={data}", "name=cut", *CUT], folder)
    assert code == 0, error
    return folder / "runs/cut"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code", "workers"),
    [(signal.SIGINT, 130, 0), (signal.SIGTERM, 130, 1), (signal.SIGKILL, -signal.SIGKILL, 1)],
)
def test_a_run_that_is_ended_goes_on_to_the_same_weights(data, unbroken, tmp_path, number, code, workers):
    command = [*TRAIN, f"data.root={data}", "name=cut", *CUT, f"dataset.workers={workers}"]
    folder = tmp_path / "runs/cut"
    returned, error = press(number, command, tmp_path, once=(folder / "metrics.csv").exists)
    assert returned == code
    if number != signal.SIGKILL:
        assert error[-1] == "error: interrupted; add resume=true to the same command to go on"
    code, _, error = run([*command, "resume=true"], tmp_path)
    assert (code, error) == (0, "")
    assert (folder / "metrics.csv").read_text() == (unbroken / "metrics.csv").read_text()
    ours, theirs = (torch.load(each / "checkpoints/last.ckpt", weights_only=True) for each in (folder, unbroken))
    for weights in ("state_dict", "current_model_state"):  # averaged and plain
        assert all(torch.equal(value, ours[weights][name]) for name, value in theirs[weights].items())


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.0, 0.1, 1.5])
def test_ctrl_c_while_a_second_process_starts_is_one_line(data, tmp_path, seconds):
    command = [*TRAIN, f"data.root={data}", "name=two", "trainer.devices=2", *CUT]
    opened = tmp_path / "runs/two/config.yaml"
    returned, error = press(
        signal.SIGINT,
        command,
        tmp_path,
        once=lambda: opened.exists() and time.time() > opened.stat().st_mtime + seconds,
    )
    said = [line for line in error if line]
    assert (returned, said[-1]) == (130, "error: interrupted; add resume=true to the same command to go on")
    assert not [line for line in said if "Traceback" in line or "Error" in line]
    assert sum(line.startswith("error:") for line in said) == 1


@pytest.mark.slow
def test_ctrl_c_keeps_finished_scenes_and_generation_goes_on(tmp_path):
    root = tmp_path / "tree"
    command = [*DATA_GEN, "workers=2", "data.num_scenes=12", f"data.root={root}"]
    code, error = press(signal.SIGINT, command, tmp_path, once=lambda: len(list(root.glob("scenes/*.json"))) >= 2)
    assert code == 130
    assert error[-1].startswith("error: interrupted")
    assert not [line for line in error[:-1] if "data_gen" not in line and "compiling" not in line]
    kept = {path: path.stat().st_mtime_ns for path in root.glob("scenes/*.json")}
    assert 2 <= len(kept) < 12
    assert "half generated" in run([*TRAIN, f"data.root={root}"], tmp_path)[2]
    assert run(command, tmp_path)[0] == 0
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_keeps_finished_scenes(tmp_path):
    """The third point cloud finds no room."""
    root = tmp_path / "tree"
    code = f"""
import errno, sys
from data_gen.recording import writer
write, made = writer.write_lidar, []
def full(path, *rest, **more):
    made.append(path)
    if len(made) > 6:
        raise OSError({errno.ENOSPC}, "No space left on device", str(path))
    return write(path, *rest, **more)
writer.write_lidar = full
sys.argv = ["data_gen", "data=nano", "workers=1", "data.num_scenes=4", "data.root={root}"]
from data_gen.__main__ import main
main()
"""
    returned, _, error = run(["-c", code], tmp_path)
    last = error.replace("\r", "\n").strip().splitlines()[-1]
    assert returned == 1
    assert last.startswith("error: ")
    assert "No space left on device" in last
    assert len(list(root.glob("scenes/*.json"))) == 1
    assert not list(root.rglob("*.part"))
    assert run([*DATA_GEN, "data.num_scenes=4", f"data.root={root}"], tmp_path)[0] == 0
