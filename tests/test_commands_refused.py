"""A mistake is one line on stderr and a non-zero exit; flags that only tell end well."""

from pathlib import Path

import pytest

from fusion_net.common.cli.command_line import as_override
from tests.fixtures.typed_commands import (
    ABLATION,
    ANIMATION,
    ANY_DATA,
    ASSET_SHEET,
    COMPARE,
    DATA_GEN,
    EVAL,
    LEVELS,
    LIDAR_CHECK,
    PAINTING,
    PREVIEW,
    PROJECT,
    RERUN_LOG,
    SHEET,
    STATISTICS,
    TRACKS,
    TRAIN,
    advised,
    run,
)

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
    (
        TRACKS,
        "checkpoint=nano data.root=none",
        "make scenes of ten seconds: python -m data_gen data=sequence data.root=none",
    ),
    (LEVELS, "other_lidar=nowhere", "no data in nowhere; make some: python -m data_gen data=nano data.root=nowhere"),
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
        "no data in data/sequence; make scenes of ten seconds: python -m data_gen data=sequence data.root=data/seq",
    ),
    (STATISTICS, "data.root=null", "data.root=null names no folder of data; write data.root=DIR"),
    (TRAIN, "data.root=null", "data.root=null names no folder of data; write data.root=DIR"),
    (LIDAR_CHECK, "data.root=null", "data.root=null names no folder of data"),
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
def test_help_shows_the_name_of_a_sweep_as_it_is_typed(tmp_path, warm):
    _, out, _ = warm.run([*TRAIN, "--help"], tmp_path)
    assert "python train.py -m seed=1,2 'name=mine_${seed}' " in out


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
