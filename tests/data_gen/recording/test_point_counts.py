"""What the labels say of points: those of the keyframe inside the box, as nuScenes counts, and those that the object caused."""

import numpy as np
import pytest

from data_gen.assets.shapes.mesh import Asset
from data_gen.recording import tables
from data_gen.recording.record import record_scene
from data_gen.rig.mounts import Lidar, Radar
from data_gen.rig.rig import Rig
from fusion_net.common.atomic import write_json
from fusion_net.common.fault_effects import Clock, Dead, LostPoints, Mismount, Stale
from fusion_net.common.faults import Fault, FaultPlan
from fusion_net.common.geometry import transform
from fusion_net.common.nuscenes_format import CLASSES
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.sensor_files import read_lidar, read_radar
from tests.fixtures.box_world import at, box, path, reflectors, scene
from tests.fixtures.lidar_models import HDL32E

KEYFRAMES = 3
RIG = Rig(
    name="tiny",
    sweeps={"radar": 1},
    cameras={},
    lidars={
        "LIDAR_TOP": Lidar(
            translation=[0.9, 0.1, 1.8], rotation_deg=[1.4, -0.6, 3.0], rate=10.0, phase=0.03, columns=1085, cut_deg=30.0,
            model=HDL32E,
        )
    },
    radars={
        "RADAR_FRONT": Radar(translation=[3.4, 0.1, 0.5], rotation_deg=[0.0, 1.5, 2.0], rate=20.0, phase=0.02),
        "RADAR_FRONT_LEFT": Radar(translation=[2.6, 0.7, 0.6], rotation_deg=[0.0, 0.0, 40.0], rate=20.0, phase=0.013),
    },
)  # fmt: skip


def body(category, size, height, imitates=""):
    """A block ``height`` m high within a labelled box of ``size`` (3,) that is 10 cm wider on every side, with reflectors at
    its corners."""
    length, width = size[0] - 0.2, size[1] - 0.2
    corners = [(x, y, 0.5) for x in (-length / 2, 0, length / 2) for y in (-width / 2, width / 2)]
    mesh = box((length, width, height), (0, 0, height / 2))
    return Asset("block", category, size, mesh, reflectors(corners, 20.0), imitates=imitates)


def world():
    """A car that draws away from the ego, one that turns, a flat one under a box that hangs in its place; a decoy; an ego that
    turns."""
    vehicle, flat = (body("vehicle.car", (4.5, 1.9, 1.6), height) for height in (1.5, 0.5))
    return scene(
        actors=[
            (vehicle, path(at(12, 3, 0), (15.0, 0, 0))),
            (vehicle, path(at(22, -6, 0), (6.0, 0, 0), yaw=0.4, yaw_rate=0.8)),
            (flat, path(at(25, 9, 0), yaw=0.7)),
            (body("", (1.2, 2.0, 3.0), 2.9, imitates="vehicle.car"), path(at(12, -10, 0), yaw=0.3)),
        ],
        walls=[box((1.0, 1.0, 0.8), at(25, 9, 1.1), reflectivity=0.9)],
        ego=path(at(0, 0, 0), (8.0, 0, 0), yaw=0.0, yaw_rate=0.1),
    )


@pytest.fixture(scope="module")
def make(tmp_path_factory):
    stage = world()

    def write(*faults):
        root = tmp_path_factory.mktemp("tree")
        for folder in (*(f"{kind}/{c}" for kind in ("samples", "sweeps") for c in RIG.sensors), "maps"):
            (root / folder).mkdir(parents=True)
        rows = record_scene(
            stage, RIG, root=root, dataset="tiny", index=0, keyframes=KEYFRAMES, seed=9, layout="boxes",
            faults=FaultPlan(list(faults), 4),
        )  # fmt: skip
        write_json(root / "rows.json", rows)
        tables.write_tables(root, "tiny", RIG, {root / "rows.json": "train"})
        return NuScenes(root)

    return write


@pytest.fixture(scope="module")
def tree(make):
    return make()


