"""Parameters that hang on a sensor, and bytes that go where sensors meet, of a network whose parts are known."""

import pytest

from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.cells.costs import dependent_parameters, input_bytes, merged_bytes, stage_times
from tests.fixtures.small_model import CHANNELS, GRID, small_batch, small_early_model, small_late, small_model


@pytest.fixture(scope="module")
def model():
    return small_model(depth_source="learned").eval()


def size(module):
    return sum(parameter.numel() for parameter in module.parameters())


@pytest.mark.parametrize("sensor", MODALITIES)
def test_what_hangs_on_a_sensor_is_its_encoder_and_all_that_comes_after(model, sensor):
    hanging, everything = dependent_parameters(model, small_batch(), sensor)
    after = size(model.fuser) + size(model.decoder) + size(model.head)
    assert everything == size(model)
    flags = model.fuser.flags.weight.numel()  # of which sensors are there: the same whatever they see
    assert hanging == after + size(model.encoders[sensor]) - flags


def test_maps_go_to_the_fuser_and_are_larger_than_what_the_radar_gives(model):
    batch = small_batch()
    rows, columns = GRID.shape
    merged, given = merged_bytes(model, batch), input_bytes(batch)
    assert set(merged) == set(MODALITIES)
    assert merged["radar"] == CHANNELS * rows * columns * 4
    assert given == {"camera": 48 * 80 * 3, "lidar": 300 * 5 * 4, "radar": 40 * 7 * 4}


def test_every_stage_takes_time_and_all_together_the_most(model):
    times = stage_times(model, small_batch())
    assert {"camera encoder", "lidar encoder", "radar encoder", "fuser", "decoder", "head", "decoding", "total"} <= set(
        times
    )
    assert min(times.values()) > 0
    assert sum(value for name, value in times.items() if name != "total") <= 1.3 * times["total"]


def test_early_fusion_merges_class_scores_and_points_and_hangs_on_each_of_them():
    model, batch = small_early_model().eval(), small_batch()
    merged = merged_bytes(model, batch)
    rows, columns = GRID.shape
    assert merged["camera"] == 2 * (48 // 8) * (80 // 8) * 4
    assert merged["lidar"] == input_bytes(batch)["lidar"]
    assert merged["radar"] == CHANNELS * rows * columns * 4
    hanging = {name: dependent_parameters(model, batch, name)[0] for name in MODALITIES}
    assert hanging["camera"] > hanging["lidar"]  # the painted points' encoder hangs on both


def test_late_fusion_merges_boxes_and_nothing_hangs_on_two_sensors():
    model, batch = small_late().eval(), small_batch()
    merged = merged_bytes(model, batch)
    assert set(merged) == set(MODALITIES)
    assert 0 < merged["lidar"] <= 200 * 100 * 4
    hanging = {name: dependent_parameters(model, batch, name)[0] for name in MODALITIES}
    assert all(hanging[name] <= size(model.detectors[name]) for name in MODALITIES)
    assert sum(hanging.values()) > 0.9 * size(model)
    assert {"camera detector", "lidar detector", "radar detector", "decoding"} <= set(stage_times(model, batch))
