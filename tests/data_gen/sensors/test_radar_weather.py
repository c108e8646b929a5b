"""Fog, night and sun are nothing to a radar, and rain is little."""

import numpy as np
import pytest

from data_gen.assets.shapes.mesh import Asset
from data_gen.scene.conditions import Condition
from data_gen.sensors.radar.detection import CLUTTER, RAIN, SPRAY, link_budget_db
from tests.fixtures.box_world import ORIGIN, at, car, path, reflectors, scene
from tests.fixtures.radar_world import RADAR, point_actor, scan_of, seen_at

RAIN_25 = Condition("rain", rain_rate=25.0)


def street(condition):
    """Two cars, a wall that mirrors them, posts."""
    cars = [
        (car(reflectors([[-2.2, 0, 0.5], [2.2, 0.9, 0.5]], 10.0)), path(at(30 * k, 2, 0), (8, 0, 0))) for k in (1, 2)
    ]
    strip = reflectors([at(x, 5.0, 0.6) for x in range(1, 60)], 0.0, (0.0, -1.0, 0.0))
    return scene(actors=cars, scatterers=strip, ego=path(ORIGIN, (15.0, 0, 0)), condition=condition)


@pytest.mark.parametrize(
    "condition",
    [
        Condition("fog", visibility=50.0, illuminance=6_000.0),
        Condition("night", illuminance=1.0, sun_elevation=-30.0),
        Condition("glare", sun_azimuth=0.0, sun_elevation=4.0),
        Condition("wet", water_film=1.0, dirt=0.1),
    ],
    ids=lambda c: c.name,
)
def test_fog_night_sun_and_a_wet_road_change_no_bit(condition):
    for key in range(5):
        clear, other = scan_of(street(Condition()), key=key), scan_of(street(condition), key=key)
        assert len(clear.x) > 5
        assert all(getattr(clear, n).tobytes() == getattr(other, n).tobytes() for n in vars(clear))


def test_rain_costs_what_the_drops_on_the_way_and_the_film_on_the_radome_take():
    """ITU-R P.838: 11.4 dB/km at 25 mm/h, both ways; the film grows with the cube root of the rain: 1.09 * 25^(1/3) = 3.2."""
    target = (point_actor(), path(at(60, 0, 0)))
    power = [
        np.mean(10 ** (seen_at(scene(actors=[target], condition=c), scans=100, body=0)["snr_db"] / 10))
        for c in (Condition(), RAIN_25)
    ]
    assert 10 * np.log10(power[0] / power[1]) == pytest.approx(2 * 0.0114 * 56.6 + 3.2, abs=0.2)
    drop = [link_budget_db(r, 0.0, RADAR) - link_budget_db(r, 0.0, RADAR, 25.0) for r in (1.0, 101.0)]
    assert drop[1] - drop[0] == pytest.approx(2.28, abs=0.02)
    for rate, low, high in ((2.0, 1.0, 2.0), (50.0, 3.5, 4.2)):
        assert low < link_budget_db(1.0, 0.0, RADAR) - link_budget_db(1.0, 0.0, RADAR, rate) < high


def test_drops_are_a_few_weak_detections_within_twenty_metres_that_move_with_the_air():
    ego = path(ORIGIN, velocity=(20, 0, 0))
    seen = seen_at(scene(ego=ego, condition=RAIN_25), scans=400, cause=RAIN)
    assert len(seen["x"]) / 400 == pytest.approx(2.5, abs=3 * np.sqrt(2.5 / 400))
    assert seen["range"].max() < 20.5
    assert np.mean(seen["range"] < 10) == pytest.approx(0.75, abs=0.05)  # ever fewer with range
    assert np.median(seen["snr_db"]) < 14
    ground = np.hypot(seen["vx_comp"], seen["vy_comp"])
    assert np.sqrt(np.mean(ground**2)) == pytest.approx(1.0, abs=0.1)
    clutter = seen_at(scene(ego=ego, condition=RAIN_25), scans=400, cause=CLUTTER)
    assert len(clutter["x"]) / 400 == pytest.approx(5.0, abs=3 * np.sqrt(5 / 400))


def wet_road(spray, *extra):
    """A lorry of hardly any echo at 20 m/s on 1 mm of water, its middle 26 m ahead at 0.5 s."""
    size = (8.0, 2.5, 3.5)
    shape = car(size=size)
    asset = Asset("lorry", "vehicle.truck", size, shape.mesh, reflectors([0, 0, 3.4], -40.0))
    actors = [(asset, path(at(16.0, 0, 0), velocity=(20.0, 0, 0))), *extra]
    return scene(actors=actors, condition=Condition("spray", water_film=1.0, spray=spray))


def test_spray_is_none_to_two_weak_clusters_behind_a_lorry_at_0_3_to_0_6_of_its_speed():
    seen = seen_at(wet_road(True), scans=200, cause=SPRAY)
    count = len(seen["x"]) / 200
    assert 0.3 < count < 1.1  # one in the mean, less those behind the lorry's axle and those too faint
    rear = 26.0 - 4.0 - RADAR.translation[0]
    assert seen["range"].min() > rear - 8.0 - 0.5
    assert seen["range"].max() < rear + 2.0
    speed = np.hypot(seen["vx_comp"], seen["vy_comp"]) / np.cos(seen["azimuth"] + np.radians(2))
    assert speed.min() > 0.25 * 20
    assert speed.max() < 0.65 * 20
    assert np.median(seen["rcs"]) < 0
    assert not len(seen_at(wet_road(False), scans=50, cause=SPRAY)["x"])


def test_a_body_before_the_spray_hides_it():
    blocker = (car(size=(1.0, 12.0, 4.0)), path(at(9.0, 0, 0)))
    assert not len(seen_at(wet_road(True, blocker), scans=50, cause=SPRAY)["x"])
