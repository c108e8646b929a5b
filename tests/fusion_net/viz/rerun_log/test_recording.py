"""A recording read back: what a viewer finds at a time, put together by the frames that it was logged in."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fusion_net.common.boxes import Boxes, points_in_box
from fusion_net.common.geometry import rigid, transform
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.viz.rerun_log.readings import Scene
from tests.fixtures.tiny_tree import (
    CAM_K,
    HEIGHT,
    LANDMARKS,
    MOVER_START,
    MOVER_VELOCITY,
    START,
    WIDTH,
    ego_pose,
    write_tree,
)

MISSING = "the extra is not installed: python -m pip install -c constraints.txt -e '.[rerun]'"
rr = pytest.importorskip("rerun", reason=MISSING)
from rerun.chunk import RrdReader  # noqa: E402

from fusion_net.viz.rerun_log.recording import write_recording  # noqa: E402
from fusion_net.viz.rerun_log.shapes import lidar_colors  # noqa: E402

pytestmark = pytest.mark.slow  # they take seconds, but .ci/run has the extra only when it comes to the slow ones
FIRST = START + 860_000
"""us of the first reading: RADAR_FRONT_LEFT, two sweeps before the first keyframe."""
STANDING = {"category": "vehicle.car", "center": lambda t: LANDMARKS[0], "size": [2.0, 4.0, 2.0], "yaw": lambda t: 0.7}
DRIVING = {
    "category": "vehicle.truck",
    "center": lambda t: MOVER_START + MOVER_VELOCITY * t,
    "yaw": lambda t: float(np.arctan2(-12.0, 16.0)),
}


class Logged:
    """The rows of a recording, as a viewer looks them up: the last one at a time."""

    def __init__(self, path):
        self.chunks = [chunk for chunk in RrdReader(path).stream() if not chunk.is_empty]
        self.entities = {chunk.entity_path for chunk in self.chunks}

    def rows(self, entity, component, timeline):
        """Time (ns, or a number of a keyframe) and value of each row, in order; those of static rows are at 0."""
        found = []
        for chunk in self.chunks:
            batch = chunk.to_record_batch()
            if chunk.entity_path == entity and component in batch.schema.names:
                if not chunk.is_static and timeline not in chunk.timeline_names:
                    continue
                index = "rerun.controls.RowId" if chunk.is_static else timeline
                times = [0] * len(batch) if chunk.is_static else batch.column(index).cast("int64").to_pylist()
                found += zip(times, batch.column(component).to_pylist(), strict=True)
        return sorted(found, key=lambda row: row[0])

    def at(self, time, entity, component, timeline="time"):
        """The value of the last row until then; None before the first, or where it was cleared."""
        rows = [value for stamp, value in self.rows(entity, component, timeline) if stamp <= time]
        cleared = [stamp for stamp, _ in self.rows(entity, "Clear:is_recursive", timeline) if stamp <= time]
        last = max((stamp for stamp, _ in self.rows(entity, component, timeline) if stamp <= time), default=None)
        return None if last is None or (cleared and max(cleared) >= last) else np.array(rows[-1])

    def pose(self, time, entity, timeline="time"):
        """``parent_T_entity``."""
        (translation,) = self.at(time, entity, "Transform3D:translation", timeline)
        (quaternion,) = self.at(time, entity, "Transform3D:quaternion", timeline)
        return rigid(Rotation.from_quat(quaternion).as_matrix(), translation)

    def sensor(self, time, channel, timeline="time"):
        """``global_T_sensor``."""
        return self.pose(time, "/world/ego", timeline) @ self.pose(time, f"/world/ego/{channel}", timeline)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    root = tmp_path_factory.mktemp("tree") / "tree"
    nusc = NuScenes(write_tree(root, scenes=2, keyframes=3, boxes=[STANDING, DRIVING]))
    scene = Scene(nusc, nusc.get("scene", "scene-0000"), [token for token in nusc.split("all") if "0000" in token])
    del nusc.keyframes[scene.tokens[1]]["CAM_BACK"]  # it is dead for a keyframe
    dead = [reading for reading in scene.readings if not (reading.channel == "CAM_BACK" and reading.keyframe == 1)]
    scene.__dict__["readings"] = dead
    return scene


@pytest.fixture(scope="module")
def logged(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "a.rrd"
    found = [boxes_ahead(number) for number in range(3)]
    write_recording(path, scene, {"C+L+R": found, "L": [Boxes.empty()] * 3}, color="height")
    assert [file.name for file in path.parent.iterdir()] == ["a.rrd"]
    return Logged(path)


def boxes_ahead(number):
    """``number`` boxes 10 m ahead of the car."""
    place = np.tile([10.0, 0.0, 1.0], (number, 1))
    size, still = np.tile([1.0, 3.0, 2.0], (number, 1)), np.zeros((number, 2))
    return Boxes(place, size, np.zeros(number), still, np.full(number, 5), np.full(number, 0.5), still)


def nanoseconds(t):
    """Of the time line, from seconds of the fixture's world."""
    return round((START + t * 1e6 - FIRST) * 1000)


