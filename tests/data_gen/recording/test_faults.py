"""Faults written at generation, and the same ones on the fly on a clean tree of the same world."""

import numpy as np
import pytest

from fusion_net.common.fault_effects import (
    BlockedLens,
    Clock,
    Dead,
    FewerBeams,
    LostPoints,
    LostSector,
    Mismount,
    Stale,
)
from fusion_net.common.faults import Fault
from fusion_net.common.geometry import project
from tests.fixtures.faulty_recording import KEYFRAMES, RIG, SPEED, read, wall_line

LEFT = Fault(sensors=["lidar"], effect=Mismount(rotation_deg=[0.0, 0.0, 0.5]))


def test_a_mounting_error_of_half_a_degree_turns_the_cloud_alike_both_ways(make, clean):
    written, on_the_fly, right = read(make(LEFT)), read(clean, LEFT), read(clean)
    turned = [np.degrees(wall_line(sample)[0] - wall_line(right)[0]) for sample in (written, on_the_fly)]
    assert turned == pytest.approx([-0.5, -0.5], abs=0.02)  # the sensor looks left, so the world seems to lie right
    assert wall_line(written)[1] == pytest.approx(wall_line(on_the_fly)[1], abs=0.01)
    assert abs(wall_line(written)[1] - wall_line(right)[1]) > 0.05


def test_half_a_degree_is_9_pixels_at_a_focal_length_of_1000_eight_metres_ahead(clean):
    """The lesson's number: 1000 px x tan(0.5 degrees) = 8.7 px; 7 cm at 8 m."""
    spoiled, right = read(clean, LEFT), read(clean)
    K = np.array([[1000.0, 0, 800], [0, 1000.0, 450], [0, 0, 1]])
    places = [sample.lidar_points[:, :3] - (RIG.lidars["LIDAR_TOP"].translation) for sample in (spoiled, right)]
    ahead = np.hypot(places[1][:, 1], places[1][:, 2]) < 0.02 * places[1][:, 0]
    optical = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    (moved, _), (pixel, _) = (project(K, (8 * p[ahead] / p[ahead, :1]) @ optical.T) for p in places)
    np.testing.assert_allclose(moved[:, 0] - pixel[:, 0], 8.73, atol=0.05)


@pytest.mark.parametrize(
    "fault",
    [
        Fault(sensors=["lidar"], effect=FewerBeams(keep=8)),
        Fault(sensors=["LIDAR_TOP"], effect=LostPoints(fraction=0.8)),
        Fault(sensors=["lidar"], effect=LostSector(width_deg=40, spread_deg=30)),
        Fault(sensors=["radar"], effect=LostSector(width_deg=30, center_deg=25)),
        Fault(sensors=["radar"], effect=LostPoints(fraction=0.5)),
        Fault(sensors=["radar"], effect=Dead(), count=1),
        Fault(sensors=["lidar"], effect=Dead(), probability=0.5, per="sample"),
        Fault(sensors=["camera"], effect=Dead(), probability=0.5, per="sample"),
        Fault(sensors=["camera"], effect=Dead()),
        Fault(sensors=["lidar"], effect=Stale(), probability=0.5, per="sample"),
    ],
    ids=lambda fault: f"{type(fault.effect).__name__}-{fault.sensors[0]}-{fault.per}",
)
def test_what_is_taken_away_is_the_same_both_ways_to_the_last_point(make, clean, fault):
    tree = make(fault)
    changed = 0
    for place in range(KEYFRAMES):
        written, on_the_fly = read(tree, place=place), read(clean, fault, place=place)
        healthy = read(clean, place=place)
        np.testing.assert_array_equal(written.present, on_the_fly.present)
        for name in ("lidar_points", "radar_points", "images"):
            np.testing.assert_array_equal(getattr(written, name), getattr(on_the_fly, name), err_msg=name)
            changed += not np.array_equal(getattr(written, name), getattr(healthy, name))
        np.testing.assert_array_equal(written.boxes.center, healthy.boxes.center)  # faults change no label
    assert changed >= 1


