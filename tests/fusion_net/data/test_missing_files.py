"""A file that the tables name and that is not there is an error; a sensor is dead only where the tables have no record."""

import re
import shutil

import pytest

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.fault_effects import Stale
from fusion_net.common.faults import Fault
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.data.samples import SampleReader
from fusion_net.fit import fit
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.reports.statistics import write_statistics
from fusion_net.runs.samples import open_samples
from fusion_net.runs.trained import trained_run
from fusion_net.viz.lidar_check import write_check
from tests.fixtures.training_setup import settings, write_data

GRID = BEVGrid(0.0, 32.0, -12.8, 16.0, 0.8)


@pytest.fixture
def root(tmp_path):
    """Two scenes of three keyframes, two cameras, a LiDAR and two radars with two sweeps before each keyframe."""
    return write_data(tmp_path / "tree", scenes=2)


def opened(root, **reader):
    return NuScenesDataset(str(root), "train", grid=GRID, **reader)


def unlink(root, pattern):
    for path in root.glob(pattern):
        path.unlink()


def refusal(root, **reader):
    with pytest.raises(ValueError, match=r"exist|missing|not there") as error:
        opened(root, **reader)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("folders", [("samples", "sweeps"), ("samples",)])
def test_nothing_extracted_is_named_by_modality_with_its_folder(root, folders):
    for folder in folders:
        shutil.rmtree(root / folder)
    text = refusal(root, radar_sweeps=0)
    assert "none of 6 camera files exists; none of 3 lidar files exists; none of 6 radar files exists" in text
    assert "is samples/ extracted?" in text
    assert re.search(r"sample_data\.json: the record 'scene-0000-CAM_FRONT-\d+' has filename='samples/CAM_FRONT/", text)


def test_a_part_that_is_missing_is_counted_by_channel(root):
    unlink(root, "samples/CAM_BACK/scene-0000*")
    next((root / "samples/RADAR_FRONT").glob("scene-0000*")).unlink()
    text = refusal(root, radar_sweeps=0)
    assert "3 of 6 camera files are missing (CAM_BACK 3 of 3)" in text
    assert "1 of 6 radar files are missing (RADAR_FRONT 1 of 3)" in text
    assert "lidar" not in text


def test_only_what_is_used_is_looked_for(root):
    unlink(root, "samples/CAM_BACK/*")
    unlink(root, "sweeps/*/*")
    unlink(root, "samples/*/scene-0001*")
    kept = {"cameras": ["CAM_FRONT"], "radar_sweeps": 0}
    assert len(opened(root, **kept)) == 3
    assert "lidar" not in refusal(root, **kept | {"cameras": None})
    assert "6 of 9 lidar files are missing (LIDAR_TOP 6 of 9)" in refusal(root, **kept | {"lidar_sweeps": 2})
    assert "is sweeps/ extracted?" in refusal(root, **kept | {"radar_sweeps": 1})
    assert len(opened(root, modalities=["lidar"])) == 3


def test_a_folder_or_a_dangling_link_in_the_place_of_a_file_is_no_file(root):
    image = next((root / "samples/CAM_FRONT").glob("scene-0000*.jpg"))
    image.unlink()
    image.symlink_to("nowhere.jpg")
    assert "1 of 6 camera files are missing" in refusal(root)
    image.unlink()
    image.mkdir()
    assert "1 of 6 camera files are missing" in refusal(root)


def test_generated_data_is_generated_again(root):
    (root / "manifest.json").write_text('{"hash": "a", "command": "python -m data_gen data=tiny"}')
    shutil.rmtree(root / "samples")
    assert refusal(root).endswith(f"delete {root} and generate it again: python -m data_gen data=tiny data.root={root}")


def test_every_command_refuses_them(root, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = fit(settings(root, "trainer.camera_steps=1", "trainer.camera_only_steps=0", "trainer.fusion_steps=1"))
    shutil.rmtree(root / "samples")
    for command in (
        lambda: fit(settings(root, "name=other")),
        lambda: open_samples(trained_run(run, "best")),
        lambda: write_statistics(str(root), out=str(tmp_path)),
        lambda: write_check(str(root), out=str(tmp_path / "check.png")),
    ):
        with pytest.raises(ValueError, match=r"none of \d+ lidar files exists.*samples/"):
            command()
    assert not (tmp_path / "runs/other").exists()
    assert not (tmp_path / "check.png").exists()


def test_a_file_that_goes_later_is_named_when_it_is_read(root):
    tree = NuScenes(root)
    token = tree.split("train")[0]
    path = tree.path(tree.keyframes[token]["RADAR_FRONT"])
    path.unlink()
    with pytest.raises(ValueError, match=rf"{path} is not there; .*sample_data\.json: the record 'scene-0000-RADAR"):
        SampleReader().read(tree, token)


def test_an_earlier_firing_that_a_fault_takes_is_not_passed_over(root):
    tree = NuScenes(root)
    late, early = tree.split("train")[1::-1]
    tree.path(tree.keyframes[early]["CAM_FRONT"]).unlink()
    stale = Fault(sensors=["CAM_FRONT"], effect=Stale(firings=1))
    with pytest.raises(ValueError, match="is not there"):
        SampleReader(faults=[stale]).read(tree, late)
