"""The commands as a user types them: a mistake is one line on stderr and a non-zero exit, what was written stays."""

import errno
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from fusion_net.common.cli.command_line import as_override
from tests.fixtures.warm_python import WarmPython

PROJECT = Path(__file__).resolve().parents[1]
ENVIRONMENT = os.environ | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
ASSET_SHEET = ["-m", "data_gen.pictures.asset_sheet"]
DATA_GEN = ["-m", "data_gen", "data=nano", "workers=1"]
SHEET, PREVIEW = ["-m", "data_gen.pictures.contact_sheet"], ["-m", "data_gen.pictures.rig_preview"]
ABLATION, COMPARE = ["-m", "fusion_net.reports.ablation"], ["-m", "fusion_net.reports.compare"]
TRACKS, PAINTING = ["-m", "fusion_net.reports.tracks"], ["-m", "fusion_net.viz.painting"]
ANIMATION, RERUN_LOG = ["-m", "fusion_net.viz.animation"], ["-m", "fusion_net.viz.rerun_log"]
STATISTICS, LIDAR_CHECK = ["-m", "fusion_net.reports.statistics"], ["-m", "fusion_net.viz.lidar_check"]
ANY_DATA = f"data.root={PROJECT / 'configs'}"
"""A folder that is there, of which nothing is read before a model is built."""
TRAIN, EVAL = [str(PROJECT / "train.py"), "trainer=smoke"], [str(PROJECT / "eval.py")]


def start(arguments, folder):
    """A command in a session of its own, so that Ctrl-C reaches it and its workers and nobody else."""
    return subprocess.Popen(
        [sys.executable, *arguments], cwd=folder, env=ENVIRONMENT, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip


def run(arguments, folder):
    """Exit code, stdout and stderr."""
    command = start(arguments, folder)
    out, error = command.communicate(timeout=240)
    return command.returncode, out, error


def advised(printed):
    """The arguments of each command that was printed, as a shell reads them."""
    lines = re.findall(r"python (.+)", printed)
    return [[str(PROJECT / word) if word.endswith(".py") else word for word in shlex.split(line)] for line in lines]


def press(number, arguments, folder, *, once):
    """Starts a command, sends it and its workers a signal when ``once()`` holds; exit code and the lines of stderr."""
    command = start(arguments, folder)
    began = time.monotonic()
    while not once() and command.poll() is None and time.monotonic() - began < 200:
        time.sleep(0.05)
    os.killpg(command.pid, number)
    error = command.communicate(timeout=60)[1]
    return command.returncode, error.replace("\r", "\n").strip().splitlines()


@pytest.fixture(scope="module")
def warm():
    """For commands that refuse or only tell; whatever trains, generates or is interrupted gets a Python of its own."""
    reports = ("statistics", "tracks.write", "compare.write", "ablation.write")
    modules = ("data_gen.generate", "data_gen.pictures.contact_sheet", "fusion_net.fit", "fusion_net.evaluate")
    modules += tuple(f"fusion_net.reports.{name}" for name in reports)
    python = WarmPython(imports=modules, environment=ENVIRONMENT)
    yield python
    python.close()


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    root = tmp_path_factory.mktemp("data") / "tree"
    code, _, error = run([*DATA_GEN, "data.num_scenes=12", f"data.root={root}"], root.parent)
    assert code == 0, error
    return root


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory):
    """A folder with runs/base."""
    folder = tmp_path_factory.mktemp("work")
    code, _, error = run([*TRAIN, f"data.root={data}", "name=base"], folder)
    assert code == 0, error
    return folder


