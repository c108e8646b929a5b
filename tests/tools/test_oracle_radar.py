"""Every fault of radar data is caught by the check that was made for it; trees without a fault pass. Needs
tools/devkit/setup.sh to have run."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DEVKIT = ROOT / ".venv-devkit/bin/python"
FEW_OBJECTS = r"turned by 20|by 0\.7 degrees|mounts of left|file names|vx|sweeps with|wrong order"
TREES = {"nano": (12, "", 29), "surround": (3, FEW_OBJECTS, 10)}
"""By rig: scenes, the faults that are tried, and how many these are. Three scenes have too few objects for the other faults."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(not DEVKIT.exists(), reason="no .venv-devkit; make it with tools/devkit/setup.sh"),
]


@pytest.fixture(scope="module", params=TREES)
def found(request, tmp_path_factory):
    """By fault, the check that was made for it and all that failed."""
    rig, folder = request.param, tmp_path_factory.mktemp("oracle")
    scenes, only, _ = TREES[rig]
    root = folder / rig
    overrides = (f"data={rig}", "condition=mixed", f"data.num_scenes={scenes}", f"data.root={root}", "workers=1")
    subprocess.run([sys.executable, "-m", "data_gen", *overrides], cwd=ROOT, check=True, capture_output=True)
    command = [DEVKIT, ROOT / "tools/devkit/mutations.py", "--root", root, "--only", only]
    command += ["--json", folder / "found.json"]
    subprocess.run(command, check=True, capture_output=True)
    return json.loads((folder / "found.json").read_text())[rig]


def test_each_fault_is_caught_by_its_check_and_no_fault_by_none(found):
    assert found.pop("nothing")["failed"] == {}
    assert len(found) in [count for _, _, count in TREES.values()]
    missed = [name for name, result in found.items() if result["check"] not in result["failed"]]
    assert not missed


def test_a_finding_names_the_radar(found):
    turned = found["mount of RADAR_FRONT turned by 20 degrees"]
    assert {case.split(",")[0] for case in turned["failed"][turned["check"]]} == {"RADAR_FRONT"}


@pytest.mark.parametrize("found", ["nano"], indirect=True)
def test_a_finding_names_the_age(found):
    late = found["range 3 % too long, RADAR_FRONT's sweeps only"]
    cases = late["failed"][late["check"]]
    assert {case.split(",")[0] for case in cases} == {"RADAR_FRONT"}
    assert any(case.endswith("ms before") for case in cases)
    assert "RADAR_FRONT, keyframe" not in cases
