"""The receiver alone: from given reflections to detections."""

import numpy as np
import pytest

from data_gen.sensors.radar.detection import DIRECT, NEAR, NOISE_FLOOR, THRESHOLD, Echoes, detect, link_budget_db
from fusion_net.common.random import stream
from tests.fixtures.radar_world import CELL, RADAR, sigma


def echoes(range_=50.0, azimuth_deg=0.0, doppler=0.0, snr=1e4):
    values = np.broadcast_arrays(range_, np.radians(azimuth_deg), doppler, np.asarray(snr, float))
    columns = [np.atleast_1d(np.array(v, float)) for v in values]
    count = len(columns[0])
    return Echoes(*columns, np.arange(count, dtype=np.int32), np.full(count, DIRECT, np.uint8))


def detections(reflections, radar=RADAR, trials=300):
    """Number of detections in each of many scans of the same reflections."""
    return np.array([len(detect(reflections, radar, stream(2, k)).range) for k in range(trials)])


def test_detection_probability_is_nine_tenths_at_ten_dbsm_and_falls_with_the_fourth_power_of_range():
    def share(rcs, distance):
        snr = 10 ** ((rcs + link_budget_db(distance, 0.0, RADAR)) / 10)
        return detections(echoes(distance, 0.0, 0.0, snr), trials=1000).mean()

    # Three standard deviations of 1,000 coins: 0.028 at 0.9, 0.047 at 0.5.
    assert share(10, 100) == pytest.approx(0.9, abs=0.03)
    assert share(-8, 58) == pytest.approx(0.5, abs=0.05)
    assert share(2, 102) == pytest.approx(0.5, abs=0.05)
    assert share(10, 162) == pytest.approx(0.5, abs=0.05)
    assert link_budget_db(50.0, 0.0, RADAR) - link_budget_db(100.0, 0.0, RADAR) == pytest.approx(12.04, abs=0.01)
    assert link_budget_db(40.0, np.radians(60), RADAR) == pytest.approx(link_budget_db(40.0, 0.0, RADAR) - 6)


def test_near_by_the_least_cross_section_is_the_same_at_every_range():
    """The high-pass takes what r^-4 gives within half of the range: there a bush is no louder than at 50 m."""
    near = [float(link_budget_db(r, 0.0, RADAR)) for r in (1.0, 10.0, NEAR * RADAR.max_range)]
    assert near[1:] == near[:1] * 2
    least = 10 * np.log10(THRESHOLD) - near[0]
    assert least == pytest.approx(11.4 - 23.1, abs=0.1)  # 13.8 over the noise, where 0 dBsm has 11.1 + 12.04


def test_two_targets_one_degree_apart_are_one_detection_unless_their_speed_or_range_differs():
    strong = {"snr": 1e5}
    assert detections(echoes(50.0, [10.0, 11.0], **strong)).mean() == pytest.approx(1.0, abs=0.02)
    assert detections(echoes(50.0, [10.0, 15.0], **strong)).mean() == pytest.approx(2.0, abs=0.02)
    assert detections(echoes(50.0, [10.0, 11.0], [0.0, 3.0], **strong)).mean() == pytest.approx(2.0, abs=0.02)
    assert detections(echoes([50.0, 52.0], 10.0, **strong)).mean() == pytest.approx(2.0, abs=0.02)
    # One array resolves worse towards its sides: 5 degrees are apart ahead and together at 58.
    assert detections(echoes(50.0, [53.0, 58.0], **strong)).mean() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("axis", ["range", "azimuth", "doppler"])
def test_echoes_are_told_apart_from_one_and_a_half_cells_on(axis):
    for cells, count in ((1.4, 1), (1.6, 2)):
        step = dict.fromkeys(("range", "azimuth", "doppler"), 0.0) | {axis: cells}
        pair = echoes(
            [50.0, 50.0 + step["range"] * 0.4],
            [0.0, np.degrees(np.arcsin(step["azimuth"] * CELL[1]))],
            [0.0, step["doppler"] * 0.1],
            1e5,
        )
        assert detections(pair).mean() == pytest.approx(count, abs=0.02)


def test_a_cell_sums_power_and_lies_between_its_reflections():
    pair = echoes(50.0, [-1.0, 1.0], snr=np.array([3e4, 1e4]))
    found = [detect(pair, RADAR, stream(4, k)) for k in range(800)]
    snr = np.concatenate([f.snr for f in found])
    assert snr.mean() == pytest.approx(4e4, rel=0.11)  # three standard errors of an exponential variable
    # The share of the stronger one, U = 3a / (3a + b) with a, b exponential, has the mean 1.5 (1 - ln(3) / 2) = 0.676.
    azimuth = np.degrees(np.concatenate([f.azimuth for f in found]))
    assert azimuth.mean() == pytest.approx(1 - 2 * 0.676, abs=3 * azimuth.std() / np.sqrt(len(azimuth)))


@pytest.mark.parametrize(("azimuth_deg", "snr"), [(0.0, 1e5), (0.0, 30.0), (60.0, 1e5)])
def test_noise_follows_the_cell_the_snr_and_the_cosine(azimuth_deg, snr):
    """Each detection is off by cell (1 / sqrt(2 SNR) + floor), its own SNR counting; in azimuth 1 / cos as much."""
    found = Echoes.concatenate([detect(echoes(60.0, azimuth_deg, 5.0, snr), RADAR, stream(8, k)) for k in range(1600)])
    found = found[found.snr > snr / 2]
    expected = np.sqrt(np.mean(sigma(found.snr) ** 2, axis=0)) / (1, np.cos(np.radians(azimuth_deg)), 1)
    spread = [np.std(found.range), np.std(found.azimuth), np.std(found.doppler)]
    np.testing.assert_allclose(spread, expected, rtol=4 / np.sqrt(2 * len(found.range)))
    if snr == 1e5:
        np.testing.assert_allclose(expected[[0, 2]], (0.05 * 0.4, 0.05 * 0.1), rtol=0.1)
    np.testing.assert_array_equal(NOISE_FLOOR, (0.05, 0.3, 0.05))
