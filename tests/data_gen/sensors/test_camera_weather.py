"""The camera in bad weather against physics: fog, rain, a wet road, spray."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from data_gen.scene.conditions import Condition
from data_gen.sensors.camera import glare
from data_gen.sensors.camera import rain as rain_image
from data_gen.sensors.camera.camera import render_luminance
from data_gen.sensors.camera.rendering import wet_road
from data_gen.sensors.camera.rendering.renderer import Renderer
from fusion_net.common.random import stream
from tests.fixtures.box_world import at, path, scene
from tests.fixtures.camera_world import (
    CAMERA,
    DAY,
    FOG,
    NIGHT,
    OVERCAST,
    RAIN,
    painted,
    pair,
    pixel_of,
    shoot,
    view_of,
)


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
