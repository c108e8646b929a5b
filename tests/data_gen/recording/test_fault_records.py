"""What the tables keep of a fault: true and reported times and mounts, and which records and files there are."""

from dataclasses import replace

import numpy as np
import pytest

from data_gen.rig.mounts import Radar
from data_gen.rig.rig import Rig
from fusion_net.common.fault_effects import Clock, Dead, Mismount, Stale
from fusion_net.common.faults import Fault, FaultPlan
from fusion_net.common.geometry import from_quaternion, invert, yaw_of
from tests.fixtures.faulty_recording import KEYFRAMES, RIG, read


def test_without_faults_true_and_reported_agree(clean):
    for record in clean.tables["sample_data"].values():
        assert record["true_timestamp"] == record["timestamp"]
        assert "true_rotation" not in record


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
