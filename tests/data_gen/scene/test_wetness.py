"""One film of water means the same to camera, LiDAR and spray."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_gen.scene.conditions import Condition
from data_gen.scene.spray import plumes_at
from data_gen.scene.wetness import ABSORBING, DROWNED_FILM, Wetness
from data_gen.sensors.camera.rendering.wet_road import soak
from data_gen.sensors.lidar.lidar import surface_returns
from data_gen.sensors.lidar.power import film_loss
from data_gen.sensors.lidar.weather import Rays
from data_gen.world.ground import GROUND_NAMES
from tests.fixtures.box_world import at, car, path, scene

FILMS = st.floats(0.0, 3.0)
DOWN = np.float32([[np.cos(a), 0.0, np.sin(a)] for a in np.radians(np.linspace(-60.0, -6.0, 40))])
EYE = np.array([0.0, 0.0, 1.8])


def world(film, *, ground="asphalt", spray=False):
    leader = (car(), path(at(25.0, 0.0, 0.0), (25.0, 0.0, 0.0)))
    return scene(
        actors=[leader] if spray else [],
        ground=ground,
        condition=Condition(visibility=1e9, water_film=film, spray=spray),
    )


def lidar_loss(film, ground="asphalt"):
    """Received power (N,) of the ground's returns over that of the dry ground."""
    power = []
    for each in (film, 0.0):
        place = world(each, ground=ground)
        origins = np.broadcast_to(EYE, DOWN.shape)
        hits = place.cast(origins, DOWN, np.zeros(len(DOWN)), 100.0)
        rays = Rays(origins, DOWN.astype(float), np.zeros(len(DOWN)))
        power.append(surface_returns(place, hits, rays, max_range=100.0).snr)
    return power[0] / power[1]


def water_in_the_picture(film, ground="asphalt"):
    """Mean fraction of the ground that the camera's renderer covers with water, and how dark it becomes."""
    place = world(film, ground=ground)
    hits = place.cast(np.broadcast_to(EYE, DOWN.shape), DOWN, np.zeros(len(DOWN)), 100.0)
    colors = np.full((len(DOWN), 5), 0.2, np.float32)
    colors[:, 3:] = 0.0
    if place.wetness.is_wet:
        soak(place, hits, np.arange(len(DOWN)), colors)
    return float(colors[:, 3].mean()), float(colors[:, 0].mean())


@given(FILMS)
def test_a_film_grows_from_dry_to_drowned(film):
    thin, thick = Wetness(film), Wetness(film + 0.1)
    assert 0.0 <= thin.covered <= thick.covered <= 1.0
    assert thin.darkened <= thick.darkened
    assert thin.is_wet == (thin.covered > 0.0)
    assert thin.is_wet or not thin.feeds_spray  # no spray from a road that every other sensor calls dry
    assert Wetness(DROWNED_FILM + film).covered == 1.0


@pytest.mark.parametrize("film", [0.0, 0.02, 0.05, 0.06, 0.2, 0.4, 0.8, 1.2, 2.0])
def test_camera_and_lidar_agree_whether_and_how_far_a_road_is_wet(film):
    """Where a film is for one sensor it is for the other, and both take the same fraction of the ground for covered."""
    wetness = Wetness(film)
    loss, (covered, _) = lidar_loss(film), water_in_the_picture(film)
    assert (loss < 1.0).all() == wetness.is_wet == (covered > 0.0)
    cosine = -DOWN[:, 2].astype(float)
    np.testing.assert_allclose(loss, film_loss(cosine, wetness.covered), rtol=1e-5)
    assert covered == pytest.approx(wetness.covered, abs=0.25)  # water stands in patches: a mean over few places


@pytest.mark.parametrize("ground", GROUND_NAMES)
def test_the_same_grounds_absorb_water_for_camera_and_lidar(ground):
    absorbing = bool(ABSORBING[GROUND_NAMES.index(ground)])
    assert np.allclose(lidar_loss(1.0, ground), 1.0) == absorbing
    assert (water_in_the_picture(1.0, ground)[0] == 0.0) == absorbing


@pytest.mark.parametrize("film", [0.04, 0.2, 0.31, 1.0])
def test_spray_rises_only_from_a_road_that_the_others_call_wet(film):
    plumes = len(plumes_at(world(film, spray=True), 0.0).length)
    assert plumes == int(Wetness(film).feeds_spray)
    assert not plumes or ((lidar_loss(film) < 1.0).all() and water_in_the_picture(film)[0] > 0.0)
