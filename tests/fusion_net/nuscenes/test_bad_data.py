"""Data that is damaged is named; data that merely lacks something is read."""

import numpy as np
import pytest

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.sensor_files import read_radar
from tests.fixtures.real_tree import edit
from tests.fixtures.tiny_tree import write_detections, write_tree

GRID = BEVGrid(0.0, 32.0, -12.8, 16.0, 0.8)


@pytest.fixture
def root(tmp_path):
    return write_tree(tmp_path / "tree", scenes=2, keyframes=2)


def test_a_record_without_a_field_names_table_record_and_field(root):
    edit(root, "sample_data", lambda row: bool(row.pop("filename")))
    with pytest.raises(ValueError, match=r"sample_data\.json: the record 'scene-0000-.*' has no filename"):
        NuScenes(root)


def test_a_radar_point_with_any_nan_is_left_out(tmp_path):
    columns = {name: np.ones(4) for name in ("x", "y", "rcs", "vx_comp", "vy_comp")}
    columns["x"][0] = columns["rcs"][1] = columns["vx_comp"][2] = np.nan
    write_detections(tmp_path / "a.pcd", **columns)
    assert len(read_radar(tmp_path / "a.pcd")) == 1


@pytest.mark.parametrize(("channel", "column"), [("CAM", 0), ("RADAR", 2)])
def test_a_sensor_without_records_is_dead_and_the_sample_is_read(root, channel, column):
    edit(root, "calibrated_sensor", lambda mount: mount.update(height=48, width=80))
    edit(root, "sample_data", lambda record: channel not in record["token"])
    dataset = NuScenesDataset(str(root), "all", grid=GRID)
    batch = dataset.collate([dataset[0], dataset[1]])
    assert not batch.present[:, column].any()
    assert batch.present.any(dim=1).all()


def test_a_keyframe_without_lidar_has_no_reference_and_is_named(root):
    edit(root, "sample_data", lambda row: "LIDAR" not in row["token"])
    with pytest.raises(ValueError, match=r"sample 'scene-0000-0' has no LIDAR_TOP keyframe"):
        NuScenesDataset(str(root), "all", grid=GRID)[0]


def test_a_sample_without_objects_has_empty_targets_and_the_split_is_known_to_have_none(root):
    dataset = NuScenesDataset(str(root), "all", grid=GRID)
    targets = dataset.collate([dataset[0]]).targets
    assert targets is not None
    assert not targets.mask.any()
    assert not dataset.has_labels()
