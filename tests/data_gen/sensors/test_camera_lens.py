"""What the camera itself adds to a picture: drops and dirt on the lens, motion blur, exposure."""

from dataclasses import replace

import numpy as np
import pytest

from data_gen.assets.catalogue import build_asset
from data_gen.sensors.camera import lens
from data_gen.sensors.camera.imaging import auto_exposure
from data_gen.sensors.camera.motion_blur import motion_blur
from data_gen.sensors.camera.rendering.renderer import Renderer
from fusion_net.common.random import stream
from tests.fixtures.box_world import ORIGIN, at, car, path, scene
from tests.fixtures.camera_world import CAMERA, DAY, FOG, LOW_SUN, NIGHT, OVERCAST, RAIN, pair, shoot, view_of


def test_drops_on_the_lens_stay_where_they_are_and_go_after_a_while():
    shape = (96, 320)
    first, soon, late = (lens.drops_at(3.0, t, 11, shape=shape) for t in (20.0, 20.5, 60.0))
    kept = np.isin(first[:, 3], soon[:, 3])
    assert kept.mean() > 0.7
    again = soon[np.argsort(soon[:, 3])][np.isin(np.sort(soon[:, 3]), first[:, 3])]
    before = first[kept][np.argsort(first[kept, 3])]
    np.testing.assert_array_equal(before[:, 0], again[:, 0])
    assert (again[:, 1] >= before[:, 1]).all()  # they slide down
    assert (again[:, 1] - before[:, 1] < 0.5 * before[:, 2]).all()
    assert not np.isin(first[:, 3], late[:, 3]).any()
    counts = [len(lens.drops_at(3.0, float(t), 11, shape=shape)) for t in range(0, 4000, 20)]
    assert np.mean(counts) == pytest.approx(3.0 * lens.LIFETIME, rel=0.1)


def test_the_picture_shows_the_same_drop_in_the_next_frame_and_another_lens_other_drops():
    world = scene(condition=RAIN)
    dry = scene(condition=replace(RAIN, rain_rate=0.0))
    plain = shoot(dry, t=5.0).image.astype(int)

    def wet(t, seed):
        difference = np.abs(shoot(world, t=t, lens_seed=seed).image.astype(int) - plain).sum(axis=2)
        return difference > 25

    now, next_frame, other = wet(5.0, 3), wet(5.1, 3), wet(5.0, 4)
    assert now.sum() > 20
    assert (now & next_frame).sum() > 0.6 * now.sum()
    assert (now & other).sum() < 0.4 * now.sum()


def test_a_moving_camera_smears_the_near_road_more_than_the_far_and_one_at_rest_nothing():
    texture = stream(5, "texture").random((CAMERA.height, CAMERA.width, 3)).astype(np.float32)
    left = {}
    for speed in (0.0, 20.0):
        world = scene(ego=path(ORIGIN, (speed, 0.0, 0.0)))
        renderer = Renderer(world, view_of(world), 0.0)
        rows, columns = np.indices((CAMERA.height, CAMERA.width))
        rays = renderer.view.rays(np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5)
        hits, _ = renderer.cast(rays)
        blurred = motion_blur(texture, renderer, CAMERA.cam_K, rays, hits, 1 / 60)
        if speed == 0.0:
            assert blurred is texture
        left = {row: blurred[row].std() / texture[row].std() for row in (5, 41, 78)}
    assert left[78] < 0.7 < 0.98 < left[41]
    assert left[5] == 1.0  # the sky


def test_a_body_that_crosses_is_smeared_by_its_own_speed_and_the_turn_smears_all():
    texture = stream(5, "texture").random((CAMERA.height, CAMERA.width, 3)).astype(np.float32)
    rows, columns = np.indices((CAMERA.height, CAMERA.width))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5
    worlds = {
        "crossing": scene(actors=[(car(), path(at(15.0, 0.0, 0.0), (0.0, 12.0, 0.0)))]),
        "turning": scene(ego=path(ORIGIN, (0.1, 0.0, 0.0), yaw_rate=0.6)),
    }
    change = {}
    for name, world in worlds.items():
        renderer = Renderer(world, view_of(world), 0.0)
        rays = renderer.view.rays(pixels)
        hits, _ = renderer.cast(rays)
        blurred = motion_blur(texture, renderer, CAMERA.cam_K, rays, hits, 1 / 40)
        change[name] = (np.abs(blurred - texture).max(axis=2) > 1e-4), hits.body.reshape(rows.shape)
    moved, body = change["crossing"]
    assert moved[body == 0].mean() > 0.95
    assert not moved[body != 0].any()
    assert change["turning"][0].mean() > 0.95


def test_dirt_covers_its_share_of_the_lens_and_stays():
    cover = [lens.dirt_cover(0.08, seed, shape=(96, 320)) for seed in range(60)]
    assert np.mean([c.mean() for c in cover]) / 0.6 == pytest.approx(0.08, rel=0.2)  # opaque by 0.6 on average
    np.testing.assert_array_equal(cover[7], lens.dirt_cover(0.08, 7, shape=(96, 320)))
    clean, dirty = (
        shoot(scene(condition=replace(OVERCAST, dirt=d)), lens_seed=2).image.astype(int) for d in (0.0, 0.08)
    )
    spots = lens.dirt_cover(0.08, 2, shape=(CAMERA.height, CAMERA.width)) > 0.3
    assert spots.any()
    assert np.abs(dirty - clean)[spots].mean() > 3 * np.abs(dirty - clean)[~spots].mean()


def test_the_meter_looks_at_the_middle_and_saves_the_highlights():
    middle = np.full((60, 120, 3), 50.0, np.float32)
    rim = middle.copy()
    middle[20:40, 40:80], rim[:20, :20], rim[-20:, -20:] = 200.0, 200.0, 200.0
    assert auto_exposure(middle).gain < auto_exposure(rim).gain
    bright_sky = np.full((60, 120, 3), 50.0, np.float32)
    bright_sky[:15] = 2_000.0
    exposure = auto_exposure(bright_sky)
    assert exposure.gain * 2_000.0 < 3.0


def test_the_dark_takes_a_longer_shutter_and_more_gain_and_stays_darker():
    exposures = [auto_exposure(np.full((20, 20, 3), level, np.float32)) for level in (1_000.0, 20.0, 1.0)]
    assert [e.shutter for e in exposures] == sorted(e.shutter for e in exposures)
    assert [e.iso for e in exposures] == sorted(e.iso for e in exposures)
    assert exposures[0].shutter < 1 / 250
    assert exposures[-1].shutter <= 1 / 40
    assert exposures[-1].gain * 1.0 < 0.5 * exposures[0].gain * 1_000.0


@pytest.mark.parametrize("condition", [NIGHT, LOW_SUN, FOG, replace(RAIN, spray=True, dirt=0.05)], ids=lambda c: c.name)
def test_the_same_seeds_give_the_same_bytes_whatever_was_rendered_before(condition):
    def world():
        return scene(
            actors=[*pair(), (build_asset("car", 1, 0), path(at(12.0, 2.5, 0.0), (12.0, 0.0, 0.0)))],
            condition=condition,
        )

    first = shoot(world(), t=0.7, lens_seed=9).image
    again = world()
    shoot(again, t=0.2, lens_seed=9)
    assert shoot(again, t=0.7, lens_seed=9).image.tobytes() == first.tobytes()


def test_a_clear_day_knows_nothing_of_the_lens():
    world = scene(actors=pair(), condition=DAY)
    assert shoot(world, lens_seed=1).image.tobytes() == shoot(world, lens_seed=2).image.tobytes()
