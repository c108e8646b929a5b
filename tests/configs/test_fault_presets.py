"""``fault=NAME``: presets are what the documentation says, every command takes one, mistakes are answered with what can be."""

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from fusion_net.common.cli.command import CONFIGS, UserError, build, check_overrides
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
from fusion_net.common.faults import Fault, at_severity, fault_at_severity
from tests.fixtures.tiny_tree import write_tree


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


@pytest.mark.parametrize("name", sorted({path.stem for path in (CONFIGS / "fault").glob("*.yaml")} | set(PRESETS)))
def test_every_preset_is_the_fault_that_the_documentation_says_at_every_severity(name):
    preset, faults = OmegaConf.load(CONFIGS / "fault" / f"{name}.yaml"), PRESETS[name]
    for severity, expected in enumerate(faults, start=1):
        found = build({**preset, "severity": severity}, "fault")
        assert found == ([] if expected is None else [expected]), severity
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