def test_the_tree_of_entities_is_that_of_the_frames(logged):
    assert {
        "/world/ego/CAM_FRONT/image", "/world/ego/LIDAR_TOP/points", "/world/ego/RADAR_FRONT/velocity", "/world/labels",
        r"/world/ego/detections/C\+L\+R", "/series/points/LIDAR_TOP", "/status/CAM_BACK", "/scene",
    } <= logged.entities  # fmt: skip
    times = [time for time, _ in logged.rows("/world/ego/LIDAR_TOP/points", "Points3D:positions", "time")]
    assert times == [nanoseconds(1 + k / 2 - back * 0.05) for k in range(3) for back in (2, 1, 0)]


@pytest.mark.parametrize("t", [1.0, 1.02, 1.22, 1.46, 1.5, 1.98, 2.0])
def test_points_of_what_stands_still_lie_within_its_box_at_every_time(logged, t):
    time = nanoseconds(t)
    points = transform(
        logged.sensor(time, "LIDAR_TOP"), logged.at(time, "/world/ego/LIDAR_TOP/points", "Points3D:positions")
    )
    np.testing.assert_allclose(points[: len(LANDMARKS)], LANDMARKS, atol=2e-3)
    box = {
        name: logged.at(time, "/world/labels", f"Boxes3D:{name}")[0]
        for name in ("centers", "half_sizes", "quaternions")
    }
    yaw = Rotation.from_quat(box["quaternions"]).as_euler("xyz")[2]
    wlh = 2 * box["half_sizes"][[1, 0, 2]]
    assert wlh.tolist() == [2.0, 4.0, 2.0]
    assert yaw == pytest.approx(0.7, abs=1e-6)
    inside = points_in_box(points, box["centers"], wlh, yaw)
    np.testing.assert_array_equal(
        inside[: len(LANDMARKS)], points_in_box(LANDMARKS, LANDMARKS[0], np.array([2.0, 4.0, 2.0]), 0.7)
    )
    assert inside[0]


@pytest.mark.parametrize("keyframe", [0, 1, 2])
def test_at_a_keyframe_each_sensor_is_where_it_was_at_its_own_time(logged, scene, keyframe):
    np.testing.assert_allclose(logged.pose(keyframe, "/world/ego", "keyframe"), ego_pose(1 + keyframe / 2), atol=1e-4)
    for reading in scene.readings:
        if reading.keyframe == keyframe:
            pose = logged.sensor(keyframe, reading.channel, "keyframe")
            np.testing.assert_allclose(pose, reading.global_T_sensor, atol=1e-4)


