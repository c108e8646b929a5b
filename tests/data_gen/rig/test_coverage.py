import math
from dataclasses import replace

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from data_gen.pictures.rig_drawing import draw
from data_gen.pictures.rig_preview import table
from data_gen.rig.coverage import FRONT, gaps, sector_covered
from fusion_net.common.cli.command import CONFIGS, build
from tests.fixtures.lidar_models import HDL32E, shipped
from tests.fixtures.small_rig import camera, lidar, radar, rig


def from_config(name):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        return build(compose("data_gen", overrides=[f"rig={name}"]).rig, "rig")


@pytest.fixture(scope="module")
def surround():
    return from_config("surround")


def test_nano_fills_the_view_that_its_traffic_was_tuned_for():
    assert sector_covered(from_config("nano")) == FRONT


def test_surround_looks_all_round(surround):
    assert sector_covered(surround).half == pytest.approx(math.pi)
    for mounts in (surround.cameras, surround.lidars, surround.radars):
        edges = [[mount.rotation_deg[2] + edge for edge in mount.azimuth_range_deg] for mount in mounts.values()]
        assert gaps(edges) == []


def test_a_rig_that_looks_back_fills_what_is_behind():
    back = rig(cameras={"CAM_BACK": camera(rotation_deg=[0.0, 0.0, 179.0], hfov_deg=80.0)})
    assert sector_covered(back).center == pytest.approx(math.radians(179))
    assert sector_covered(back).half == pytest.approx(math.radians(40))


def test_without_cameras_the_lidar_says_where_to_look():
    found = sector_covered(rig(cameras={}, lidars={"LIDAR_TOP": lidar(sector_deg=[-30.0, 60.0])}))
    assert found.center == pytest.approx(math.radians(15))
    assert found.half == pytest.approx(math.radians(45))


def test_gaps_are_what_the_sectors_leave_across_the_cut_too():
    assert gaps([]) == [(-180.0, 180.0)]
    assert gaps([(-180.0, 180.0)]) == []
    assert gaps([(170.0, 190.0), (-20.0, 20.0)]) == [(190.0, 340.0), (380.0, 530.0)]
    assert gaps([(10.0, 30.0), (-10.0, 40.0)]) == [(40.0, 350.0)]


def test_cameras_fire_as_the_beam_passes_and_look_where_nuscenes_looks(surround):
    """Phase by the LiDAR's turn: clockwise from the cut at 105 degrees, 0.1 s a turn."""
    yaws = {"FRONT": 0, "FRONT_LEFT": 55, "FRONT_RIGHT": -55, "BACK": 180, "BACK_LEFT": 110, "BACK_RIGHT": -110}
    for place, yaw in yaws.items():
        mount = surround.cameras[f"CAM_{place}"]
        assert abs((mount.rotation_deg[2] - yaw + 180) % 360 - 180) < 2
        passes = (surround.lidars["LIDAR_TOP"].cut_deg - mount.rotation_deg[2]) % 360 / 360 * 0.1
        assert mount.phase == pytest.approx(passes % (1 / 30), abs=5e-5)
    phases = sorted(radar.phase for radar in surround.radars.values())
    assert phases == pytest.approx([0.006, 0.016, 0.026, 0.036, 0.046])  # clear of the LiDAR's stamps


def test_focal_lengths_are_those_of_nuscenes_scaled(surround):
    for place, fx in (
        ("FRONT", 1266.4),
        ("FRONT_LEFT", 1272.6),
        ("FRONT_RIGHT", 1260.8),
        ("BACK", 809.2),
        ("BACK_LEFT", 1256.7),
    ):
        assert surround.cameras[f"CAM_{place}"].cam_K[0, 0] == pytest.approx(0.22 * fx, rel=1e-3)


def test_sees_goes_by_frustum_sector_and_range():
    front = camera(rotation_deg=[0.0, 0.0, 90.0])  # looks left
    assert front.sees([[1.7, 10, 1.5], [10, 0.1, 1.5], [1.7, -10, 1.5], [1.7, 10, 9.0]]).tolist() == [
        True,
        False,
        False,
        False,
    ]
    top = lidar(sector_deg=[-40.0, 40.0], rotation_deg=[0.0, 0.0, -90.0], model=replace(HDL32E, max_range=50.0))
    assert top.sees([[0.9, -20, 1.8], [20, 0.0, 1.8], [0.9, -60, 1.8], [0.9, -2, 0.0]]).tolist() == [
        True,
        False,
        False,
        False,
    ]
    assert radar(fov_deg=10.0).sees([[30, 1, 0.5], [30, 20, 0.5]]).tolist() == [True, False]


def test_the_nearest_ground_is_height_over_the_tangent_of_the_lowest_ray():
    level = camera(principal=[32.0, 16.0])
    assert level.nearest_ground == pytest.approx(1.5 * level.cam_K[1, 1] / 16)
    tipped = camera(rotation_deg=[0.0, 10.0, 40.0])
    assert tipped.nearest_ground < level.nearest_ground / 1.5
    assert lidar().nearest_ground == pytest.approx(1.8 / math.tan(math.radians(30.67)), rel=1e-3)
    assert camera(rotation_deg=[0.0, -40.0, 0.0]).nearest_ground == math.inf


@pytest.mark.parametrize("model", ["hdl32e", "vlp16", "hdl64e"])
def test_the_nearest_ground_and_the_table_follow_the_lidars_beams(model):
    mount = lidar(model=shipped(model))
    lowest = min(mount.model.elevation_deg)
    assert mount.nearest_ground == pytest.approx(1.8 / math.tan(math.radians(-lowest)), rel=1e-3)
    lines = table(rig(lidars={"LIDAR_TOP": mount})).splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith(f"LIDAR_TOP: {mount.model.name}, "))
    angles = [float(word) for line in lines[at + 1 :] if line.startswith("  ") for word in line.split()]
    assert angles == sorted(mount.model.elevation_deg)
    assert f"{mount.model.beams} x 180" in table(rig(lidars={"LIDAR_TOP": mount}))


def test_the_table_has_a_line_a_sensor_and_says_where_nothing_looks(surround):
    lines = table(surround).splitlines()
    assert [line.split()[0] for line in lines[1:13]] == list(surround.sensors)
    assert "cameras see 360 of 360 degrees" in lines
    assert "cameras see 70 of 360 degrees; blind from 35 to -35 degrees" in table(rig())


@pytest.mark.parametrize("changes", [{}, {"cameras": {}, "radars": {}}])
def test_the_picture_is_drawn_for_any_rig(changes, tmp_path):
    import cv2

    draw(rig(**changes), tmp_path / "rig.png")
    assert np.std(cv2.imread(str(tmp_path / "rig.png"))) > 10
