"""The camera in bad light against physics: the low sun, night and dusk."""

from dataclasses import replace

import numpy as np
import pytest

from data_gen.assets.catalogue import build_asset
from data_gen.road.track import Track
from data_gen.scene.conditions import Condition
from data_gen.scene.light import light_of, sky
from data_gen.scene.luminaires import luminaires
from data_gen.sensors.camera import glare
from data_gen.sensors.camera.camera import render_luminance
from data_gen.sensors.camera.rendering.lamps import BRAKE, add_street_lux
from data_gen.sensors.camera.rendering.renderer import Renderer
from tests.fixtures.box_world import ORIGIN, at, box, scene
from tests.fixtures.camera_world import CAMERA, DAY, LOW_SUN, NIGHT, contrast, pair, pixel_of, shoot, view_of


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
