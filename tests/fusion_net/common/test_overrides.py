"""Overrides are checked before Hydra reads them, and a mistake is answered with the nearest that is valid."""

import re

import pytest

from fusion_net.common.cli.command import CONFIGS, UserError, check_overrides
from fusion_net.common.cli.config_files import COMMANDS
from fusion_net.common.cli.overrides import Settings


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
        given[-1]
        == "hydra.job.config.override_dirname.exclude_keys=[name,sweep,resume,overwrite,skip_finished,evaluate,hydra/launcher]"
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