MISTAKES = [
    (TRAIN, "trainer.batch_sise=4", "did you mean trainer.batch_size"),
    (TRAIN, "trainer.batch_size=abc", "trainer.batch_size=abc is not a whole number; the default is 2"),
    (TRAIN, "encoders=camera", "write 'encoders=[camera]'"),
    (TRAIN, "grid=nanoo", "did you mean nano?"),
    (TRAIN, "data.root=nowhere", "no data in nowhere; make some: python -m data_gen data=nano data.root=nowhere"),
    (EVAL, "rum=runs/base", "did you mean run?"),
    (EVAL, "split=val", "run is needed; write run=runs/NAME, or take shipped weights: checkpoint=nano"),
    (EVAL, "checkpoint=nanoo", "no shipped weights nanoo; did you mean nano?"),
    (EVAL, "checkpoint=nan", "no shipped weights nan; did you mean nano?"),
    (EVAL, "run=a ship=a.ckpt", "ship=a.ckpt is no file of weights; end it with .pt"),
    (TRAIN, "init=nanoo", "init=nanoo: no shipped weights nanoo; did you mean nano?"),
    (ABLATION, "runs/sweeps/none", "no job of a sweep in runs/sweeps/none"),
    (ABLATION, "collect=true", "folder is needed; write folder=VALUE"),
    (COMPARE, "runs/mine", "name two runs at least"),
    (COMPARE, "runs/a runs/b", "no run at runs/a; train it: python train.py name=a"),
    (COMPARE, "run=runs/a", "does not read 'run'"),
    (EVAL, "run=runs/nothing", "no run at runs/nothing"),
    (DATA_GEN, "data.num_scenes=0", "num_scenes=0"),
    (DATA_GEN, "data=sequence data.keyframes=300", "keyframes=300 last 151 s; a scene has time for 100 s"),
    (TRACKS, "split=val", "run is needed; write run=runs/NAME, or take shipped weights: checkpoint=nano"),
    (TRACKS, "run=runs/nothing", "no run at runs/nothing"),
    (DATA_GEN, "seed=abc", "seed=abc is not a whole number"),
    (DATA_GEN, "workers=-1", "workers=-1 is not a number of processes"),
    (DATA_GEN, "rig=nanoo", "did you mean nano?"),
    (ASSET_SHEET, "kinds=[cra]", "kinds: there is no 'cra'; there are car"),
    (ASSET_SHEET, "out=cars.txt kinds=[car]", "out=cars.txt is no picture; end it with .png"),
    (DATA_GEN, "rig=surond", "did you mean surround?"),
    (DATA_GEN, "lidar=vlp32", "there is no lidar=vlp32; did you mean vlp16"),
    (DATA_GEN, "lidar=vlp16 lidar.max_range=-1.0", "lidar.max_range=-1.0 is less than 1"),
    (DATA_GEN, "lidar=vlp16 fault=lidar_beams", "keep=16 takes no beam from LIDAR_TOP, which has 16; use 1 to 15"),
    (DATA_GEN, "condition=fogg", "did you mean fog?"),
    (DATA_GEN, "condition=fog condition.severity=7", "severities are 1 to 3, or null for any"),
    (
        DATA_GEN,
        "condition=day_night condition.weights={fogg:1}",
        "unknown key 'fogg' in condition.weights; there are clear, night",
    ),
    (
        DATA_GEN,
        "condition=day_night +condition.weights.fogg=1",
        "weights name 'fogg', but the presets are clear, night",
    ),
    (DATA_GEN, "shard=5/4", "shard=5/4: the first number runs from 1 to the second"),
    (DATA_GEN, "shard=a/b", "shard=a/b is not NUMBER/COUNT, such as shard=3/64"),
    (DATA_GEN, "data.num_scenes=4 shard=1/8", "4 scenes fill at most 4 shards"),
    (DATA_GEN, "data.root=/proc/nowhere", "cannot write to data.root=/proc/nowhere"),
    (DATA_GEN, "data.root=[a,b]", "root=['a', 'b'] is not of type str"),
    (TRAIN, "sweep=seeds", "write +sweep=seeds"),
    (TRAIN, "+trainer.max_steps=3", "unknown override 'trainer.max_steps'; did you mean trainer.max_minutes"),
    (TRAIN, "data.num_scenes=20", "it is a setting of python -m data_gen"),
    (TRAIN, "data.root=~/nowhere", f"no data in {Path.home()}/nowhere; make some: python -m data_gen"),
    (TRAIN, "--foo", "unknown flag --foo"),
    (TRAIN, "-m --cfg job", "Only one of"),
    (TRAIN, "-m seed=1,2", "all jobs of this sweep would be runs/nano"),
    (TRAIN, "seed=-1", "seed=-1 is not within 0"),
    (TRAIN, "dataset.workers=-1", "dataset.workers=-1 is not a number of processes"),
    (TRAIN, f"encoders=[camera,camera] {ANY_DATA}", "'camera' is there twice"),
    (TRAIN, f"grid.cell=0 {ANY_DATA}", "cell=0.0 must be above 0"),
    (TRAIN, f"grid=graded grid.rows=200 {ANY_DATA}", "take rows=112 or fewer, or cell=0.224 or less"),
    (TRAIN, f"data.root={'x' * 300}", "File name too long"),
    (EVAL, "run=null", "run=null is not a name"),
    (EVAL, "run=5", "no run at 5"),
    (EVAL, "run=a bootstrap=0", "bootstrap=0 must be at least 1"),
    (DATA_GEN, "data.name=a/b", "name='a/b' is part of file names"),
    (DATA_GEN, "data.root=", "root='' names no folder"),
    (DATA_GEN, "+rig.cameras.CAM_FRONT.hfov=3", "did you mean rig.cameras.CAM_FRONT.hfov_deg"),
    (SHEET, "show=foo", "show=foo is neither layouts nor sensors"),
    (SHEET, "out=foo.xyz", "out=foo.xyz is no picture; end it with .png"),
    (PREVIEW, "--junk", "unknown flag --junk"),
    (PREVIEW, "rig=nanoo", "did you mean nano?"),
    (TRAIN, "data.root=[]", "data.root=[] names no folder of data"),
    (STATISTICS, "sample=3", "it is a setting of python -m fusion_net.viz.lidar_check"),
    (
        TRACKS,
        "checkpoint=nano",
        "no data in data/sequence; make some: python -m data_gen data=sequence data.root=data/seq",
    ),
    (STATISTICS, "samples=none", "samples=none is not a whole number; the default is 300"),
    (STATISTICS, "data.root=nowhere", "no data in nowhere; make some: python -m data_gen"),
    (LIDAR_CHECK, "smple=1", "did you mean sample or split?"),
    (LIDAR_CHECK, "data/nano", "'data/nano' is not an override; write key=value"),
    (LIDAR_CHECK, "follow=maybe", "follow=maybe is not true or false"),
    (LIDAR_CHECK, "error_deg=much", "error_deg=much is not a number"),
    (LIDAR_CHECK, "error_deg=90", "error_deg=90 is not within 45 degrees"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("command", "override", "answer"), MISTAKES, ids=[override for _, override, _ in MISTAKES])
def test_a_mistake_is_one_line_and_writes_nothing(command, override, answer, tmp_path, warm):
    code, _, error = warm.run([*command, *override.split()], tmp_path)
    assert code in (1, 2)
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert answer in error
    assert [path.name for path in tmp_path.iterdir() if path.name != "cli.log"] == []  # empty; Hydra makes it


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        TRAIN, [*EVAL, "checkpoint=nano"], STATISTICS, LIDAR_CHECK, PAINTING, RERUN_LOG, [*RERUN_LOG, "checkpoint=nano"],
        [*ANIMATION, "checkpoint=nano"], [*TRACKS, "checkpoint=nano", "data.root=null"],
    ],
    ids=lambda command: "_".join(command)[-30:],
)  # fmt: skip
def test_where_only_other_data_is_there_every_command_names_it(command, tmp_path, warm):
    if command[:2] == RERUN_LOG:
        pytest.importorskip("rerun", reason="the extra is not installed: python -m pip install -e '.[rerun]'")
    (tmp_path / "data/try/v1.0-nano").mkdir(parents=True)
    (tmp_path / "data/try/v1.0-nano/scene.json").write_text("[]")
    code, _, error = warm.run(command, tmp_path)
    make = "python -m data_gen data=nano data.root=data/nano"
    assert (code, error) == (1, f"error: no data in data/nano; write data.root=data/try, or make some: {make}\n")


