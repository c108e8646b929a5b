"""The commands of a report that make its figures again."""

import re
import shlex

from fusion_net.reports.evaluation.run import commands_again

NANO, MORE, TRY = ("a" * 64, "b" * 64, "c" * 64)
MAKE = "python -m data_gen data=nano"
DOC = {"command": "eval.py run=runs/long"}
RESULT = {
    "command": shlex.join(
        ["train.py", "name=long", "data.root=[data/nano,data/more]", "trainer.threads='1'", "name=it's"]
    ),
    "data": [NANO, MORE],
    "made_by": {NANO: f"{MAKE} data.root=data/nano", MORE: f"{MAKE} seed=2 data.root=data/more"},
    "scored": {"checkpoint": "best.ckpt", "data": [NANO], "made_by": {NANO: f"{MAKE} data.root=data/nano"}},
}


def test_a_run_is_made_again_from_its_data_to_its_scores():
    data, more, train, score = commands_again(DOC, RESULT)
    assert (data, more) == (f"{MAKE} data.root=data/nano", f"{MAKE} seed=2 data.root=data/more")
    words = ["python", "train.py", "name=long", "data.root=[data/nano,data/more]", "trainer.threads=1", "name=it's"]
    assert shlex.split(train) == words
    assert "'trainer.threads" not in train
    assert score == "python eval.py run=runs/long"


def test_shipped_weights_are_scored_first_and_data_of_no_known_command_is_said():
    scored = {"checkpoint": "nano.pt", "data": [TRY], "made_by": {TRY: f"{MAKE} data.root=data/try"}}
    result = RESULT | {"scored": scored, "made_by": {NANO: MAKE}}
    data, score, trained, nano, more, train = commands_again(
        {"command": "eval.py checkpoint=nano data.root=data/try"}, result
    )
    assert (data, score) == (f"{MAKE} data.root=data/try", "python eval.py checkpoint=nano data.root=data/try")
    assert trained.startswith("# ")
    assert nano == MAKE
    assert re.match("# .* manifest bbbbbbbbbbbb", more)
    assert train.startswith("python train.py")


def test_records_that_say_less_are_shown_as_far_as_they_go():
    scored = {"checkpoint": "best.ckpt", "data": [""]}  # recorded data has no manifest
    assert commands_again(DOC, {"scored": scored}) == ["python eval.py run=runs/long"]
