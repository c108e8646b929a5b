"""The camera in bad weather and bad light against physics: glare, night, fog, rain, a wet road, spray, motion and dirt."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from data_gen.assets.catalogue import build_asset
from data_gen.assets.shapes.mesh import Asset
from data_gen.rig.mounts import Camera
from data_gen.road.track import Track
from data_gen.scene.conditions import Condition
from data_gen.scene.light import light_of, sky
from data_gen.scene.luminaires import luminaires
from data_gen.sensors.camera import glare, lens
from data_gen.sensors.camera import rain as rain_image
from data_gen.sensors.camera.camera import render_luminance, sense
from data_gen.sensors.camera.imaging import auto_exposure
from data_gen.sensors.camera.motion_blur import motion_blur
from data_gen.sensors.camera.rendering import wet_road
from data_gen.sensors.camera.rendering.lamps import BRAKE, add_street_lux
from data_gen.sensors.camera.rendering.renderer import PinholeView, Renderer
from data_gen.sensors.common.event import CaptureEvent
from fusion_net.common.geometry import invert, project, transform
from fusion_net.common.random import stream
from tests.fixtures.box_world import ORIGIN, at, box, car, path, scene

CAMERA = Camera(translation=[0.3, 0.1, 1.5], width=200, height=80, hfov_deg=60.0, rate=30.0, principal=[104.0, 37.0])
DAY = Condition(illuminance=60_000.0, sun_azimuth=120.0, sun_elevation=45.0)
OVERCAST = Condition("grey", illuminance=6_000.0, sun_elevation=40.0)
NIGHT = Condition("night", illuminance=2.0, sun_elevation=-30.0)
LOW_SUN = Condition("glare", illuminance=12_000.0, sun_azimuth=0.0, sun_elevation=12.0)
FOG = Condition("fog", illuminance=5_000.0, sun_elevation=30.0, visibility=60.0)
RAIN = Condition("rain", illuminance=5_000.0, sun_elevation=40.0, rain_rate=30.0, visibility=500.0, water_film=0.9)


def shoot(world, *, t=0.0, seed=1, camera=CAMERA, **kwargs):
    return sense(world, CaptureEvent.nominal(camera, t, stream(seed, "camera"), **kwargs))


def view_of(world) -> PinholeView:
    return PinholeView(CAMERA.cam_K, world.ego.pose(0.0) @ CAMERA.ego_T_sensor)


def pixel_of(world, point) -> tuple[int, int]:
    """Row and column of the pixel that shows a global point."""
    (uv,), _ = project(CAMERA.cam_K, transform(invert(world.ego.pose(0.0) @ CAMERA.ego_T_sensor), [point]))
    return int(uv[1]), int(uv[0])


def painted(size, albedo, **surface) -> Asset:
    """A box on the ground of one colour."""
    body = car(size=size)
    body.mesh.surface.albedo[:] = albedo
    for name, value in surface.items():
        getattr(body.mesh.surface, name)[:] = value
    return body


def pair(distance=25.0):
    """A dark and a bright box side by side ahead."""
    return [(painted((1.0, 2.0, 2.0), albedo), path(at(distance, y, 0.0))) for albedo, y in ((0.05, 1.5), (0.6, -1.5))]


def contrast(world, **kwargs) -> float:
    """(bright - dark) / (bright + dark) of the two bodies of :func:`pair` in the picture, in linear light."""
    frame = shoot(world, **kwargs)
    dark, bright = ((frame.image[frame.body == k] / 255.0).mean() ** 2.2 for k in (0, 1))
    return (bright - dark) / (bright + dark)


# -- glare


def test_the_sun_takes_contrast_from_a_camera_that_faces_it_unless_it_is_hidden():
    canopy = box((1.0, 4.0, 4.0), at(9.0, 0.0, 4.8))  # above the picture, before the sun
    facing, hidden = (scene(actors=pair(), walls=walls, condition=LOW_SUN) for walls in ((), [canopy]))
    behind = scene(actors=pair(), condition=replace(LOW_SUN, sun_azimuth=180.0))
    assert not (shoot(hidden).body == -1)[:3].all()
    assert contrast(facing) < 0.85 * contrast(hidden)
    light = light_of(LOW_SUN, "boxes")
    assert glare.sun_on_lens(facing, view_of(facing), light, 0.0).all()
    for world in (hidden, behind):
        assert not glare.sun_on_lens(world, view_of(world), light_of(world.condition, "boxes"), 0.0).any()


def test_a_camera_that_faces_away_from_the_sun_gets_no_stray_light():
    world = scene(condition=replace(LOW_SUN, sun_azimuth=170.0))
    renderer = Renderer(world, view_of(world), 0.0)
    sun = glare.sun_on_lens(world, renderer.view, renderer.light, 0.0)
    distance = np.full((CAMERA.height, CAMERA.width), 50.0, np.float32)
    assert glare.veil(renderer.view, renderer.light, sun, renderer.lamps.points, distance, 1.0) is None


def test_the_veil_falls_with_the_square_of_the_angle_and_grows_with_dirt():
    world = scene(condition=LOW_SUN)
    renderer = Renderer(world, view_of(world), 0.0)
    sun = glare.sun_on_lens(world, renderer.view, renderer.light, 0.0)
    distance = np.full((CAMERA.height, CAMERA.width), 50.0, np.float32)
    clean, dirty = (
        glare.veil(renderer.view, renderer.light, sun, renderer.lamps.points, distance, glare.straylight(condition))
        for condition in (LOW_SUN, replace(LOW_SUN, dirt=0.1))
    )
    rows, column = np.array([25, 70]), 104
    rays = renderer.view.rays(np.stack([[column + 0.5] * 2, rows + 0.5], axis=1))
    angle = np.degrees(np.arccos(rays @ renderer.light.sun_direction))
    upper, lower = clean[rows, column, 1]
    assert upper / lower == pytest.approx((angle[1] / angle[0]) ** 2, rel=0.1)
    np.testing.assert_allclose(dirty, clean / glare.CLEAN, rtol=1e-4)
    e = float(sun[1])  # Stiles and Holladay, for the eye
    assert lower == pytest.approx(glare.CLEAN * 10 * e / angle[1] ** 2, rel=0.1)


# -- night and dusk


def test_brake_lamps_shine_eight_times_as_bright_as_tail_lamps_and_parked_cars_are_dark():
    times = np.linspace(-1.0, 1.0, 21)

    def driven(y, slowing):
        x = 14.0 + 10.0 * times - 0.5 * slowing * times**2
        position = np.stack([ORIGIN[0] + x, np.full_like(x, ORIGIN[1] + y), 0 * x], axis=1)
        velocity = np.stack([10.0 - slowing * times, 0 * x, 0 * x], axis=1)
        return Track(times, position, 0 * x, velocity)

    asset = build_asset("car", 0, 2)
    world = scene(
        actors=[(asset, driven(-3.0, 0.0)), (asset, driven(0.0, 3.0)), (asset, driven(3.0, 0.0))], condition=NIGHT
    )
    world.actors[2] = replace(world.actors[2], attribute="vehicle.parked")
    light, hits = render_luminance(world, CAMERA, t=0.0)
    emission = world.surface.emission[hits.face] * (hits.body >= 0)
    lamp = [light.reshape(-1, 3)[(hits.body == k) & (emission > 0), 0] for k in range(3)]
    assert min(len(part) for part in lamp) >= 4
    tail, brake, parked = (np.median(part) for part in lamp)
    assert brake / tail == pytest.approx(BRAKE, rel=0.1)
    assert parked < 0.05 * tail


def test_a_street_lamp_throws_a_pool_of_light_at_night_only():
    """Lambert: flux / pi / h^2 below it, and cos^4 of that beside."""
    head = box((0.5, 0.5, 0.2), at(20.0, 0.0, 8.1))
    down = np.flatnonzero(
        np.cross(*(head.vertices[head.faces[:, k]] - head.vertices[head.faces[:, 0]] for k in (1, 2)))[:, 2] < 0
    )
    head.surface.emission[down], head.surface.albedo[:] = 40.0, 0.9
    lamp = luminaires(head)
    assert lamp.flux.sum(axis=0) == pytest.approx([0.25 * 40_000 * 0.9] * 3)
    for side in (0.0, 8.0):
        lux = np.zeros(3)
        add_street_lux(at(20.0, side, 0.0), np.array([0.0, 0.0, 1.0]), lamp, lux)
        expected = lamp.flux.sum(axis=0) / np.pi / 64.0 * np.cos(np.arctan(side / 8.0)) ** 4
        np.testing.assert_allclose(lux, expected, rtol=0.02)
    below, aside = {}, {}
    for condition in (NIGHT, DAY):
        world = scene(walls=[head], condition=condition)
        light, _ = render_luminance(world, CAMERA, t=0.0)
        below[condition.name], aside[condition.name] = (light[pixel_of(world, at(20.0, y, 0.0))][2] for y in (2.5, 8.5))
    assert below["night"] > 3 * aside["night"]
    assert below["clear"] == pytest.approx(aside["clear"], rel=0.3)


def test_the_sky_of_dusk_glows_warm_above_the_set_sun():
    light = light_of(Condition("dusk", illuminance=300.0, sun_azimuth=0.0, sun_elevation=-3.0), "a")
    towards, away = sky(np.array([[0.995, 0.0, 0.1], [-0.995, 0.0, 0.1]], np.float32), light, 0.003)
    assert towards[1] > 1.5 * away[1]
    assert towards[0] / towards[2] > 1.3 * away[0] / away[2]


def test_dusk_darkens_from_day_to_night_without_a_jump():
    elevations = np.arange(-14.0, 4.0, 0.5)
    lux = 10 ** np.interp(elevations, [-14, -6, 0, 4], [0.6, 1.2, 2.9, 3.6])
    level = [
        np.log10(light_of(Condition("d", illuminance=float(e), sun_elevation=float(a)), "a").zenith[1])
        for e, a in zip(lux, elevations, strict=True)
    ]
    assert (np.diff(level) > 0).all()
    assert np.diff(level).max() < 0.5


# -- fog


def test_fog_hides_the_sky_too_and_leaves_depth_and_bodies_exact():
    clear, fog = (scene(actors=pair(), condition=c) for c in (OVERCAST, FOG))
    sky_rows = np.s_[:8]
    spread = {}
    for name, world in (("clear", scene(condition=DAY)), ("fog", fog)):
        light, _ = render_luminance(world, CAMERA, t=0.0)
        spread[name] = np.std(np.log(light[sky_rows, :, 1]))
    assert spread["fog"] < 0.02 < spread["clear"]
    first, second = shoot(clear), shoot(fog)
    np.testing.assert_array_equal(first.depth, second.depth)
    np.testing.assert_array_equal(first.body, second.body)


def test_haze_is_brighter_towards_the_sun():
    hazy = Condition("haze", illuminance=15_000.0, sun_azimuth=0.0, sun_elevation=20.0, visibility=300.0)
    ahead, back = (
        render_luminance(scene(condition=replace(hazy, sun_azimuth=a)), CAMERA, t=0.0)[0][30:36, :, 1].mean()
        for a in (0.0, 180.0)
    )
    assert ahead > 1.15 * back


def test_a_lamp_in_fog_has_a_halo_that_clear_air_does_not_give_it():
    lamp = painted((0.2, 0.2, 1.0), 0.9, emission=30.0)
    halo = {}
    for name, condition in (("clear", NIGHT), ("fog", replace(NIGHT, visibility=80.0))):
        world = scene(actors=[(lamp, path(at(15.0, 0.0, 0.8), (-8.0, 0.0, 0.0)))], condition=condition)
        renderer = Renderer(world, view_of(world), 0.0)
        assert len(renderer.lamps.points.position) >= 1
        distance = np.full((CAMERA.height, CAMERA.width), np.inf, np.float32)
        veil = glare.veil(renderer.view, renderer.light, np.zeros(3), renderer.lamps.points, distance, glare.CLEAN)
        row, column = pixel_of(world, at(15.0, 0.0, 1.3))
        halo[name] = veil[row, [column, column + 15, column + 40], 1]
    assert (np.diff(halo["fog"]) < 0).all()
    assert halo["fog"][1] > 3 * halo["clear"][1]


# -- rain


def test_the_drops_that_show_are_those_of_marshall_and_palmer():
    """N0 exp(-slope D) in the part of the frustum up to the depth f D / least width, integrated numerically."""
    K, width, height, rate = np.array([[900.0, 0, 300], [0, 900.0, 120], [0, 0, 1]]), 640, 240, 25.0
    slope, reach = 4.1 * rate**-0.21, 0.9 / rain_image.LEAST_WIDTH

    def density(d):
        far, near = min(reach * d, 15.0), 0.3
        return 8000.0 * math.exp(-slope * d) * width * height / 900.0**2 * max(far**3 - near**3, 0.0) / 3

    expected = quad(density, 0.0, 6.0, limit=200)[0]
    drops = [rain_image.visible_drops(height, width, K, rate, stream(4, k)) for k in range(20)]
    assert np.mean([len(diameter) for diameter, _ in drops]) == pytest.approx(expected, rel=0.05)
    for diameter, place in drops[:3]:
        assert (900.0 * 1e-3 * diameter / place[:, 2] >= rain_image.LEAST_WIDTH * 0.999).all()


def test_streaks_are_upright_for_a_camera_at_rest_and_longer_with_the_shutter():
    K = np.array([[500.0, 0, 160], [0, 500.0, 80], [0, 0, 1]])
    size = {}
    for shutter in (1 / 1000, 1 / 50):
        image = np.zeros((160, 320, 3), np.float32)
        image[:53] = 1.0
        rain_image.add_streaks(
            image, K, np.zeros(3), np.array([0.0, 1.0, 0.0]), rain_rate=40.0, shutter=shutter, rng=stream(1, "rain")
        )
        rain = image[60:, :, 1] - image[60:, :, 1].mean()
        along, across = ((rain[4:] * rain[:-4]).mean(), (rain[:, 4:] * rain[:, :-4]).mean())
        size[shutter] = along / across
    assert size[1 / 50] > 2 * max(size[1 / 1000], 1.0), size


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


# -- wet road


def test_a_wet_road_mirrors_a_lamp_towards_the_camera():
    lamp = painted((0.3, 0.3, 0.4), 0.9, emission=30.0)
    track = path(at(22.0, -1.0, 1.2), (-8.0, 0.0, 0.0))
    strip, beside = {}, {}
    for name, film in (("dry", 0.0), ("wet", 1.0)):
        world = scene(actors=[(lamp, track)], condition=replace(NIGHT, water_film=film))
        light, _ = render_luminance(world, CAMERA, t=0.0)
        row, column = pixel_of(world, at(22.0, -1.0, -1.4))  # the lamp under the mirror
        strip[name], beside[name] = (
            light[row - 2 : row + 3, column, 1].mean(),
            light[row - 2 : row + 3, column + 15, 1].mean(),
        )
    assert strip["wet"] > 3 * beside["wet"]
    assert strip["dry"] < 1.5 * beside["dry"]


def test_a_wet_road_mirrors_bodies_and_darkens():
    red = painted((2.0, 3.0, 3.0), (0.6, 0.02, 0.02))
    light = {}
    for film in (0.0, 1.0):
        world = scene(actors=[(red, path(at(25.0, 0.0, 0.0)))], condition=replace(OVERCAST, water_film=film))
        light[film], hits = render_luminance(world, CAMERA, t=0.0)
        row, column = pixel_of(world, at(24.0, 0.0, -1.5))
        assert hits.body[row * CAMERA.width + column] == -1
    redness = {film: image[row, column, 0] / image[row, column, 2] for film, image in light.items()}
    assert redness[1.0] > 1.2 * redness[0.0]
    renderer = Renderer(scene(condition=RAIN), view_of(scene(condition=RAIN)), 0.0)
    rays = renderer.view.rays(np.array([[100.5, 60.5], [40.5, 75.5]]))
    hits, _ = renderer.cast(rays)
    dry = renderer.paint(rays, hits, 1.0)
    soaked = dry.copy()
    wet_road.soak(renderer.scene, hits, np.arange(2), soaked)
    assert (soaked[:, :3] < 0.75 * dry[:, :3]).all()
    assert (soaked[:, 3] > 0).all()


def test_the_mirror_shows_nothing_on_grass():
    for ground, changes in (("asphalt", True), ("grass", False)):
        dry, wet = (
            render_luminance(scene(ground=ground, condition=replace(OVERCAST, water_film=film)), CAMERA, t=0.0)[0][60:]
            for film in (0.0, 1.0)
        )
        assert (np.abs(wet / dry - 1).max() > 0.1) == changes


# -- spray


def test_spray_hides_what_is_behind_the_lorry():
    wet = Condition("spray", illuminance=8_000.0, sun_elevation=40.0, water_film=1.2, spray=True)
    lorry = replace(painted((8.0, 2.5, 3.2), 0.05), category="vehicle.truck")
    light = {}
    for name, condition in (("spray", wet), ("none", replace(wet, spray=False))):
        world = scene(actors=[(lorry, path(at(22.0, 0.0, 0.0), (25.0, 0.0, 0.0)))], condition=condition)
        light[name], hits = render_luminance(world, CAMERA, t=0.0)
        rear = (hits.body == 0).reshape(CAMERA.height, CAMERA.width)
    rows = np.flatnonzero(rear.any(axis=1))
    low, high = (
        rear & (np.arange(CAMERA.height)[:, None] > rows[-4]),
        rear & (np.arange(CAMERA.height)[:, None] < rows[3]),
    )
    gain = {part: (light["spray"] / light["none"])[mask, 1].mean() for part, mask in (("low", low), ("high", high))}
    assert gain["low"] > 1.3  # mist is brighter than a dark lorry
    assert gain["low"] > gain["high"]


# -- motion


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


# -- lens and exposure


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