@pytest.mark.slow
def test_a_run_is_scored_with_every_subset_and_against_its_decoys(trained):
    code, out, error = run([*EVAL, "run=runs/base", "bootstrap=5", "split=all"], trained)
    assert code == 0, error
    doc = json.loads((trained / "runs/base/eval/all/drop_table.json").read_text())
    assert len(doc["rows"]) == 7
    assert all(len(kind["rows"]) == 7 for kind in doc["decoys"])
    assert "AUC" in out


@pytest.mark.slow
def test_a_run_is_scored_under_a_fault_beside_its_clean_table(trained):
    code, _, error = run(
        [*EVAL, "run=runs/base", "bootstrap=5", "split=all", "fault=lidar_beams", "fault.severity=3"], trained
    )
    assert code == 0, error
    doc = json.loads((trained / "runs/base/eval/all/lidar_beams_3/drop_table.json").read_text())
    assert doc["fault"] == {"name": "lidar_beams", "severity": 3}
    code, _, error = run([*EVAL, "run=runs/base", "fault=lidar_beams", "fault.severity=4"], trained)
    assert (code, error.count("\n")) == (1, 1)
    assert "fault.severity=4: 'lidar_beams' has severities 1 to 3" in error


@pytest.mark.slow
def test_a_run_that_exists_is_kept(trained, data):
    code, _, error = run([*TRAIN, f"data.root={data}", "name=base"], trained)
    assert code == 1
    assert "runs/base exists; pass name=ANOTHER, resume=true to go on, or overwrite=true" in error
    assert (trained / "runs/base/checkpoints/last.ckpt").exists()


