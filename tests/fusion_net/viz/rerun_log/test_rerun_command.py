"""What the command refuses, and which scene and sensors it takes."""

from types import SimpleNamespace

import numpy as np
import pytest
from omegaconf import OmegaConf

from fusion_net.common.cli.composed import composed
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.nuscenes.datasets import open_datasets, samples_of_split
from fusion_net.viz.rerun_log import check
from fusion_net.viz.rerun_log.write import choose, detect, output, record, subsets_of
from tests.fixtures import small_model
from tests.fixtures.tiny_tree import write_tree


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    root = write_tree(tmp_path_factory.mktemp("tree") / "tree", scenes=3, keyframes=2)
    return samples_of_split(open_datasets(str(root)), "all")


def test_a_scene_is_named_or_numbered(samples):
    assert [choose(samples, which).record["name"] for which in (None, 0, 2, "scene-0001")] == [
        "scene-0000", "scene-0000", "scene-0002", "scene-0001",
    ]  # fmt: skip
    assert len(choose(samples, 1).tokens) == 2
    with pytest.raises(ValueError, match="there is no scene=scene-002 in the split; did you mean scene-0002"):
        choose(samples, "scene-002")
    for number in (3, -1):
        with pytest.raises(ValueError, match=f"scene={number}: the split has scenes 0 to 2"):
            choose(samples, number)


def test_a_recording_that_exists_is_kept(samples, tmp_path):
    scene = choose(samples, 1)
    path = output(str(tmp_path / "new" / "a.rrd"), scene, overwrite=False)
    assert path.parent.is_dir()
    path.write_bytes(b"")
    with pytest.raises(ValueError, match=r"a.rrd exists; pass out=ANOTHER.rrd, or overwrite=true"):
        output(str(path), scene, overwrite=False)
    assert output(str(path), scene, overwrite=True) == path
    with pytest.raises(ValueError, match=r"end it with .rrd"):
        output(str(tmp_path / "a.mp4"), scene, overwrite=False)
    assert output(None, scene, overwrite=True).name == "scene-0001.rrd"


def test_subsets_are_of_the_sensors_that_the_detector_has():
    sensors = ["camera", "lidar", "radar"]
    assert subsets_of(None, sensors) == {"C+L+R": ("camera", "lidar", "radar")}
    assert subsets_of(None, ["lidar", "radar"]) == {"L+R": ("lidar", "radar")}
    assert [*subsets_of(["L", "C+R"], sensors).values()] == [("lidar",), ("camera", "radar")]
    with pytest.raises(ValueError, match=r"unknown subset 'C\+L'; did you mean"):
        subsets_of("C+L", ["lidar", "radar"])


def test_without_the_extra_the_command_says_how_to_install_it(monkeypatch):
    monkeypatch.setattr(check, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"python -m pip install -c constraints.txt -e '.\[rerun\]'"):
        check.check_recording(composed("rerun_log"))


def test_the_colouring_is_one_that_there_is(monkeypatch):
    monkeypatch.setattr(check, "find_spec", lambda name: name)
    cfg = composed("rerun_log", "lidar_color=hight")
    assert OmegaConf.is_missing(cfg, "run")
    with pytest.raises(ValueError, match="did you mean 'height'"):
        check.check_recording(cfg)


def test_detections_are_those_of_the_sensors_that_are_given_and_have_the_numbers_of_all_classes(samples):
    dataset = NuScenesDataset(
        str(samples[0][0].root), "all", grid=small_model.GRID, classes=["pedestrian", "car"], datasets=[samples[0][0]]
    )
    model = small_model.small_model().eval()
    trained = SimpleNamespace(model=lambda: model, cfg=OmegaConf.create({"trainer": {"precision": "float32"}}))
    scene = choose(samples, "scene-0001")
    found = detect(trained, dataset, scene, subsets_of(["C+L+R", "L"], list(model.encoders)), min_score=0.0)
    assert {name: len(boxes) for name, boxes in found.items()} == {"C+L+R": 2, "L": 2}
    labels = {CLASSES[k] for boxes in found["C+L+R"] for k in boxes.label}
    assert labels <= {"pedestrian", "car"}
    assert labels
    assert found["C+L+R"][0].score.tolist() != found["L"][0].score.tolist()
    none = detect(trained, dataset, scene, subsets_of(None, ["lidar"]), min_score=1.0)
    assert [len(boxes) for boxes in none["L"]] == [0, 0]


@pytest.mark.slow  # as the extra is installed for those
def test_the_command_records_a_scene_without_a_detector(samples, tmp_path, capsys):
    pytest.importorskip("rerun", reason="the extra is not installed: python -m pip install -e '.[rerun]'")
    nusc, token = samples[-1]
    sweep = nusc.path(nusc.keyframes[token]["LIDAR_TOP"])
    sweep.write_bytes(b"")  # the LiDAR is dead at the last keyframe, and nothing is labelled at all
    np.save(sweep.with_name(sweep.name.replace(".pcd.bin", ".time.npy")), np.zeros(0, np.float32))
    settings = [f"data.root={nusc.root}", "scene=2", f"out={tmp_path}/new/a.rrd"]
    path = record(composed("rerun_log", *settings, "sweeps=false"))
    printed = capsys.readouterr().out
    assert "scene-0002, 2 keyframes, 10 readings" in printed
    assert printed.strip().endswith(f"open it with: rerun {path}")
    size = path.stat().st_size
    with pytest.raises(ValueError, match="overwrite=true"):
        record(composed("rerun_log", *settings))
    record(composed("rerun_log", *settings, "overwrite=true"))
    assert path.stat().st_size > size  # with all sweeps
    assert [file.name for file in path.parent.iterdir()] == ["a.rrd"]
