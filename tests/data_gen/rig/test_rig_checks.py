import json
import re

import pytest

from data_gen.road.ego import EGO_OUTLINE
from tests.fixtures.lidar_models import HDL64E, VLP16
from tests.fixtures.small_rig import camera, lidar, radar, rig


def with_camera(**changes):
    return rig(cameras={"CAM_FRONT": camera(**changes)})


def with_lidar(**changes):
    return rig(lidars={"LIDAR_TOP": lidar(**changes)})


def with_radar(**changes):
    return rig(radars={"RADAR_FRONT": radar(**changes)})


TURNED_IN = {"translation": [2.4, 0.8, 0.7], "rotation_deg": [0.0, 0.0, -90.0]}
TURNED_DOWN = TURNED_IN | {"rotation_deg": [0.0, 90.0, 0.0]}
IMPOSSIBLE = [
    (with_radar, {"translation": [4.2, 0.0, -1.0]}, "is under the ground", "[4.2,0.0,0.1]"),
    (with_camera, {"translation": [1.7, 0.1, -0.3]}, "translation=[1.7,0.1,-0.3] is under the ground", "[1.7,0.1,0.9]"),
    (with_camera, {"translation": [1.0, 0.0, 0.5]}, "looks through 2.9 m of the car's own body", "[3.85,0.0,0.5]"),
    (with_camera, {"translation": [1.7, 0.1]}, "is not three numbers", "[1.7,0.1,1.5]"),
    (with_camera, {"hfov_deg": 0.0}, "cameras.CAM_FRONT.hfov_deg=0.0 is no field of view", "CAM_FRONT.hfov_deg=1.0"),
    (with_camera, {"hfov_deg": 200.0}, "hfov_deg=200.0 is no field of view", "hfov_deg=170.0"),
    (with_camera, {"height": 0}, "height=0 is not a number of pixels", "height=1"),
    (with_camera, {"principal": [900.0, 16.0]}, "principal=[900.0,16.0] is not a pixel", "principal=[32.0,16.0]"),
    (with_camera, {"rate": 0.0}, "rate=0.0 Hz gives no reading for every keyframe", "rate=2.0"),
    (with_camera, {"phase": 0.04}, "phase=0.04 s is not within a period", "phase=0.00667"),
    (with_camera, {"jitter": 0.02}, "jitter=0.02 s is not within", "jitter=0.00333"),
    (with_lidar, {"translation": [0.9, 0.0, 0.0]}, "is less than 0.1 m over the ground", "[0.9,0.0,1.5]"),
    (with_lidar, {"sector_deg": [40.0, -40.0]}, "sector_deg=[40.0,-40.0] is no sector", "sector_deg=[-40.0,40.0]"),
    (with_lidar, {"columns": 0}, "columns=0 is not a number of columns", "columns=1"),
    (with_lidar, {"columns": 3000}, "columns=3000 is not a number of columns that the HDL-32E fires in a turn", "columns=2170"),
    (with_lidar, {"columns": 2000, "model": VLP16}, "that the VLP-16 fires in a turn of 1/10 s", "columns=1808"),
    (with_lidar, {"columns": 2170, "model": HDL64E}, "that the HDL-64E fires in a turn of 1/10 s", "columns=2083"),
    (with_lidar, {"crosstalk": 1.5}, "LIDAR_TOP.crosstalk=1.5 is not within [0, 1]", "crosstalk=1.0"),
    (with_radar, {"translation": [0.5, 0.0, 0.5]}, "FRONT.translation=[0.5,0.0,0.5] looks through 3.4 m", "[3.85,0.0,0.5]"),
    (with_radar, TURNED_IN, "looks through 1.8 m", "[2.4,-1.0,0.7]"),
    (with_radar, TURNED_DOWN, "looks into the car's own body", "[2.4,0.8,1.5]"),
    (with_radar, {"fov_deg": 0.0}, "fov_deg=0.0 is no half-angle", "fov_deg=1.0"),
    (with_radar, {"range_resolution": 0.0}, "range_resolution=0.0 is less than 0.1", "range_resolution=0.1"),
    (rig, {"keyframe_rate": 0.0}, "keyframe_rate=0.0 Hz gives no keyframes", "rig.keyframe_rate=2.0"),
    (rig, {"keyframe_rate": 4.0}, "keyframe_rate=4.0 Hz is not reached", "rig.keyframe_rate=5.0"),
    (rig, {"sweeps": {"radar": -1}}, "sweeps.radar=-1 is not a number of firings", "rig.sweeps.radar=0"),
    (rig, {"sweeps": {"lidar": 50}}, "sweeps.lidar=50 is not a number of firings", "rig.sweeps.lidar=8"),
    (rig, {"sweeps": {"lidar": "most"}}, "sweeps.lidar=most is neither a number of firings nor all", "rig.sweeps.lidar=all"),
    (with_radar, {"rate": 2.0, "jitter": 0.01}, "jitter=0.01 s leaves keyframes without a reading", "FRONT.jitter=0.0"),
    (with_radar, {"rate": 2.5, "jitter": 0.02}, "are up to 0.56 s apart, keyframes 0.5 s", "FRONT.jitter=0.0125"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "changes", "said", "nearest"), IMPOSSIBLE)
def test_what_no_car_has_is_one_line_with_the_nearest_value_that_works(make, changes, said, nearest):
    with pytest.raises(ValueError, match=re.escape(said)) as error:
        make(**changes)
    text = str(error.value)
    assert "\n" not in text
    assert f"the nearest that works is rig.{text.split('=')[0]}=" in text
    assert nearest in text
    assert text.endswith("python -m data_gen.pictures.rig_preview rig=mine")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"cameras": {}, "lidars": {}, "radars": {}}, "are all empty"),
        ({"lidars": {}}, "has no LIDAR_TOP"),
        ({"cameras": {"FRONT": camera()}}, "cameras.FRONT is no name of nuScenes for it, CAM_...: call it CAM_FRONT"),
        ({"radars": {"RADAR_front left": radar()}}, "call it RADAR_FRONT_LEFT"),
        ({"cameras": {"CAM_A": camera(), "CAM_B": camera()}}, "cameras.CAM_B is CAM_A again"),
        ({"sweeps": {"radars": 1}}, "sweeps.radars=1 is no modality"),
    ],
)
def test_rigs_that_are_none(changes, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        rig(**changes)


@pytest.mark.parametrize(("make", "changes"), [(make, changes) for make, changes, *_ in IMPOSSIBLE if make is not rig])
def test_the_nearest_value_does_work(make, changes):
    with pytest.raises(ValueError, match="nearest") as error:
        make(**changes)
    key, value = re.search(r"nearest that works is rig\.\w+\.\w+\.(\w+)=(\S+);", str(error.value)).groups()
    make(**(changes | {key: json.loads(value)}))


def test_a_sensor_may_sit_behind_a_bumper_and_a_camera_behind_a_window():
    with_radar(translation=[EGO_OUTLINE[0][1] - 0.5, 0.3, 0.5])
    with_radar(translation=[0.0, EGO_OUTLINE[1][1] - 0.2, 0.6], rotation_deg=[0.0, 0.0, 90.0])
    with_camera(translation=[2.0, 0.0, 1.3])


def test_any_number_of_sensors_is_a_rig():
    rig(cameras={}, radars={})
    rig(cameras={f"CAM_{i}": camera(rotation_deg=[0.0, 0.0, 24.0 * i], width=8 * i + 8, height=40) for i in range(15)})
