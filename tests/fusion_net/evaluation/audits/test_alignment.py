"""The views of two sensors laid over each other: what was injected is found again, within the error that is stated."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from fusion_net.evaluation.audits.alignment import Motion, align, align_sensors, pair_up
from fusion_net.evaluation.audits.calibration import audit_calibration
from fusion_net.evaluation.audits.heat import Heat
from fusion_net.evaluation.bootstrap import resample_scenes

SAMPLES = 60


def detections(rng, places, *, noise=(0.3, 0.15), missed=0.3, ghosts=4):
    """What a sensor sees of ``places`` (N, 2): some of them, off by ``noise`` (2,) metres, and a few ghosts."""
    seen = places[rng.random(len(places)) > missed]
    xy = np.concatenate([seen + rng.normal(0, noise, seen.shape), rng.uniform((5, -20), (50, 20), (ghosts, 2))])
    cov = np.tile(np.diag(np.square(noise)), (len(xy), 1, 1))
    return Heat(xy, cov, np.zeros(len(xy), np.int64), rng.uniform(0.2, 1, len(xy)))


def moved(heat, turn_deg=0.0, shift=(0.0, 0.0)):
    return replace(heat, center=Motion(np.radians(turn_deg), np.array(shift))(heat.center))


@pytest.fixture(scope="module")
def views():
    """Camera (vague ahead), LiDAR and radar (vague across) over scenes of two samples."""
    rng = np.random.default_rng(3)
    worlds = [rng.uniform((5, -20), (50, 20), (10, 2)) for _ in range(SAMPLES)]
    noise = {"camera": (1.2, 0.25), "lidar": (0.2, 0.2), "radar": (0.3, 0.7)}
    return {name: [detections(rng, world, noise=std) for world in worlds] for name, std in noise.items()}


@pytest.fixture(scope="module")
def copies():
    scenes = np.array([f"s{k // 2}" for k in range(SAMPLES)])
    return resample_scenes(scenes, resamples=12, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("turn", "shift"), [(0.0, (0.0, 0.0)), (1.0, (0.0, 0.0)), (0.0, (0.0, 0.3)), (-3.0, (0.2, -0.3))]
)
def test_an_injected_motion_is_found_within_the_stated_error(views, copies, turn, shift):
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    turned = [moved(each, -turn, -np.array(shift) @ np.array([[c, -s], [s, c]])) for each in views["camera"]]
    found = align_sensors(("camera", "lidar"), turned, views["lidar"], copies)
    assert found.turn_error < 0.15
    assert found.shift_error[1] < 0.08
    assert abs(found.turn_deg - turn) < 3 * found.turn_error + 0.02
    assert np.all(np.abs(np.array(found.shift) - shift) < 3 * np.array(found.shift_error) + 0.02)


def paired(views):
    return {names: tuple(views[name] for name in names) for names in combinations(("camera", "lidar", "radar"), 2)}


def test_the_motion_back_is_the_opposite(views):
    there = align(pair_up(views["lidar"], [moved(b, 2.0) for b in views["lidar"]]))
    back = align(pair_up([moved(b, 2.0) for b in views["lidar"]], views["lidar"]))
    assert np.degrees(there.turn) == pytest.approx(2.0, abs=0.01)
    assert np.degrees(back.turn) == pytest.approx(-2.0, abs=0.01)


def test_classes_and_samples_are_not_mixed(views):
    other = [replace(each, label=each.label + 1) for each in views["lidar"]]
    assert len(pair_up(views["camera"], other)) == 0
    assert isinstance(align(pair_up(views["camera"], other)), Motion)


def test_the_sensor_that_is_off_is_named(views, copies):
    sound = audit_calibration(paired(views), copies)
    assert sound.ok, sound.verdict
    for name, label in (("camera", "camera"), ("lidar", "LiDAR"), ("radar", "radar")):
        audit = audit_calibration(paired(views | {name: [moved(b, 1.5, (0.0, 0.3)) for b in views[name]]}), copies)
        assert not audit.ok
        assert f"it is the {label}" in audit.verdict


def test_what_a_sound_car_has_is_taken_off(views, copies):
    crooked = views | {"camera": [moved(b, 1.0) for b in views["camera"]]}
    before = audit_calibration(paired(crooked), copies)
    after = audit_calibration(paired(crooked), copies, usual=before.numbers["pairs"])
    assert not before.ok
    assert after.ok
    assert after.numbers["pairs"]["C+L"]["turn_deg"] == pytest.approx(0.0)


def test_one_scene_has_no_errors_and_its_views_are_not_judged(views):
    crooked = paired(views | {"camera": [moved(b, 3.0) for b in views["camera"]]})
    audit = audit_calibration(crooked, None)
    assert audit.ok is None
    assert audit.verdict.endswith("C+L, C+R, L+R not judged: one scene, so no standard error")
    assert "+-" not in audit.verdict
    pair = audit.numbers["pairs"]["C+L"]
    assert pair["turn_deg"] == pytest.approx(-3.0, abs=0.3)
    assert (pair["turn_error"], pair["shift_error"]) == (None, None)


@pytest.mark.parametrize(("turn", "ok"), [(0.0, True), (1.0, False)])
def test_the_overlay_of_one_scene_is_judged(views, turn, ok):
    audit = audit_calibration(paired(views), None, overlay={"turn_deg": turn, "turn_error": 0.05})
    assert audit.ok is ok
    assert audit.verdict.startswith(f"overlay {turn:+.2f} +- 0.05 degrees; C+L turned")
    assert audit.numbers["culprit"] == ""


def test_too_little_in_common_is_not_judged(copies):
    nothing = [Heat.empty()] * SAMPLES
    audit = audit_calibration({("camera", "lidar"): (nothing, nothing)}, copies)
    assert audit.ok is None
    assert "too little" in audit.verdict
