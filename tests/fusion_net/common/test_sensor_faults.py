"""What a fault is and which sensors it hits, and the words for one that cannot be."""

import numpy as np
import pytest

from fusion_net.common.fault_effects import (
    BlockedLens,
    Dead,
    FewerBeams,
    LostPoints,
    LostSector,
    Mismount,
    Rings,
    Stale,
)
from fusion_net.common.faults import Fault, FaultPlan
from fusion_net.common.random import stream

SIX = {f"CAM_{k}": "camera" for k in "ABCDEF"} | {"LIDAR_TOP": "lidar"}


def dead_channels(fault, samples, *, seed=0, channels=SIX):
    plan = FaultPlan([fault], seed)
    return [{c for c in channels if plan.on(c, channels, scene="s", sample=f"{k}").dead} for k in range(samples)]


def test_a_draw_a_scene_holds_for_it_and_a_draw_a_sample_does_not():
    lasting = dead_channels(Fault(sensors=["camera"], effect=Dead(), count=2), 20)
    assert len({frozenset(dead) for dead in lasting}) == 1
    assert len(lasting[0]) == 2
    fleeting = dead_channels(Fault(sensors=["camera"], effect=Dead(), count=2, per="sample"), 20)
    assert {len(dead) for dead in fleeting} == {2}
    assert len({frozenset(dead) for dead in fleeting}) > 5


def test_each_sensor_has_a_coin_of_its_own():
    dead = dead_channels(Fault(sensors=["camera"], effect=Dead(), probability=0.4, per="sample"), 400)
    assert np.mean([len(each) for each in dead]) == pytest.approx(6 * 0.4, abs=0.2)
    assert {len(each) for each in dead} >= {0, 1, 2, 3, 4, 5}


def test_draws_follow_from_the_seed_and_not_from_other_sensors():
    fault = Fault(sensors=["camera"], effect=Dead(), probability=0.5, per="sample")
    assert dead_channels(fault, 30) == dead_channels(fault, 30)
    assert dead_channels(fault, 30) != dead_channels(fault, 30, seed=1)
    only = {"CAM_C": "camera"}
    assert [each & {"CAM_C"} for each in dead_channels(fault, 30)] == dead_channels(fault, 30, channels=only)


def test_a_channel_or_a_modality_may_be_named():
    assert dead_channels(Fault(sensors=["CAM_B"], effect=Dead()), 1) == [{"CAM_B"}]
    assert dead_channels(Fault(sensors=["lidar", "CAM_B"], effect=Dead()), 1) == [{"LIDAR_TOP", "CAM_B"}]


@pytest.mark.parametrize("beams", [16, 32, 64, 40])
def test_evenly_spaced_beams_are_left_of_any_lidar(beams):
    ring = np.arange(beams)
    for keep in range(1, beams):
        kept = FewerBeams(keep=keep).kept(np.zeros(beams), Rings(ring, beams), stream(0), stream(0))
        assert kept.sum() == keep
        assert kept[0]
        steps = np.diff(np.append(ring[kept], beams))
        assert np.ptp(steps) <= 1
        if beams % keep == 0:
            np.testing.assert_array_equal(kept, ring % (beams // keep) == 0)


@pytest.mark.parametrize(
    ("wrong", "answer"),
    [
        (lambda: FewerBeams(keep=0), "keep=0 is below 1"),
        (lambda: LostPoints(fraction=70), r"fraction=70 is not within \[0, 1\]"),
        (lambda: BlockedLens(fraction=-0.1), r"fraction=-0.1 is not within \[0, 1\]"),
        (lambda: LostSector(width_deg=-5), "width_deg=-5 is below 0"),
        (lambda: Stale(firings=-1), "firings=-1 is below 0"),
        (lambda: Mismount(rotation_deg=[1.0]), r"rotation_deg=\[1.0\] is not three numbers"),
        (lambda: Fault(sensors=["camera"], effect=FewerBeams(keep=8)), "FewerBeams cannot act on 'camera'; use lidar"),
        (
            lambda: Fault(sensors=["CAM_FRONT"], effect=LostPoints(fraction=0.1)),
            "cannot act on 'CAM_FRONT'; use lidar or radar",
        ),
        (lambda: Fault(sensors=["lidra"], effect=Dead()), "Dead cannot act on 'lidra'; use camera or lidar or radar"),
        (lambda: Fault(sensors=["lidar"], effect=Dead(), count=0), "count=0 hits nothing; use 1 or more"),
        (lambda: Fault(sensors=["lidar"], effect=Dead(), probability=2), r"probability=2 is not within \[0, 1\]"),
    ],
)
def test_a_fault_that_cannot_be_says_what_can(wrong, answer):
    with pytest.raises(ValueError, match=answer):
        wrong()
