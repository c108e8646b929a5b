"""What a fault is, how it is drawn, and what the reader makes of it on clean data."""

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.cli.command import CONFIGS, UserError, build, check_overrides
from fusion_net.common.fault_effects import (
    BlockedLens,
    Clock,
    Dead,
    FewerBeams,
    LostPoints,
    LostSector,
    Mismount,
    Rings,
    Stale,
)
from fusion_net.common.faults import Fault, FaultPlan, at_severity, fault_at_severity
from fusion_net.common.geometry import invert, transform, yaw_of
from fusion_net.common.random import stream
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.data.samples import SampleReader
from fusion_net.nuscenes.nuscenes import NuScenes
from tests.fixtures.tiny_tree import LANDMARKS, ego_pose, write_tree

TOKEN, T_KEY = "scene-0000-1", 1.5
GRID = BEVGrid(0.0, 64.0, -24.0, 32.0, 0.5)
SIX = {f"CAM_{k}": "camera" for k in "ABCDEF"} | {"LIDAR_TOP": "lidar"}


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    return NuScenes(write_tree(tmp_path_factory.mktemp("tree"), scenes=1, sweeps=4))


def read(tree, *faults, token=TOKEN, **options):
    return SampleReader(faults=list(faults), **options).read(tree, token)


def assert_same(one, other):
    for name in ("images", "ego_T_cam", "lidar_points", "radar_points", "present", "lidar_depth"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def dead_channels(fault, samples, *, seed=0, channels=SIX):
    plan = FaultPlan([fault], seed)
    return [{c for c in channels if plan.on(c, channels, scene="s", sample=f"{k}").dead} for k in range(samples)]


# What is drawn.


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


# What the reader makes of it.


def test_no_fault_and_a_fault_of_nothing_change_nothing(tree):
    clean = read(tree)
    for effect in (Stale(firings=0), Clock(), Mismount(), LostPoints(fraction=0.0), BlockedLens(fraction=0.0)):
        sensors = {LostPoints: ["lidar", "radar"], BlockedLens: ["camera"]}.get(
            type(effect), ["camera", "lidar", "radar"]
        )
        spoiled = read(tree, Fault(sensors=sensors, effect=effect))
        np.testing.assert_allclose(spoiled.ego_T_cam, clean.ego_T_cam, atol=1e-12)
        np.testing.assert_allclose(spoiled.lidar_points, clean.lidar_points, atol=1e-5)
        np.testing.assert_allclose(spoiled.radar_points, clean.radar_points, atol=1e-5)
        np.testing.assert_array_equal(spoiled.images, clean.images)
    assert_same(read(tree, Fault(sensors=["lidar"], effect=Dead(), probability=0.0)), clean)


def test_a_dead_modality_is_not_present_and_a_dead_unit_is_black_or_silent(tree):
    assert read(tree, Fault(sensors=["camera"], effect=Dead())).present.tolist() == [False, True, True]
    sample = read(tree, Fault(sensors=["CAM_BACK", "RADAR_FRONT"], effect=Dead()), radar_sweeps=0)
    assert sample.present.all()
    assert sample.images[0].any()
    assert not sample.images[1].any()
    assert len(sample.radar_points) == len(LANDMARKS) + 1
    lidar = read(tree, Fault(sensors=["lidar"], effect=Dead()), lidar_sweeps=2)
    assert lidar.present.tolist() == [True, False, True]
    assert lidar.lidar_points.shape == (0, 5)
    assert not lidar.lidar_depth.any()


def test_a_mount_that_moved_shifts_points_the_other_way_in_every_sweep(tree):
    clean = read(tree, lidar_sweeps=2)
    moved = read(tree, Fault(sensors=["lidar"], effect=Mismount(translation=[0, 0.3, 0])), lidar_sweeps=2)
    shift = (moved.lidar_points - clean.lidar_points)[:, :3].reshape(3, len(LANDMARKS), 3)
    for age, scan in zip((0.0, 0.05, 0.1), shift, strict=True):
        then = invert(ego_pose(T_KEY)) @ ego_pose(T_KEY - age)
        np.testing.assert_allclose(scan, np.broadcast_to(then[:3, :3] @ (0, -0.3, 0), scan.shape), atol=2e-4)


def test_a_camera_that_looks_left_is_believed_to_look_right(tree):
    clean, turned = read(tree), read(tree, Fault(sensors=["CAM_FRONT"], effect=Mismount(rotation_deg=[0, 0, 2.0])))
    ego_T_ego = turned.ego_T_cam[0] @ invert(clean.ego_T_cam[0])
    assert np.degrees(yaw_of(ego_T_ego)) == pytest.approx(-2.0, abs=0.01)
    np.testing.assert_allclose(turned.ego_T_cam[0, :3, 3], clean.ego_T_cam[0, :3, 3], atol=0.1)
    np.testing.assert_array_equal(turned.ego_T_cam[1], clean.ego_T_cam[1])


def test_a_clock_50_ms_ahead_gives_the_sweep_before_at_the_pose_of_now(tree):
    late = read(tree, Fault(sensors=["lidar"], effect=Clock(offset=0.05)))
    expected = transform(invert(ego_pose(T_KEY - 0.05)), LANDMARKS)
    np.testing.assert_allclose(late.lidar_points[:, :3], expected, atol=2e-3)


def test_without_sweeps_a_clock_moves_the_data_by_the_ego_motion_alone(tree):
    """A camera fires 20 ms before the keyframe; 30 ms ahead, its picture is taken to be of 10 ms after it."""
    ahead = read(tree, Fault(sensors=["CAM_FRONT"], effect=Clock(offset=0.03)))
    clean = read(tree)
    as_if = invert(ego_pose(T_KEY)) @ ego_pose(T_KEY + 0.01) @ invert(ego_pose(T_KEY - 0.02)) @ ego_pose(T_KEY)
    np.testing.assert_allclose(ahead.ego_T_cam[0], as_if @ clean.ego_T_cam[0], atol=3e-3)
    np.testing.assert_array_equal(ahead.images, clean.images)


def test_past_sweeps_of_a_clock_that_is_ahead_are_not_given_twice(tree):
    """Four sweeps of 50 ms before each keyframe: the oldest firing has no older one to stand in for it."""
    late = read(tree, Fault(sensors=["lidar"], effect=Clock(offset=0.05)), lidar_sweeps=4).lidar_points
    scans = late.reshape(-1, len(LANDMARKS), 5)
    assert len({round(float(scan[0, 4]), 3) for scan in scans}) == len(scans) == 4


def test_a_stale_frame_is_the_firing_before_at_the_pose_of_this_one(tree):
    stale = read(tree, Fault(sensors=["lidar"], effect=Stale()))
    np.testing.assert_allclose(
        stale.lidar_points[:, :3], transform(invert(ego_pose(T_KEY - 0.05)), LANDMARKS), atol=2e-4
    )
    np.testing.assert_allclose(stale.lidar_points[:, 4], read(tree).lidar_points[:, 4])
    first = read(tree, Fault(sensors=["CAM_FRONT"], effect=Stale()), token="scene-0000-0")
    np.testing.assert_array_equal(first.images, read(tree, token="scene-0000-0").images)  # there is none before


def test_a_sector_is_counted_from_straight_ahead_to_the_left(tree):
    clean = read(tree).lidar_points
    gone = read(tree, Fault(sensors=["lidar"], effect=LostSector(width_deg=60, center_deg=-70))).lidar_points
    azimuth = np.degrees(np.arctan2(clean[:, 1], clean[:, 0] - 0.9))
    outside = np.abs(azimuth + 70) > 30
    assert 0 < outside.sum() < len(clean)
    assert abs(len(gone) - outside.sum()) <= 1  # the mount leans a little
    assert np.isin(gone[:, 0], clean[outside, 0]).mean() > 0.95


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


def test_a_tree_that_does_not_say_has_nuscenes_32_beams(tree):
    record = tree.reference("scene-0000-1")
    assert "beams" not in tree.get("calibrated_sensor", record["calibrated_sensor_token"])
    assert tree.beams == {"LIDAR_TOP": 32}


def test_mud_covers_its_share_and_only_the_image(tree):
    clean, muddy = read(tree), read(tree, Fault(sensors=["CAM_BACK"], effect=BlockedLens(fraction=0.4)))
    covered = (muddy.images != clean.images).any(axis=-1)
    assert not covered[0].any()
    assert covered[1].mean() == pytest.approx(0.4, abs=0.01)
    np.testing.assert_array_equal(muddy.dense_depth, clean.dense_depth)
    fitted = read(tree, Fault(sensors=["CAM_BACK"], effect=BlockedLens(fraction=0.4)), image_size=[16, 40])
    assert fitted.images.shape == (2, 16, 40, 3)


def test_a_dataset_spoils_the_same_with_and_without_its_cache(tmp_path):
    root = str(write_tree(tmp_path, scenes=3))
    faults = [
        Fault(sensors=["camera"], effect=Dead(), probability=0.5, per="sample"),
        Fault(sensors=["lidar"], effect=Mismount(rotation_deg=[1, 1, 1], random=True), per="sample"),
        Fault(sensors=["lidar", "radar"], effect=LostPoints(fraction=0.5)),
    ]
    plain, cached, other = (
        NuScenesDataset(root, "train", grid=GRID, faults=faults, cache=cache, seed=seed)
        for cache, seed in (("none", 3), ("memory", 3), ("none", 4))
    )
    for key in ((0, 1), (1, 1), (1, 2), (0, 2)):
        assert_same(plain[key], cached[key])
    assert len({plain[k].images.any(axis=(1, 2, 3)).tobytes() for k in range(6)}) > 1
    assert not np.array_equal(plain[1].lidar_points, other[1].lidar_points)


def test_a_dataset_without_a_named_channel_says_what_it_has(tmp_path):
    root = str(write_tree(tmp_path, scenes=2, keyframes=1))
    with pytest.raises(ValueError, match=r"no sensor 'CAM_SIDE'; there are camera, lidar, radar, CAM_FRONT, CAM_BACK"):
        NuScenesDataset(root, "train", grid=GRID, faults=[Fault(sensors=["CAM_SIDE"], effect=Dead())])


# The presets and mistakes.

PRESETS = sorted(path.stem for path in (CONFIGS / "fault").glob("*.yaml"))


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_builds_at_every_severity_and_is_called_as_its_file(name):
    node = OmegaConf.load(CONFIGS / "fault" / f"{name}.yaml")
    assert node.name == name
    levels = []
    for severity in range(1, len(node.levels) + 1):
        node.severity = severity
        levels.append(build(node, "fault"))
    assert all(isinstance(fault, Fault) for level in levels for fault in level)
    assert len({str(level) for level in levels}) == len(levels)


@pytest.mark.parametrize("config", ["data_gen", "train", "eval"])
def test_every_command_takes_a_fault_and_a_severity(config):
    check_overrides(config, ["fault=lidar_rotation", "fault.severity=3"])
    with pytest.raises(UserError, match="there is no fault=lidar_rotaton; did you mean lidar_rotation"):
        check_overrides(config, ["fault=lidar_rotaton"])
    with pytest.raises(UserError, match=r"fault\.severity=high is not a whole number"):
        check_overrides(config, ["fault.severity=high"])


def test_a_fault_of_the_command_line_reaches_the_training_samples_and_not_the_validation(tmp_path):
    root = write_tree(tmp_path, scenes=2, keyframes=1)
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        cfg = compose("train", overrides=[f"data.root={root}", "fault=dead_camera", "fault.severity=3"])
    train, val = (build(cfg.dataset[split], "dataset") for split in ("train", "val"))
    assert train[0].present.tolist() == [False, True, True]
    assert val[0].present.all()


def test_a_severity_that_is_none_names_those_there_are():
    two = [[Fault(sensors=["lidar"], effect=FewerBeams(keep=k))] for k in (16, 8)]
    assert at_severity(name="lidar_beams", levels=two, severity=2) == two[1]
    for severity in (0, 3):
        with pytest.raises(ValueError, match=rf"fault.severity={severity}: 'lidar_beams' has severities 1 to 2"):
            at_severity(name="lidar_beams", levels=two, severity=severity)


def fault(sensor, effect, **more):
    return Fault(sensors=[sensor], effect=effect, **more)


PRESETS = {
    "blocked_lens": [fault("camera", BlockedLens(fraction=f)) for f in (0.1, 0.3, 0.5)],
    "camera_clock": [fault("camera", Clock(offset=t)) for t in (0.01, 0.03, 0.1)],
    "camera_drift": [fault("camera", Clock(drift_ppm=50.0, unsynchronised=t)) for t in (600.0, 1800.0, 3600.0)],
    "camera_shake": [
        fault("camera", Mismount(rotation_deg=[a] * 3, random=True), per="sample") for a in (0.3, 1.0, 2.0)
    ],
    "dead_camera": [fault("camera", Dead(), count=n) for n in (1, 3, None)],
    "dead_lidar": [fault("lidar", Dead())],
    "dead_radar": [fault("radar", Dead(), count=n) for n in (1, 3, None)],
    "dropped_camera": [fault("camera", Dead(), per="sample", probability=p) for p in (0.2, 0.4, 0.6)],
    "lidar_beams": [fault("lidar", FewerBeams(keep=n)) for n in (16, 8, 4)],
    "lidar_clock": [fault("lidar", Clock(offset=t)) for t in (0.01, 0.03, 0.1)],
    "lidar_points": [fault("lidar", LostPoints(fraction=f)) for f in (0.7, 0.8, 0.9)],
    "lidar_sector": [fault("lidar", LostSector(width_deg=w, spread_deg=40.0)) for w in (30.0, 60.0, 120.0)],
    "lidar_shake": [fault("lidar", Mismount(rotation_deg=[a] * 3, random=True), per="sample") for a in (0.3, 1.0, 2.0)],
    "none": [None],
    "radar_clock": [fault("radar", Clock(offset=t)) for t in (0.02, 0.06, 0.2)],
    **{
        f"stale_{sensor}": [fault(sensor, Stale(firings=1), per="sample", probability=p) for p in (0.2, 0.4, 0.6)]
        for sensor in ("camera", "lidar")
    },
    **{
        f"{sensor}_rotation": [fault(sensor, Mismount(rotation_deg=[0.0, 0.0, a])) for a in (0.5, 1.0, 2.0, 3.0)]
        for sensor in ("camera", "lidar", "radar")
    },
    **{
        f"{sensor}_shift": [fault(sensor, Mismount(translation=[0.0, y, 0.0])) for y in (0.05, 0.1, 0.2)]
        for sensor in ("camera", "lidar", "radar")
    },
}


def test_every_preset_is_the_fault_that_the_documentation_says_at_every_severity():
    assert {path.stem for path in (CONFIGS / "fault").glob("*.yaml")} == set(PRESETS)
    for name, faults in PRESETS.items():
        preset = OmegaConf.load(CONFIGS / "fault" / f"{name}.yaml")
        for severity, expected in enumerate(faults, start=1):
            found = build({**preset, "severity": severity}, "fault")
            assert found == ([] if expected is None else [expected]), (name, severity)
        with pytest.raises(UserError, match=f"'{name}' has"):
            build({**preset, "severity": len(faults) + 1}, "fault")


@pytest.mark.parametrize(
    ("settings", "answer"),
    [
        ({"effect": "LostPoint"}, "unknown effect 'LostPoint'; did you mean 'LostPoints'"),
        ({"levels": [{"fracton": 0.1}]}, "unknown setting of LostPoints 'fracton'; did you mean 'fraction'"),
        ({"levels": [{"fraction": 7}]}, "fraction=7 is not within"),
        ({"sensors": ["camera"]}, "LostPoints cannot act on 'camera'; use lidar or radar"),
    ],
)
def test_a_preset_that_cannot_be_says_what_can(settings, answer):
    right = {"name": "mine", "sensors": ["lidar"], "effect": "LostPoints", "levels": [{"fraction": 0.5}], "severity": 1}
    with pytest.raises(ValueError, match=answer):
        fault_at_severity(**{**right, **settings})


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