@pytest.mark.slow
def test_data_made_anew_with_other_settings_is_not_mistaken_for_the_old(trained, data):
    manifest = data / "manifest.json"
    was = manifest.read_text()
    try:
        manifest.write_text(json.dumps(json.loads(was) | {"hash": "f" * 64}))
        for command in ([*EVAL, "run=runs/base"], [*TRAIN, f"data.root={data}", "name=base", "resume=true"]):
            code, _, error = run(command, trained)
            assert code == 1
            assert error.startswith("error: the data is no longer that which runs/base was trained on")
            assert error.count("\n") == 1
    finally:
        manifest.write_text(was)


CUT = ("trainer.camera_steps=30", "trainer.camera_only_steps=4", "trainer.fusion_steps=26", "trainer.save_every=7")


@pytest.fixture(scope="module")
def unbroken(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("unbroken")
    code, _, error = run([*TRAIN, f"data.root={data}", "name=cut", *CUT], folder)
    assert code == 0, error
    return folder / "runs/cut"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 130), (signal.SIGKILL, -signal.SIGKILL)]
)
@pytest.mark.parametrize("workers", [0, 1])
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
@pytest.mark.parametrize("workers", [1, 2])
def test_ctrl_c_keeps_finished_scenes_and_generation_goes_on(tmp_path, workers):
    root = tmp_path / "tree"
    command = [*DATA_GEN, f"workers={workers}", "data.num_scenes=12", f"data.root={root}"]
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
def test_shards_made_side_by_side_train_and_are_scored_as_one_data_set(data, trained, tmp_path):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    command = [*DATA_GEN, "-m", "shard=1/3,2/3,3/3", "hydra/launcher=joblib", "data.num_scenes=12", "data.root=shards"]
    assert run(command, tmp_path)[0] == 0
    assert sorted(path.name for path in (tmp_path / "shards").iterdir()) == [f"shard-{n}-of-3" for n in (1, 2, 3)]
    assert [path.name for path in (tmp_path / "data").iterdir()] == [".multirun"]
    assert run([*TRAIN, "data.root=shards", "name=base"], tmp_path)[0] == 0
    assert (tmp_path / "runs/base/metrics.csv").read_text() == (trained / "runs/base/metrics.csv").read_text()
    code, _, error = run([*EVAL, "run=runs/base", "bootstrap=5", f"data.root=[{data}]"], tmp_path)
    assert (code, error.count("warning")) == (0, 0)
    code, _, error = run([*EVAL, "run=runs/base", f"data.root=[shards,{data}]"], tmp_path)
    assert code == 1
    assert "hold the same samples" in error


