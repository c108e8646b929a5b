"""The command as it was typed, whatever became of it on its way to Hydra."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from fusion_net.common.cli.typed import note_words, retyped, typed_command

PROJECT = Path(__file__).parents[3]
SHOW = """
import sys
sys.path.insert(0, {project!r})
from fusion_net.common.cli.command import command
from fusion_net.common.cli.typed import typed_words
@command("{name}")
def main(cfg):
    import json
    print(json.dumps(typed_words()))
sys.argv[1:] = {words!r}
main()
"""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("train", ["trainer.threads=1", "name=2026_01", "encoders=[camera,lidar]", "init=null"]),
        ("tracks", ["run=a b", "split=val"]),
    ],
)
def test_words_are_kept_as_they_were_typed(name, words, tmp_path):
    code = SHOW.format(project=str(PROJECT), name=name, words=words)
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    program = {"train": ["train.py"], "tracks": ["-m", "fusion_net.reports.tracks"]}[name]
    assert json.loads(done.stdout) == [*program, *words]


def test_outside_of_a_command_there_is_still_an_answer():
    note_words([])
    assert typed_command()


@pytest.mark.parametrize(
    ("words", "clean"),
    [
        (["train.py", "trainer.threads='1'"], ["train.py", "trainer.threads=1"]),
        (["train.py", "name='2026_01'", 'name="x"'], ["train.py", "name=2026_01", "name=x"]),
        (["train.py", "name='a b'", "data.root=['a b',c]"], ["train.py", "name='a b'", "data.root=['a b',c]"]),
        (["eval.py", "run=runs/it's"], ["eval.py", "run=runs/it's"]),
    ],
)
def test_recorded_quotes_are_dropped_where_the_front_door_puts_them_back(words, clean):
    assert shlex.split(retyped(shlex.join(words))) == clean
