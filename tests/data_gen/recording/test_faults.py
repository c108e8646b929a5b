"""Faults written at generation, and the same ones on the fly on a clean tree of the same world."""

from dataclasses import replace

import numpy as np
import pytest

from data_gen.assets.shapes.mesh import Mesh
from data_gen.recording import tables
from data_gen.recording.writer import write_json, write_scene
from data_gen.rig.mounts import Camera, Lidar, Radar
from data_gen.rig.rig import Rig
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
from fusion_net.common.faults import Fault, FaultPlan
from fusion_net.common.geometry import from_quaternion, invert, project, yaw_of
from fusion_net.data.samples import SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.box_world import at, box, car, path, reflectors, scene
from tests.fixtures.lidar_models import HDL32E

SPEED, SEED, KEYFRAMES = 20.0, 4, 4
RIG = Rig(
    name="tiny",
    sweeps={"lidar": 2, "radar": 2},
    cameras={
        "CAM_FRONT": Camera(
            translation=[1.7, 0.1, 1.5], rotation_deg=[1.0, 2.0, -1.0], rate=30.0, phase=0.02,
            width=64, height=32, hfov_deg=70.0,
        )
    },
    lidars={
        "LIDAR_TOP": Lidar(
            model=HDL32E,
            translation=[0.9, 0.1, 1.8], rotation_deg=[0.4, -0.6, 1.0], rate=10.0,
            columns=1200, sector_deg=[-60.0, 60.0], cut_deg=-61.0,
        )
    },
    radars={
        "RADAR_FRONT": Radar(translation=[3.4, 0.1, 0.5], rotation_deg=[0.0, 0.0, 2.0], rate=20.0),
        "RADAR_LEFT": Radar(translation=[2.4, 0.8, 0.7], rotation_deg=[0.0, 0.0, 40.0], rate=20.0, phase=0.013),
    },
)  # fmt: skip


def slanted_wall():
    """A long wall that leans 30 degrees to the road, 40 m ahead and to the left."""
    wall = box((60.0, 0.5, 6.0), (0.0, 0.0, 3.0), reflectivity=0.9)
    c, s = np.cos(np.radians(-30)), np.sin(np.radians(-30))
    turned = wall.vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return Mesh((turned + at(60.0, 8.0, 0.0)).astype(np.float32), wall.faces, wall.surface)


def posts():
    """A row of strong reflectors on the left of the road, at rest."""
    return reflectors([at(x, 12.0, 0.8) for x in range(20, 160, 7)], 15.0)


@pytest.fixture(scope="module")
def make(tmp_path_factory):
    world = scene(
        actors=[(car(reflectors((-2.2, 0, 0.6), 15.0)), path(at(35, -3, 0), (SPEED, 0, 0)))],
        walls=[slanted_wall()],
        ego=path(at(0, 0, 0), (SPEED, 0, 0)),
        scatterers=posts(),
    )

    def write(*faults, rig=RIG):
        root = tmp_path_factory.mktemp("tree")
        for folder in (*(f"{kind}/{c}" for kind in ("samples", "sweeps") for c in rig.sensors), "maps"):
            (root / folder).mkdir(parents=True)
        rows = write_scene(
            world, rig, root=root, dataset="tiny", index=0, keyframes=KEYFRAMES, seed=9, layout="boxes",
            faults=FaultPlan(list(faults), SEED),
        )  # fmt: skip
        write_json(root / "rows.json", rows)
        tables.write_tables(root, "tiny", rig, {root / "rows.json": "train"})
        return NuScenes(root)

    return write


@pytest.fixture(scope="module")
def clean(make):
    return make()


def read(tree, *faults, place=1, **options):
    return SampleReader(faults=list(faults), fault_seed=SEED, **options).read(tree, tree.split("all")[place])


def wall_line(sample):
    """Direction (rad) of the wall in the ego frame, and its distance (m) from (40, 0), by a fit to its points."""
    points = sample.lidar_points[:, :3].astype(float)
    points = points[(points[:, 2] > 1.8) & (points[:, 2] < 5.5)]
    center = points[:, :2].mean(axis=0)
    _, _, axes = np.linalg.svd(points[:, :2] - center)
    along, across = axes
    return np.arctan(along[1] / along[0]), abs(across @ (center - (40.0, 0.0)))


def test_without_faults_true_and_reported_agree(clean):
    for record in clean.tables["sample_data"].values():
        assert record["true_timestamp"] == record["timestamp"]
        assert "true_rotation" not in record


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


def test_true_and_reported_mounts_are_both_kept(make):
    tree = make(Fault(sensors=["lidar"], effect=Mismount(rotation_deg=[0, 0, 0.5], translation=[0, 0.1, 0])))
    nominal = RIG.lidars["LIDAR_TOP"].ego_T_sensor
    for record in tree.tables["sample_data"].values():
        if tree.channel(record) == "LIDAR_TOP":
            true = from_quaternion(record["true_rotation"], record["true_translation"])
            assert np.degrees(yaw_of(true @ invert(nominal))) == pytest.approx(0.5)
            assert true[:3, 3] - nominal[:3, 3] == pytest.approx([0, 0.1, 0])
            np.testing.assert_allclose(tree.ego_T_sensor(record), nominal, atol=1e-12)
        else:
            assert "true_rotation" not in record


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


