"""The lesson's catalogue of failures, each provoked by one override on the shipped weights, and caught by its audit."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir

from fusion_net.common.cli.command import CONFIGS
from fusion_net.evaluate import evaluate_run

ROOT = Path(__file__).parents[4]
pytestmark = pytest.mark.slow


def generate(folder, *overrides):
    command = [sys.executable, "-m", "data_gen", "data=nano", f"data.root={folder}", "workers=1", *overrides]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with scenes that no weights have seen: ``clear`` ones, and some in ``fog`` thicker than any of theirs."""
    folder = tmp_path_factory.mktemp("failures")
    generate(folder / "clear", "condition=clear", "data.num_scenes=12", "seed=11")
    generate(folder / "fog", "data.name=fog", "condition=thick_fog", "data.num_scenes=6", "seed=12")
    return folder


@pytest.fixture
def audit(place, monkeypatch):
    """The audits of an evaluation, by name."""
    monkeypatch.chdir(place)

    def evaluate(*overrides, weights="nano", root="clear"):
        for old in place.rglob("audits/*.json"):
            old.unlink()
        given = [f"checkpoint={ROOT}/checkpoints/{weights}.pt", f"data.root={root}", "split=all", "bootstrap=40"]
        with initialize_config_dir(str(CONFIGS), version_base="1.3"):
            evaluate_run(compose("eval", overrides=[*given, "report=false", *overrides]))
        docs = [json.loads(path.read_text()) for path in place.rglob("audits/*.json")]
        return {doc["name"]: doc for doc in docs}

    return evaluate


def test_no_audit_of_sound_sensors_is_wrong(audit):
    for name, doc in audit("audits=[calibration,depth,ablation,association]").items():
        assert doc["ok"], f"{name}: {doc['verdict']}"


def test_failure_1_a_camera_that_is_turned(audit):
    doc = audit("audits=calibration", "fault=camera_rotation", "fault.severity=3")["calibration"]
    assert not doc["ok"]
    assert doc["verdict"].endswith("it is the camera")
    pair = doc["numbers"]["pairs"]["C+L"]
    assert pair["turn_deg"] == pytest.approx(2.0, abs=3 * pair["turn_error"])


def test_failure_2_a_camera_that_knows_no_depth(audit):
    assert not audit("audits=depth", "depth_source=uniform")["depth"]["ok"]


def test_failure_3_a_sensor_that_adds_nothing(audit):
    doc = audit("audits=ablation", "fault=dead_camera", "fault.severity=3")["ablation"]
    assert not doc["ok"]
    assert "camera is ignored" in doc["verdict"]


def test_failure_4_a_weather_that_was_never_trained_on(audit):
    doc = audit("audits=conditions", root="[clear,fog]")["conditions"]
    assert not doc["ok"]
    assert "worst in thick fog" in doc["verdict"]


@pytest.mark.parametrize(
    ("override", "weights", "words"),
    [
        ("audit_gate=12", "nano", "too wide"),
        ("audit_gate=0.25", "nano", "too narrow"),
        ("late.gate=0.1", "late", "too narrow"),
    ],
)
def test_failure_5_a_gate_that_is_far_off(audit, override, weights, words):
    doc = audit("audits=association", override, weights=weights)["association"]
    assert not doc["ok"]
    assert words in doc["verdict"]


def test_the_gate_of_late_fusion_is_not_called_far_off(audit):
    verdict = audit("audits=association", weights="late")["association"]["verdict"]
    assert not re.search("too (wide|narrow)", verdict)