def test_a_camera_has_its_file_and_its_pinhole(logged, scene):
    reading = scene.of("CAM_FRONT")[2]
    blob = logged.at(2, "/world/ego/CAM_FRONT/image", "EncodedImage:blob", "keyframe")
    assert bytes(blob[0].astype(np.uint8)) == scene.nusc.path(reading.record).read_bytes()
    columns = logged.at(2, "/world/ego/CAM_FRONT", "Pinhole:image_from_camera", "keyframe")[0]
    np.testing.assert_allclose(columns.reshape(3, 3).T, CAM_K)  # stored column by column
    assert logged.at(2, "/world/ego/CAM_FRONT", "Pinhole:resolution", "keyframe")[0].tolist() == [WIDTH, HEIGHT]


def test_a_dead_sensor_shows_nothing_of_what_it_saw_before(logged):
    images = [logged.at(k, "/world/ego/CAM_BACK/image", "EncodedImage:blob", "keyframe") for k in range(3)]
    assert [image is None for image in images] == [False, True, False]
    words = [text[0] for _, text in logged.rows("/status/CAM_BACK", "TextLog:text", "keyframe")]
    assert words == ["CAM_BACK: sound", "CAM_BACK: dead: it gives no data", "CAM_BACK: sound"]


def test_radar_arrows_are_the_velocity_over_ground(logged):
    time = nanoseconds(1.49)
    turn = logged.sensor(time, "RADAR_FRONT")[:3, :3]
    vectors = logged.at(time, "/world/ego/RADAR_FRONT/velocity", "Arrows3D:vectors")
    assert len(vectors) == len(LANDMARKS) + 1
    np.testing.assert_allclose(vectors[:-1], 0)
    np.testing.assert_allclose((turn @ vectors[-1])[:2], MOVER_VELOCITY[:2], atol=0.8)  # it has no z, and the car leans


def test_labels_keep_their_number_and_those_that_move_have_an_arrow(logged):
    for k in range(3):
        assert logged.at(k, "/world/labels", "Boxes3D:labels", "keyframe").tolist() == ["car 0", "truck 1"]
        assert logged.at(k, "/world/labels", "Boxes3D:class_ids", "keyframe").tolist() == [0, 1]
        arrows = logged.at(k, "/world/labels/velocity", "Arrows3D:vectors", "keyframe")
        np.testing.assert_allclose(arrows, [MOVER_VELOCITY], atol=1e-4)
        assert logged.at(k, "/series/boxes/labels", "Scalars:scalars", "keyframe") == [2.0]


def test_detections_stay_where_they_were_found(logged):
    entity = r"/world/ego/detections/C\+L\+R"
    assert [len(logged.at(k, entity, "Boxes3D:centers", "keyframe")) for k in range(3)] == [0, 1, 2]
    assert logged.at(2, entity, "Boxes3D:labels", "keyframe").tolist() == [f"{CLASSES[5]} 0.50"] * 2
    for t in (1.5, 1.87, 2.0):
        keyframe = 1 if t < 2 else 2
        place = logged.at(nanoseconds(t), entity, "Boxes3D:centers")[:1]
        there = transform(logged.sensor(nanoseconds(t), "detections"), place)
        np.testing.assert_allclose(there, transform(ego_pose(1 + keyframe / 2), [[10.0, 0.0, 1.0]]), atol=1e-3)


def test_a_recording_that_fails_leaves_the_old_one(scene, tmp_path):
    path = tmp_path / "a.rrd"
    path.write_bytes(b"old")
    gone = {"filename": "samples/none.jpg", "token": "gone"}
    readings = [scene.readings[-1].__class__(**vars(r) | {"record": r.record | gone}) for r in scene.readings[:1]]
    broken = Scene(scene.nusc, scene.record, scene.tokens)
    broken.__dict__["readings"] = readings
    with pytest.raises(ValueError, match=r"samples/none.jpg is not there"):
        write_recording(path, broken, {}, color="height")
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["a.rrd"]


def test_a_sweep_without_points_has_no_colours():
    assert lidar_colors(np.zeros((0, 5)), np.eye(4), by="height").shape == (0, 3)
    low, high = lidar_colors(np.array([[1.0, 0, 0, 9, 0], [1, 0, 3, 9, 0]]), np.eye(4), by="height").astype(int)
    assert low[2] > low[0]
    assert high[0] > high[2]
