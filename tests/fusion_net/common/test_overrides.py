import re
from typing import Literal

import pytest
from beartype import beartype

from fusion_net.common.cli.command import CONFIGS, UserError, build, check_overrides, one_line
from fusion_net.common.cli.overrides import COMMANDS, Settings


@pytest.mark.parametrize(
    ("argument", "answer"),
    [
        ("trainer.batch_sise=4", "did you mean trainer.batch_size"),
        ("trainer=cpuu", "did you mean cpu?"),
        ("modality_droput=0.5", "did you mean modality_dropout"),
        ("nonsense", "is not an override"),
        ("runs/mine", "'runs/mine' is not an override; write key=value, such as run=runs/mine"),
        ("encoders=[camera,lidar", "quote lists"),
        ("grid=nanoo", "did you mean nano?"),
        ("data=nan", "data=nan is not a file name; did you mean nano?"),
        ("grid=[nano]", "is not a file name; did you mean nano?"),
        ("grid=7", "is not a file name; there are coarse, "),
        ("trainer.batch_size=abc", "trainer.batch_size=abc is not a whole number; the default is 8"),
        ("trainer.batch_size=1.5", "not a whole number"),
        ("trainer.batch_size=null", "trainer.batch_size=null is not a whole number"),
        ("modality_dropout=abc", "modality_dropout=abc is not a number"),
        ("resume=yess", "resume=yess is not true or false; the default is false"),
        ("encoders=camera", "write 'encoders="),
        ("name=[a]", "is not a name"),
        ("dataset.augment={flip_z:true}", "unknown key 'flip_z' in dataset.augment; did you mean flip_y?"),
        ("sweep=seeds", "write [+]sweep=seeds"),
        ("+sweep=seedz", "there is no sweep=seedz; did you mean seeds"),
        ("+extra.key=1", "unknown override 'extra.key'"),
        ("+trainer.max_steps=3", "did you mean trainer.max_minutes"),
        ("++trainer.max_steps=3", "did you mean trainer.max_minutes"),
        ("+grid.cel=3", "did you mean grid.cell"),
        ("dataset.augment={flip_y:5}", "dataset.augment.flip_y=5 is not true or false"),
        ("dataset.train.min_radius=3", "can be added: write [+]dataset.train.min_radius="),
        ("trainer.augment=null", "did you mean dataset.train.augment"),
        ("reader.train.cameras=[CAM_FRONT]", "did you mean dataset.train.cameras"),
        ("+seed=3", "'seed' is in the settings already; write seed=3"),
        ("+trainer=cpu", "there is one already; write trainer=cpu"),
        ("data.num_scenes=20", "it is a setting of python -m data_gen"),
        ("split=test", "train.py does not read 'split'; it is a setting of eval.py"),
        ("rig=nano", "train.py has no group rig"),
        ("+rig=nano", "train.py does not read 'rig'; it is a setting of python -m data_gen"),
        ("data@other=nano", "write data=NAME"),
        ("~fault", "'fault' is needed"),
        ("grid=null", "'grid' is needed"),
        ("~dataset.cache", "'dataset.cache' is needed"),
        ("seed=1,2", "needs -m"),
        ("grid.cell=nan", "is not a finite number"),
        ("name=null", "is not a name"),
        ("name=" + "[" * 2000, "cannot read the override"),
        ("=5", "unknown override ''"),
        ("hydra.jop.name=x", "unknown override 'hydra.jop.name'"),
        ("hydra.searchpath=[file:///x]", "--config-dir DIR"),
        ("--name=mine", "unknown flag --name=mine; write name=mine"),
        ("--sede", "unknown flag --sede"),
        ("--cfg", "expected one argument"),
        ("--config-name=eval", "--config-dir DIR"),
        ("--config-dir=/nowhere", "--config-dir /nowhere is not a folder"),
    ],
)
def test_a_mistyped_override_is_answered_with_the_nearest_valid_one(argument, answer):
    with pytest.raises(UserError, match=answer.replace("?", r"\?")):
        check_overrides("train", [argument])


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        ("-m seed=1,x name=a", "seed=x is not a whole number"),
        ("-m trainer=smoke,cpuu name=a", "did you mean cpu?"),
        ("-m seed=1,2 name=a", "all jobs of this sweep would be runs/a; add 'name=a_${seed}'"),
        ("-m seed=1,2", "all jobs of this sweep would be runs/nano"),
    ],
)
def test_a_sweep_is_checked_value_by_value_before_its_first_job(arguments, answer):
    with pytest.raises(UserError, match=re.escape(answer)):
        check_overrides("train", arguments.split())


