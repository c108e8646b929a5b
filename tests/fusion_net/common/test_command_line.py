import re
import shlex

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from fusion_net.common.cli.command_line import LONGEST, as_override, command_line, job_folder
from fusion_net.common.cli.config_files import CONFIGS
from fusion_net.common.cli.overrides import check_overrides
from fusion_net.runs.run_dir import run_folder

ODD = [
    "a b",
    "seed=1,2",
    "it's",
    'a"b',
    "a$b",
    "a${b}",
    r"a\${b}",
    "2026_01",
    "null",
    "true",
    "~x",
    "[a]",
    "é",
    "a\\",
    "-x",
    "",
]
texts = st.sampled_from(ODD) | st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=30)


def read(command):
    """What a shell and Hydra make of a printed command: program and values."""
    python, program, *words = shlex.split(command)
    overrides = OverridesParser.create().parse_overrides(words)
    settings = OmegaConf.create({each.key_or_group.replace(".", "__"): each.value() for each in overrides})
    return python, program, OmegaConf.to_container(settings, resolve=True)


@given(texts, st.lists(texts, max_size=3), st.integers() | st.booleans() | st.none())
def test_a_printed_command_is_read_as_it_is_meant(text, many, other):
    command = command_line("eval.py", run=text, data__root=many, seed=other)
    assert read(command) == ("python", "eval.py", {"run": text, "data__root": many, "seed": other})


@pytest.mark.parametrize("text", [text for text in ODD if text])
def test_the_check_before_hydra_passes_a_printed_command_on(text):
    words = shlex.split(command_line("eval.py", run=text))[2:]
    assert check_overrides("eval", words) == words


def test_plain_names_need_no_quotes():
    assert command_line("eval.py", run="runs/a-b_c.1") == "python eval.py run=runs/a-b_c.1"
    assert as_override(["a", 1.5]) == "[a,1.5]"


def test_a_job_s_folder_is_readable():
    assert job_folder(["seed=1", "fuser=average"]) == "fuser-average_seed-1"
    assert job_folder(["modality_dropout=0.3"]) == "modality_dropout-0.3"


overrides = st.lists(
    st.tuples(st.from_regex(r"[+]?[a-z_]+([.][a-z]+)?", fullmatch=True), texts), min_size=1, max_size=20
)


@given(overrides)
def test_a_job_s_folder_is_short_plain_and_the_same_in_any_order(pairs):
    words = [f"{key}={value}" for key, value in pairs]
    name = job_folder(words)
    assert re.fullmatch(r"[A-Za-z0-9_.-]+", name)
    assert 0 < len(name) <= LONGEST
    assert not name.startswith(("-", "."))
    assert job_folder(words[::-1]) == name
    assert run_folder(f"sweeps/mine/{name}").name == name


@pytest.mark.parametrize("pair", [("[a]", "(a)"), ("a b", "a-b"), ("x" * 200, "x" * 201), ("a/b", "a-b")])
def test_jobs_whose_names_would_be_alike_differ_in_a_hash(pair):
    assert len({job_folder([f"key={value}"]) for value in pair}) == 2


def test_every_sweep_names_its_folders_so():
    for path in CONFIGS.glob("sweep/*.yaml"):
        assert OmegaConf.load(path)._get_node("name")._value() == f"sweeps/{path.stem}/${{job_folder:}}"
