"""The samples of a cell: what a fault makes of them, without decoding a file twice, and which scenes stand for all."""

import numpy as np
import pytest

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.fault_effects import Dead, Mismount
from fusion_net.common.faults import Fault
from fusion_net.data.datamodule import NuScenesDataset, collate
from fusion_net.evaluation.cells.cell import Cell
from fusion_net.evaluation.cells.plan import SOUND
from fusion_net.evaluation.cells.samples import CellSamples, thinned
from fusion_net.nuscenes import sensor_files
from fusion_net.nuscenes.kept_files import keeping_files
from tests.fixtures.training_setup import write_data

GRID = BEVGrid(2.0, 32.4, -12.8, 16.0, 0.8)
TURNED = Cell(group="g", name="n", faults=(Fault(sensors=["lidar"], effect=Mismount(rotation_deg=[0.0, 0.0, 2.0])),))


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return str(write_data(tmp_path_factory.mktemp("data") / "tree", scenes=5))


@pytest.fixture(scope="module")
def samples(root):
    return CellSamples(NuScenesDataset(root, "all", grid=GRID), scenes=2, resamples=3)


def test_a_cell_holds_what_the_dataset_with_that_fault_gives(root, samples):
    faulty = NuScenesDataset(root, "all", grid=GRID, faults=list(TURNED.faults))
    with keeping_files():
        samples.batches(SOUND)
        batch = samples.batches(TURNED)[0]
    places = [token for _, token in faulty.index]
    expected = collate([faulty[places.index(token)] for token in batch.tokens])
    assert np.array_equal(batch.lidar_points, expected.lidar_points)
    assert np.array_equal(batch.images, expected.images)
    assert np.array_equal(batch.radar_points, expected.radar_points)


def test_no_file_is_decoded_twice(samples, monkeypatch):
    read = []
    monkeypatch.setattr(
        sensor_files.cv2, "imdecode", lambda *args, own=sensor_files.cv2.imdecode: read.append(1) or own(*args)
    )
    with keeping_files():
        samples.batches(SOUND)
        once = len(read)
        samples.batches(TURNED)
    assert once > 0
    assert len(read) == once


def test_a_sensor_that_dies_silently_is_said_to_be_there_and_gives_nothing(samples):
    fault = (Fault(sensors=["lidar"], effect=Dead()),)
    known, silent = (
        samples.batches(Cell(group="g", name="n", faults=fault, silent=silent))[0] for silent in (False, True)
    )
    assert known.present[:, 1].any().item() is False
    assert silent.present.all()
    assert len(known.lidar_points) == len(silent.lidar_points) == 0


def test_scenes_are_thinned_evenly_over_conditions():
    class Tree:
        def scene(self, token):
            number = int(token) // 2
            return {
                "token": str(number),
                "name": f"s{number:02d}",
                "condition": {"name": "fog" if number % 4 == 0 else "clear", "severity": 1},
            }

    index = [(Tree(), str(token)) for token in range(80)]
    kept = thinned(index, 8)
    numbers = [int(token) // 2 for _, token in kept]
    assert len(kept) == 16
    assert sum(number % 4 == 0 for number in set(numbers)) == 2
    assert kept == sorted(kept, key=lambda pair: int(pair[1]))
    assert thinned(index, None) == thinned(index, 99) == index
    with pytest.raises(ValueError, match="scenes=0 is no number of scenes; use 1 to 40"):
        thinned(index, 0)


def test_a_rig_tells_which_sensors_a_cell_cannot_touch(samples):
    side = Cell(group="g", name="n", faults=(Fault(sensors=["RADAR_BACK_LEFT", "lidar"], effect=Dead()),))
    assert samples.lacks(side) == ["RADAR_BACK_LEFT"]
    assert samples.lacks(TURNED) == []