@pytest.mark.parametrize("argument", ["run=null", "run=[a]", "run={a:1}", "data.name=nano"])
def test_what_names_no_run_is_refused(argument):
    with pytest.raises(UserError):
        check_overrides("eval", [argument])


@pytest.mark.parametrize(
    ("argument", "for_hydra"),
    [
        ("data.root=~/x", "data.root='~/x'"),
        ("data.root=[~/x,~/y z]", "data.root=['~/x','~/y z']"),
        ("name=münchen", "name='münchen'"),
        ("name=a=b,c", "name='a=b,c'"),
        ("name=it's a run", "name='it\\'s a run'"),
        ("name=2026_01", "name='2026_01'"),
        ("name=true", "name='true'"),
        ("name=nan", "name='nan'"),
        ("fuser=1.50", "fuser='1.50'"),
        ("seed=2", "seed=2"),
        ("dataset.train.cache=none", "dataset.train.cache=none"),
    ],
)
def test_text_that_hydra_would_misread_reaches_it_in_quotes(argument, for_hydra):
    assert check_overrides("train", [argument]) == [for_hydra]


def test_flags_come_first_wherever_they_stand():
    given = check_overrides("train", ["seed=1,2", "--multirun", "name=a_${seed}"])
    assert given[:3] == ["--multirun", "seed=1,2", "name=a_${seed}"]


def test_a_sweep_over_what_folder_names_leave_out_puts_it_into_them():
    given = check_overrides("train", ["-m", "+sweep=seeds", "data.root=a,b"])
    assert (
        given[-1] == "hydra.job.config.override_dirname.exclude_keys=[sweep,resume,overwrite,evaluate,hydra/launcher]"
    )


@pytest.mark.parametrize(
    "argument",
    [
        "modality_dropout=1",
        "name=5",
        "dataset.train.augment=null",
        "seed=3",
        "trainer.max_minutes=2",
        "encoders=[camera,lidar]",
        "dataset.train.cameras=[CAM_FRONT]",
        "dataset.train.image_size=[64,160]",
        "+dataset.train.min_radius=3",
        "+dataset.train.radar_default_filter=true",
        "dataset.augment=null",
        "dataset.cache=none",
        "dataset.workers=2",
        "++seed=3",
        "~dataset.train.augment",
        "~experiment",
        "data.root=[a,b]",
        "+sweep=seeds",
        "hydra/launcher=joblib",
        "dataset.augment={brightness:0.1}",
        "experiment=nano",
        "-m",
        "--help",
    ],
)
def test_a_correct_override_passes(argument):
    check_overrides("train", [argument])


@beartype
class Thing:
    def __init__(self, count: int) -> None:
        if count < 0:
            raise ValueError(f"count={count} must not be negative")


def test_a_wrong_type_names_the_key_and_the_type():
    with pytest.raises(UserError, match=r"^thing\.count='many' is not of type int"):
        build({"_target_": f"{__name__}.Thing", "count": "many"}, "thing")


def test_a_refused_value_is_one_line():
    with pytest.raises(UserError, match=r"^thing\.count=-1 must not be negative"):
        build({"_target_": f"{__name__}.Thing", "count": -1}, "thing")


@beartype
class Proud:
    def __init__(self) -> None:
        raise ValueError("thing: out of order")


def test_a_key_that_the_message_begins_with_is_not_said_twice():
    with pytest.raises(UserError, match=r"^thing: out of order$"):
        build({"_target_": f"{__name__}.Proud"}, "thing")


@beartype
class Choice:
    def __init__(self, kind: Literal["concat", "average"], share: float = 0.5) -> None:
        self.kind = kind


def test_files_are_named_without_the_key_of_what_reads_them_and_without_a_number_of_the_system():
    with pytest.raises(UserError, match=r"^count=-1 must"):
        build({"_target_": f"{__name__}.Thing", "count": -1})
    assert one_line(PermissionError(13, "Permission denied", "runs/mine")) == "runs/mine: Permission denied"


def test_a_value_that_is_no_choice_is_answered_with_the_nearest():
    with pytest.raises(UserError, match=r"there is no kind=conct; did you mean concat\?"):
        build({"_target_": f"{__name__}.Choice", "kind": "conct"}, "choice")


def test_an_error_of_a_loader_process_is_its_message_alone():
    caught = "Caught ValueError in DataLoader worker process 0.\nOriginal Traceback (most recent call last):\n  x\n"
    text = f"{caught}ValueError: a.jpg is cut\n"
    assert one_line(ValueError(text)) == "a.jpg is cut"


