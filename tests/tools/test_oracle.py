"""The official devkit on a generated tree, and on trees with one thing wrong. Needs tools/devkit/setup.sh to have run."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DEVKIT = ROOT / ".venv-devkit/bin/python"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DEVKIT.exists(), reason="no .venv-devkit; make it with tools/devkit/setup.sh"),
]


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    root = tmp_path_factory.mktemp("oracle") / "tree"
    overrides = ("data=nano", "data.num_scenes=3", f"data.root={root}", "workers=1")
    subprocess.run([sys.executable, "-m", "data_gen", *overrides], cwd=ROOT, check=True, capture_output=True)
    return root


@pytest.fixture
def copy(tree, tmp_path):
    return Path(shutil.copytree(tree, tmp_path / "copy"))


def check(root, *more):
    command = [DEVKIT, ROOT / "tools/devkit/check.py", "--root", root, *more]
    return subprocess.run(command, check=False, capture_output=True, text=True)


def change(root, table, function):
    path = root / "v1.0-nano" / f"{table}.json"
    rows = json.loads(path.read_text())
    for row in rows:
        function(row)
    path.write_text(json.dumps(rows))


def test_the_devkit_agrees_with_every_label_and_draws_the_tree(tree, tmp_path):
    done = check(tree, "--out", tmp_path / "pictures", "--json", tmp_path / "findings.json")
    assert done.returncode == 0, done.stderr + done.stdout
    findings = {finding["what"]: finding for finding in json.loads((tmp_path / "findings.json").read_text())}
    assert len(findings) > 20
    assert findings["driving vehicles' centres on drivable pixels"]["figure"] > 0.9
    names = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert names == {"cameras.jpg", "points.jpg", "above.jpg", "map.jpg"}


def test_boxes_that_stand_a_metre_off_are_found(copy):
    change(
        copy,
        "sample_annotation",
        lambda row: row.update(translation=[row["translation"][0] + 1, *row["translation"][1:]]),
    )
    done = check(copy)
    assert done.returncode == 1
    assert "FAIL  LiDAR points of labels" in done.stdout
    assert "FAIL  pixels of objects" in done.stdout


def test_points_that_are_counted_by_what_caused_them_are_found(copy):
    change(copy, "sample_annotation", lambda row: row.update(num_lidar_pts=row["num_lidar_echoes"]))
    done = check(copy)
    assert done.returncode == 1
    assert "FAIL  num_lidar_pts" in done.stdout


def test_a_camera_that_looks_elsewhere_is_found(copy):
    def nudge(row):
        if row["camera_intrinsic"]:
            row["camera_intrinsic"][0][2] += 12

    change(copy, "calibrated_sensor", nudge)
    done = check(copy)
    assert done.returncode == 1
    assert done.stderr.startswith("error: 1 of ")
    assert "pixels of objects" in done.stderr


def test_a_map_that_is_upside_down_or_of_one_bit_is_found(copy):
    import cv2

    for path in (copy / "maps").iterdir():
        mask = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(path), mask[:, ::-1].T.copy())
    done = check(copy)
    assert done.returncode == 1
    assert "FAIL  ego poses on drivable pixels" in done.stdout


def test_a_missing_file_is_one_line(copy):
    next((copy / "maps").iterdir()).unlink()
    done = check(copy)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith(f"error: the devkit refused {copy}: AssertionError: map mask")