@pytest.mark.slow
def test_a_sweep_does_what_is_left_and_a_job_that_fails_stops_no_other(data, tmp_path):
    steps = ("trainer.camera_steps=2", "trainer.camera_only_steps=2", "trainer.fusion_steps=4")
    command = [*TRAIN, "-m", "+sweep=seeds", "seed=1,2", *steps, f"data.root={data}"]
    code, _, error = run(command, tmp_path)
    assert code == 0, error
    sweep = tmp_path / "runs/sweeps/seeds"
    one, two = sorted(path for path in sweep.iterdir() if path.is_dir())
    assert [one.name[:6], two.name[:6]] == ["seed-1", "seed-2"]
    assert sorted(path.name for path in sweep.iterdir() if path.is_file()) == ["multirun.yaml"]
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
    was = {path: path.stat().st_mtime_ns for path in sweep.rglob("*") if path.is_file() and path.parent != sweep}
    code, out, _ = run(command, tmp_path)
    assert (code, out.count("is finished")) == (0, 2)
    assert {path: path.stat().st_mtime_ns for path in was} == was
    config = one / "config.yaml"
    config.write_text(config.read_text().replace("modality_dropout: 0.3", "modality_dropout: 0.4"))
    (two / "env.json").write_text("{}")  # interrupted after its last checkpoint
    code, out, error = run(command, tmp_path)
    assert code == 1
    assert f"{one.name} is a run with other settings (modality_dropout: 0.4 there, 0.3 asked for)" in error
    assert "Traceback" not in error
    assert json.loads((two / "env.json").read_text())["finished"]
    (two / "eval/result.json").unlink()  # not scored: the same command does that
    assert run(command, tmp_path)[0] == 1
    assert (two / "eval/result.json").exists()
    code, out, error = run(["-m", "fusion_net.reports.ablation", "runs/sweeps/seeds", "collect=true"], tmp_path)
    assert code == 0, error
    assert "Missing" not in out
    assert len(list((tmp_path / "docs/results/runs/seeds").glob("seed-*.json"))) == 2
    assert (tmp_path / "docs/results/seeds/ablation.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["it's a, [run]", "seed=1,lr=${x}", "2026_01"])
def test_the_command_that_is_printed_scores_a_run_of_any_name(data, tmp_path, name):
    steps = ("trainer.camera_steps=2", "trainer.camera_only_steps=2", "trainer.fusion_steps=4")
    code, printed, error = run([*TRAIN, f"data.root={data}", f"name={as_override(name)}", *steps], tmp_path)
    assert code == 0, error
    (advice,) = advised(printed)
    code, _, error = run([*advice, "bootstrap=2"], tmp_path)
    assert code == 0, error
    assert (tmp_path / "runs" / name / "eval" / "drop_table.json").exists()


@pytest.mark.slow
def test_the_commands_that_messages_advise_can_be_given(tmp_path, warm):
    """Each with --cfg job, which reads it and prints the settings."""
    folder = "no data, [here]"
    for command in ([*TRAIN, f"data.root={as_override(folder)}"], [*EVAL, f"run={as_override(folder)}"]):
        _, _, error = warm.run(command, tmp_path)
        (advice,) = advised(error)
        code, out, error = warm.run([*advice, "--cfg", "job"], tmp_path)
        assert code == 0, error
        assert folder in out


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [TRAIN, EVAL, DATA_GEN, SHEET, PREVIEW, STATISTICS, LIDAR_CHECK, ABLATION, COMPARE],
    ids=lambda command: command[-1][-12:],
)
@pytest.mark.parametrize(
    "flags", [["--help"], ["--cfg", "job"], ["--info", "defaults-tree"]], ids=lambda flags: flags[0]
)
def test_flags_that_only_tell_end_well(command, flags, tmp_path, warm):
    code, out, error = warm.run([*command, *flags], tmp_path)
    assert (code, error) == (0, "")
    assert out


@pytest.mark.slow
def test_every_command_takes_settings_from_a_folder_of_ones_own(tmp_path, warm):
    for group, like in (("fault", "lidar_beams"), ("rig", "nano"), ("condition", "fog"), ("trainer", "smoke")):
        path = tmp_path / "own" / group / "mine.yaml"
        path.parent.mkdir(parents=True)
        path.write_text(
            (PROJECT / "configs" / group / f"{like}.yaml").read_text().replace(f"name: {like}", "name: mine")
        )
    for command, choice in (
        (TRAIN[:1], "trainer=mine"), (EVAL, "fault=mine"), (DATA_GEN, "rig=mine"), (SHEET, "condition=mine"),
        (PREVIEW, "rig=mine"),
    ):  # fmt: skip
        code, _, error = warm.run([*command, "--config-dir", "own", choice, "--cfg", "job"], tmp_path)
        assert (code, error) == (0, "")
    code, _, error = run([*PREVIEW, "rig=mine", "--config-dir", "own", "out=mine.png"], tmp_path)
    assert code == 0, error
    assert (tmp_path / "mine.png").exists()


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