def test_a_beam_in_four_is_left(clean):
    path = clean.path(clean.reference(clean.split("all")[1]))
    rings = np.fromfile(path, "<f4").reshape(-1, 5)[:, 4]
    left = read(clean, Fault(sensors=["lidar"], effect=FewerBeams(keep=8)))
    assert len(left.lidar_points) == (rings % 4 == 0).sum()
    assert 0 < len(left.lidar_points) < len(rings)


def test_mud_hides_its_share_of_the_image_in_one_place_for_the_scene(make, clean):
    mud = Fault(sensors=["camera"], effect=BlockedLens(fraction=0.3))
    tree = make(mud)
    hidden = []
    for place in range(2):
        written, on_the_fly, right = (
            read(*with_, place=place).images[0] for with_ in ((tree,), (clean, mud), (clean,))
        )
        hidden.append((on_the_fly != right).any(axis=-1))
        assert hidden[-1].mean() == pytest.approx(0.3, abs=0.03)
        assert np.abs(written[hidden[-1]].astype(float) - on_the_fly[hidden[-1]]).mean() < 6  # JPEG blurs the rim
    np.testing.assert_array_equal(*hidden)


@pytest.mark.parametrize("offset", [0.1, 0.04, -0.1])
def test_a_clock_that_is_ahead_moves_what_stands_still_by_the_way_driven_meanwhile(make, clean, offset):
    """At 20 m/s a LiDAR that is 100 ms ahead sees the wall 2 m too far away, both ways."""
    fault = Fault(sensors=["lidar"], effect=Clock(offset=offset))
    tree = make(fault)
    right, written, on_the_fly = (wall_line(read(*with_))[1] for with_ in ((clean,), (tree,), (clean, fault)))
    expected = SPEED * offset * np.sin(np.radians(30))
    assert abs(written - right) == pytest.approx(abs(expected), abs=0.02)
    assert on_the_fly == pytest.approx(written, abs=0.02)
    for record in tree.tables["sample_data"].values():
        error = (record["timestamp"] - record["true_timestamp"]) * 1e-6
        assert error == pytest.approx(offset if tree.channel(record) == "LIDAR_TOP" else 0.0, abs=1e-6)


def test_a_turned_radar_takes_what_stands_beside_the_road_for_moving_both_ways(make, clean):
    """One that looks 3 degrees further left than believed measures -v cos(a + 3 degrees) where it expects -v cos(a)."""
    fault = Fault(sensors=["RADAR_FRONT"], effect=Mismount(rotation_deg=[0, 0, 3.0]))

    def radial_speed(*with_):
        """Of the reflectors that the front radar sees: azimuth from the car's axis and ground radial speed."""
        radar = read(*with_, radar_sweeps=0, propagate_radar=False).radar_points
        radar = radar[(radar[:, 6] < 0.01) & (radar[:, 3] > 5)]
        azimuth = np.arctan2(radar[:, 1] - 0.1, radar[:, 0] - 3.4)
        return azimuth, np.cos(azimuth) * radar[:, 4] + np.sin(azimuth) * radar[:, 5]

    right = radial_speed(clean)[1]
    for with_ in ((make(fault),), (clean, fault)):
        azimuth, speed = radial_speed(*with_)
        expected = SPEED * (np.cos(azimuth) - np.cos(azimuth + np.radians(3)))
        np.testing.assert_allclose(speed - right, expected, atol=0.05)
        assert expected.max() > 0.6


def test_a_shaking_mount_is_drawn_anew_each_sample_and_alike_both_ways(make, clean):
    shake = Fault(sensors=["lidar"], effect=Mismount(rotation_deg=[0, 0, 1.0], random=True), per="sample")
    tree = make(shake)
    turned = np.degrees(
        [[wall_line(read(*with_, place=k))[0] - wall_line(read(clean, place=k))[0] for k in range(3)]
         for with_ in ((tree,), (clean, shake))]
    )  # fmt: skip
    np.testing.assert_allclose(turned[0], turned[1], atol=0.03)
    assert np.ptp(turned[0]) > 0.2