def labels(tree, *keys):
    """The keys' values of every annotation."""
    return np.array([[row[key] for key in keys] for row in tree.tables["sample_annotation"].values()])


def points_of(path):
    """(P, 3) of a file, in the sensor's frame."""
    if path.suffix == ".bin":
        return read_lidar(path)[0][:, :3]
    records = read_radar(path)
    return np.stack([records["x"], records["y"], records["z"]], axis=1)


def inside(points, annotation):
    """How many of the global points (P, 3) lie between all three pairs of the box's faces: by its quaternion, as written."""
    w, x, y, z = annotation["rotation"]
    ahead = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    up = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    width, length, height = annotation["size"]
    count = 0
    for point in points:
        offset = point - annotation["translation"]
        along, across, above = offset @ ahead, offset @ np.cross(up, ahead), offset @ up
        count += abs(along) <= length / 2 and abs(across) <= width / 2 and abs(above) <= height / 2
    return count


def test_num_pts_are_the_points_of_the_keyframe_files_inside_the_box(tree):
    met = set()
    for annotation in tree.tables["sample_annotation"].values():
        counted = {"lidar": 0, "radar": 0}
        for channel, record in tree.keyframes[annotation["sample_token"]].items():
            points = transform(tree.global_T_ego(record) @ tree.ego_T_sensor(record), points_of(tree.path(record)))
            near = points[np.linalg.norm(points - annotation["translation"], axis=1) < 6]
            counted["lidar" if channel == "LIDAR_TOP" else "radar"] += inside(near, annotation)
        assert (annotation["num_lidar_pts"], annotation["num_radar_pts"]) == tuple(counted.values())
        met |= {(kind, bool(annotation["imitates"])) for kind, count in counted.items() if count}
    assert {("lidar", False), ("radar", False), ("lidar", True)} <= met


def test_echoes_are_what_the_object_sent_back_wherever_it_lies(tree):
    inside, echoes = labels(tree, "num_lidar_pts", "num_lidar_echoes").T
    speed = np.hypot(*labels(tree, "velocity")[:, 0].T)
    height = labels(tree, "size")[:, 0, 2]
    fast, still = speed > 10, (speed < 0.1) & (height > 2)
    assert (inside < 0.5 * echoes)[fast].all()  # its tail was hit up to 0.1 s before the keyframe, up to 1.5 m behind
    np.testing.assert_allclose(inside[still], echoes[still], rtol=0.02)  # and some of the road under it
    under_the_box = inside > 1.2 * echoes
    assert under_the_box.sum() == KEYFRAMES
    assert (speed[under_the_box] < 0.1).all()


@pytest.mark.parametrize(
    "effect", [Dead(), LostPoints(fraction=0.8), Stale(), Clock(offset=0.04), Mismount(rotation_deg=[0, 0, 3.0])],
    ids=lambda effect: type(effect).__name__,
)  # fmt: skip
def test_a_fault_takes_no_points_from_the_labels(make, tree, effect):
    spoilt = make(Fault(sensors=["lidar", "radar"], effect=effect))
    seen = spoilt.tables["sample_annotation"]
    if isinstance(effect, Dead | LostPoints):
        assert seen == tree.tables["sample_annotation"]
    else:  # seen a little earlier or from a little aside
        both = [(row, seen[token]) for token, row in tree.tables["sample_annotation"].items() if token in seen]
        counts = np.array([[row["num_lidar_pts"] for row in pair] for pair in both if not np.any(pair[0]["velocity"])])
        assert len(counts) >= KEYFRAMES
        np.testing.assert_allclose(*counts.T, rtol=0.15, atol=4)


def test_the_filter_of_labels_is_the_devkits(tree):
    """A box is compared when LiDAR and radar points inside it are one or more."""
    for token in tree.split("all"):
        counts = [
            row["num_lidar_pts"] + row["num_radar_pts"]
            for row in tree.tables["sample_annotation"].values()
            if row["sample_token"] == token and not row["imitates"]
        ]
        assert tree.annotations(token, CLASSES).num_pts.tolist() == counts