def test_a_dead_lidar_keeps_its_keyframe_record_with_an_empty_file_and_nothing_else(make):
    tree = make(Fault(sensors=["lidar"], effect=Dead()))
    records = [r for r in tree.tables["sample_data"].values() if tree.channel(r) == "LIDAR_TOP"]
    assert [record["is_key_frame"] for record in records] == [True] * KEYFRAMES
    assert {tree.path(record).stat().st_size for record in records} == {0}
    assert read(tree).present.tolist() == [True, False, True]


def test_a_dead_camera_or_radar_leaves_neither_record_nor_file(make):
    tree = make(Fault(sensors=["camera", "RADAR_LEFT"], effect=Dead()))
    assert {tree.channel(r) for r in tree.tables["sample_data"].values()} == {"LIDAR_TOP", "RADAR_FRONT"}
    assert not list(tree.root.glob("s*/CAM_FRONT/*")) + list(tree.root.glob("s*/RADAR_LEFT/*"))
    sample = read(tree)
    assert sample.present.tolist() == [False, True, True]
    assert sample.images.shape == (1, 32, 64, 3)
    assert not sample.images.any()


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


def test_a_clock_that_drifts_is_further_off_at_the_end_of_the_scene(make):
    tree = make(Fault(sensors=["camera"], effect=Clock(drift_ppm=50.0, unsynchronised=600.0)))
    frames = [tree.keyframes[token]["CAM_FRONT"] for token in tree.split("all")]
    errors = np.array([frame["timestamp"] - frame["true_timestamp"] for frame in frames])
    assert errors[0] == pytest.approx(30_000, abs=3)
    assert errors[3] - errors[0] == pytest.approx(50e-6 * 1.5e6, abs=2)  # 75 us in 1.5 s


def test_a_stale_sweep_is_the_one_before_under_the_stamp_of_this_one(make, clean):
    tree = make(Fault(sensors=["lidar"], effect=Stale()))
    token = clean.split("all")[1]
    record, before = clean.keyframe_and_sweeps(token, "LIDAR_TOP", 1)
    stale = tree.keyframe_and_sweeps(token, "LIDAR_TOP", 0)[0]
    assert tree.path(stale).read_bytes() == clean.path(before).read_bytes()
    assert stale["timestamp"] == record["timestamp"]
    assert stale["true_timestamp"] == before["timestamp"]


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


def test_a_channel_that_the_rig_lacks_is_named(clean):
    fault = Fault(sensors=["CAM_BACK"], effect=Dead())
    with pytest.raises(ValueError, match=r"there is no sensor 'CAM_BACK'; there are camera, lidar, radar, CAM_FRONT"):
        FaultPlan([fault]).check(RIG.modalities, {"LIDAR_TOP": 32})


def test_jitter_is_in_the_true_and_in_the_reported_time(make):
    mounts = {"jitter": 0.002, "rate": 20.0, "translation": [3.4, 0.0, 0.5]}
    rig = Rig(name="tiny", sweeps={"radar": 5}, cameras={}, lidars=RIG.lidars, radars={"RADAR_FRONT": Radar(**mounts)})
    tree = make(rig=rig)
    stamps = [r["timestamp"] for r in tree.tables["sample_data"].values() if tree.channel(r) == "RADAR_FRONT"]
    assert all(r["timestamp"] == r["true_timestamp"] for r in tree.tables["sample_data"].values())
    off_beat = (np.array(stamps) % 50_000 + 25_000) % 50_000 - 25_000
    assert 1000 < off_beat.std() < 3500
    assert len(set(stamps)) == len(stamps) == 6 * KEYFRAMES
    assert stamps == sorted(stamps)


def test_of_a_radar_that_comes_back_to_life_every_scan_since_is_there_and_none_from_before(make):
    rig = replace(RIG, sweeps={"radar": "all"}, cameras={})
    tree = make(Fault(sensors=["RADAR_LEFT"], effect=Dead(), probability=0.5, per="sample"), rig=rig)
    samples = tree.split("all")
    scans = {channel: {token: [] for token in samples} for channel in rig.radars}
    for record in tree.tables["sample_data"].values():
        if tree.channel(record) in scans:
            scans[tree.channel(record)][record["sample_token"]].append(record["timestamp"])
    assert [len(found) for found in scans["RADAR_FRONT"].values()] == [10] * KEYFRAMES
    assert {len(found) for found in scans["RADAR_LEFT"].values()} == {0, 10}
    for found in scans["RADAR_LEFT"].values():
        assert set(np.diff(found)) <= {50_000}
