"""What a radar writes of its own detections: limits and steps of the cross-section, doubts about Doppler and existence."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_gen.recording.point_files import write_radar
from data_gen.scene.conditions import Condition
from data_gen.sensors.radar.detection import DIRECT, DOUBLE_BOUNCE, SINGLE_BOUNCE, THRESHOLD, link_budget_db
from data_gen.sensors.radar.flags import (
    AMBIGUOUS,
    LOW_DBSM,
    LOW_RCS,
    MAYBE_STATIONARY,
    MIRROR,
    MIRROR_FOUND,
    MIRROR_MISTAKEN,
    RAMP,
    UNAMBIGUOUS,
    VALID,
    detected_in_both_ramps,
)
from data_gen.sensors.radar.radar import RCS_LIMITS, RCS_STEP
from fusion_net.common.random import stream
from fusion_net.nuscenes.sensor_files import read_radar
from tests.fixtures.box_world import ORIGIN, at, path, reflectors, scene
from tests.fixtures.mirror_world import RADAR as AT_ORIGIN
from tests.fixtures.mirror_world import SCANS, wall_world
from tests.fixtures.radar_world import RADAR, point_actor, scan_of, seen_at

CLEAR = Condition()
EGO = path(ORIGIN, velocity=(20.0, 0, 0))


def street(condition=CLEAR, *, rcs=(-25.0, 25.0)):
    """Reflectors of all strengths all over the view, a car at 25 m/s, and a wall; the ego drives at 20 m/s."""
    places = [at(x, y, 0.5) for x in range(5, 95, 6) for y in range(-30, 31, 10)]
    loud = np.linspace(*rcs, len(places))
    return scene(
        ego=EGO,
        actors=[(point_actor(20.0), path(at(30, 3, 0), velocity=(25.0, 0, 0)))],
        scatterers=reflectors(places, loud),
        condition=condition,
    )


@pytest.mark.parametrize("rain", [0.0, 50.0])
def test_nothing_is_reported_below_the_threshold_at_its_range_noise_and_rain_included(rain):
    """A drop at 2 m that only just crosses the threshold had -97 dBsm; no sensor is as sensitive."""
    world = street(Condition("rain", rain_rate=rain))
    for key in range(30):
        scan = scan_of(world, key=key)
        least = 10 * np.log10(THRESHOLD - 1) - link_budget_db(scan.range, scan.azimuth, RADAR)
        assert len(scan.rcs) > 20
        assert np.all(scan.rcs >= least - RCS_STEP)
        assert scan.rcs.min() > -12.5


def test_cross_sections_come_in_steps_of_half_a_decibel_within_the_limits_of_the_message():
    scan = scan_of(street(rcs=(0.0, 110.0)))
    np.testing.assert_array_equal(scan.rcs % RCS_STEP, 0.0)
    assert scan.rcs.max() == RCS_LIMITS[1] == 63.5


@pytest.mark.parametrize(("excess_db", "share"), [(0.0, 0.54), (3.0, 0.985), (10.0, 1.0)])
def test_the_second_ramp_sees_what_the_first_does_unless_it_is_faint(excess_db, share):
    snr = np.full(4000, THRESHOLD * 10 ** (excess_db / 10))
    assert detected_in_both_ramps(snr, stream(3)).mean() == pytest.approx(share, abs=0.025)


def test_a_faint_target_has_an_ambiguous_doppler_and_a_loud_one_has_none():
    """A car away at 25 m/s, seen in one ramp only, is taken for one that comes at 25 - 2 x 18.5 = -12 m/s, and flagged."""
    worlds = [scene(actors=[(point_actor(rcs), path(at(58, 0, 0), velocity=(25.0, 0, 0)))]) for rcs in (-8.0, 30.0)]
    faint, loud = (seen_at(world, scans=400, body=0) for world in worlds)
    assert set(loud["ambig_state"]) == {UNAMBIGUOUS}
    doubtful = faint["ambig_state"] == AMBIGUOUS
    assert 0.02 < doubtful.mean() < 0.3
    assert set(faint["ambig_state"]) == {UNAMBIGUOUS, AMBIGUOUS}
    assert np.median(faint["doppler"][~doubtful]) == pytest.approx(25.0, abs=0.1)
    assert np.median(faint["doppler"][doubtful]) == pytest.approx(25.0 - 2 * RAMP, abs=0.1)


def test_what_may_stand_still_is_called_so():
    world = scene(ego=EGO, actors=[(point_actor(-8.0), path(at(68, 0, 0)))])
    faint = seen_at(world, scans=300, body=0)
    assert set(faint["ambig_state"]) == {UNAMBIGUOUS, MAYBE_STATIONARY}
    assert np.abs(faint["vx_comp"]).max() < 1.0  # the least speed that folds into the Doppler is the right one


@settings(max_examples=20)
@given(st.floats(0.0, 35.0), st.integers(0, 10_000))
def test_relative_and_compensated_velocity_differ_by_the_own_motion_along_the_ray_whatever_the_fold(speed, key):
    world = scene(
        ego=path(ORIGIN, velocity=(speed, 0, 0)),
        actors=[
            (point_actor(-5.0), path(at(40 + 6 * k, 4 * k - 8, 0), velocity=(12.0 * k - 25, 0, 0))) for k in range(5)
        ],
    )
    scan = scan_of(world, key=key)
    yaw = np.radians(2.0)  # of the mount: the ego drives along (cos, -sin) in the sensor's axes
    own = speed * np.cos(scan.azimuth + yaw)
    gained = (scan.vx_comp - scan.vx) * np.cos(scan.azimuth) + (scan.vy_comp - scan.vy) * np.sin(scan.azimuth)
    folds = (gained - own) / (2 * RADAR.max_doppler)  # at +-111 m/s the relative velocity itself folds
    np.testing.assert_allclose(folds, np.round(folds), atol=1e-4)


def test_half_of_the_mirror_images_are_suspected_and_few_others():
    world = wall_world()
    ghosts = [seen_at(world, AT_ORIGIN, scans=SCANS, cause=c) for c in (SINGLE_BOUNCE, DOUBLE_BOUNCE)]
    ghost = np.concatenate([seen["invalid_state"] for seen in ghosts])
    true = seen_at(world, AT_ORIGIN, scans=SCANS, cause=DIRECT)["invalid_state"]
    assert np.mean(ghost == MIRROR) == pytest.approx(MIRROR_FOUND, abs=3 * np.sqrt(0.25 / len(ghost)))
    assert np.mean(true == MIRROR) == pytest.approx(MIRROR_MISTAKEN, abs=3 * np.sqrt(0.02 / len(true)))


def test_a_low_cross_section_is_called_low_and_a_sure_one_surest():
    scans = [scan_of(street(), key=k) for k in range(40)]
    rcs, state, chance = (np.concatenate([getattr(s, n) for s in scans]) for n in ("rcs", "invalid_state", "pdh0"))
    assert set(state) == {VALID, LOW_RCS, MIRROR}
    assert np.all((state == LOW_RCS) == ((rcs < LOW_DBSM) & (state != MIRROR)))
    assert np.all(chance[(rcs > 10) & (state == VALID)] == 1)
    assert chance[state == MIRROR].min() == 4
    assert set(chance) == {1, 2, 3, 4}


def test_the_default_filter_of_nuscenes_drops_the_doubtful_and_keeps_most(tmp_path):
    left, true, total = 0, 0, 0
    for key in range(20):
        write_radar(tmp_path / "a.pcd", scan_of(street(), key=key))
        every, kept = (read_radar(tmp_path / "a.pcd", default_filter=f) for f in (False, True))
        total, left, true = total + len(every), left + len(kept), true + (every["ambig_state"] == UNAMBIGUOUS).sum()
    assert 0.6 * total < left < 0.98 * total
    assert true < total


def test_seen_from_a_standing_ego_what_stands_has_no_doppler_relative_or_compensated():
    world = scene(ego=path(ORIGIN), scatterers=reflectors([at(x, y, 0.5) for x in (20, 40) for y in (-8, 5)], 25.0))
    scan = scan_of(world)
    found = scan.body == -1
    assert found.sum() >= 3
    assert np.abs(np.stack([scan.vx, scan.vy, scan.vx_comp, scan.vy_comp, scan.doppler])[:, found]).max() < 0.1
    np.testing.assert_array_equal(scan.vx, scan.vx_comp)
