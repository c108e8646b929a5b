"""The scripts that run in the devkit's environment share the on-disk contract with the project."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
DEVKIT = ROOT / "tools/devkit"


def test_the_contract_can_be_imported_with_the_standard_library_alone(tmp_path):
    code = "from project import nuscenes_format; print(nuscenes_format.DEPTH_SCALE)"
    command = [sys.executable, "-S", "-c", f"import sys; sys.path.insert(0, {str(DEVKIT)!r}); {code}"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("256.0\n", "")


def test_nothing_that_reads_a_tree_spells_the_contract_out():
    """Suffixes of side files, names of files, keys that generated trees add, the reference channel."""
    spelled = re.compile(
        r'\.(depth|class)\.png"|\.(time|cause)\.npy"|"num_\w+_echoes"|"LIDAR_TOP"|/ 256\b|"v1\.0-\*?"|"(splits|manifest)\.json"'
    )
    for path in [*DEVKIT.glob("*.py"), *(ROOT / "fusion_net").rglob("*.py")]:
        if path.name != "nuscenes_format.py":
            assert not spelled.search(path.read_text(encoding="utf-8")), path.name