def test_line_breaks_are_folded():
    assert one_line(ValueError("a\n  b")) == "a b"


@beartype
class Measured:
    def __init__(
        self, width: float, sizes: list[float], by_name: dict[str, float] | None = None, count: int = 1
    ) -> None:
        self.values = [width, *sizes, *(by_name or {}).values(), count]


def test_whole_numbers_are_numbers():
    node = {"_target_": f"{__name__}.Measured", "width": 1, "sizes": [1, 2.5], "by_name": {"a": 3}, "count": 4}
    built = build(node, "thing").values
    assert built == [1, 1, 2.5, 3, 4]
    assert [type(value) for value in built] == [float, float, float, float, int]


def test_true_is_no_number():
    with pytest.raises(UserError, match="width=True is not of type float"):
        build({"_target_": f"{__name__}.Measured", "width": True, "sizes": []}, "thing")


@pytest.fixture
def own(tmp_path):
    """A folder of a user's own settings: an experiment, a fault and a sweep."""
    files = {
        "experiment/mine.yaml": "# @package _global_\nname: mine\nfuser: average\ntrainer: {max_lr: 1}\n",
        "fault/tilted.yaml": (CONFIGS / "fault/lidar_rotation.yaml").read_text().replace("lidar_rotation", "tilted"),
        "sweep/rates.yaml": "# @package _global_\nname: sweeps/rates/${job_folder:}\nskip_finished: true\n"
        "hydra: {mode: MULTIRUN, sweeper: {params: {trainer.max_lr: '0.001,0.002'}}}\n",
    }
    for name, text in files.items():
        path = tmp_path / "my configs" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "my configs"


@pytest.mark.parametrize(
    "arguments", [["experiment=mine"], ["fault=tilted", "fault.severity=2"], ["+sweep=rates"], ["experiment=nano"]]
)
def test_settings_may_lie_in_a_folder_of_ones_own(own, arguments):
    given = check_overrides("train", [*arguments, "--config-dir", str(own)])
    assert given[: 2 + len(arguments)] == ["--config-dir", str(own), *arguments]


@pytest.mark.parametrize(
    ("argument", "answer"),
    [
        ("experiment=mien", "did you mean mine"),
        ("experiment=surond", "did you mean surround"),
        ("trainer=mine", "has no folder trainer/"),
    ],
)
def test_the_nearest_is_looked_for_in_both_folders(own, argument, answer):
    with pytest.raises(UserError, match=answer):
        check_overrides("train", [argument, "--config-dir", str(own)])


@pytest.mark.parametrize(
    ("file", "text", "answer"),
    [
        ("experiment/bad.yaml", "trainer: {max_stepz: 3}", "unknown key 'trainer.max_stepz'; did you mean"),
        ("experiment/bad.yaml", "trainer: {batch_size: many}", "trainer.batch_size=many is not a whole number"),
        ("experiment/bad.yaml", "grid: {cel: 3}", "unknown key 'grid.cel'; did you mean grid.cell"),
        ("experiment/bad.yaml", "a: [", "experiment/bad.yaml"),
        ("experiment/nano.yaml", "name: mine", "has the name of a file of the project"),
        ("sweep/bad.yaml", "hydra: {mode: MULTIRUN, sweeper: {params: {sede: '1,2'}}}", "did you mean seed"),
    ],
)
def test_a_mistake_in_a_file_of_ones_own_is_named(own, file, text, answer):
    (own / file).write_text(f"# @package _global_\n{text}\n")
    chosen = "+sweep=bad" if file.startswith("sweep") else "experiment=bad"
    with pytest.raises(UserError, match=re.escape(answer)):
        check_overrides("train", [chosen, "--config-dir", str(own)])


def test_every_file_of_settings_has_its_command():
    """Messages name the command that a setting belongs to."""
    assert {path.stem for path in CONFIGS.glob("*.yaml")} == set(COMMANDS)


@pytest.mark.parametrize(("override", "most"), [("trainer.batch_sise=4", 2), ("sede=1", 2), ("data.num_scenes=20", 5)])
def test_a_misspelt_key_does_not_wait_for_the_settings_of_every_command(monkeypatch, override, most):
    composed, compose = [], Settings._compose
    monkeypatch.setattr(
        Settings, "_compose", lambda self, chosen: composed.append(self.command) or compose(self, chosen)
    )
    with pytest.raises(UserError):
        check_overrides("train", [override])
    assert len(composed) <= most
