import numpy as np
import pytest

from data_gen.assets.shapes.mesh import Asset
from data_gen.rig.mounts import Lidar
from data_gen.scene.conditions import Condition
from data_gen.scene.scene import NOTHING, WORLD
from data_gen.sensors.common.event import CaptureEvent
from data_gen.sensors.lidar.lidar import firing_pattern, sense
from data_gen.sensors.lidar.power import Returns, film_loss, strongest
from data_gen.sensors.lidar.scatter import DROP, drop_echoes, echo_table, fog_power, sample_echoes
from data_gen.sensors.lidar.weather import Rays, with_weather
from fusion_net.common.geometry import transform
from fusion_net.common.random import stream
from tests.fixtures.box_world import at, box, car, path, scene
from tests.fixtures.lidar_models import HDL32E

LIDAR = Lidar(model=HDL32E, translation=[0.0, 0.0, 1.8], columns=2170, sector_deg=[-35.0, 35.0], rate=10.0)
DIVERGENCE = HDL32E.divergence
AIR = Condition(visibility=1e9)
SPRAY = Condition("spray", spray=True, water_film=1.2)
RAYS = len(firing_pattern(LIDAR)[1])


def sweep_of(world, lidar=LIDAR, key=0):
    return sense(world, CaptureEvent.nominal(lidar, 0.4, stream(5, key)))


def in_ego(sweep, lidar=LIDAR):
    return transform(lidar.ego_T_sensor, sweep.points)


def wall(distance, reflectivity=0.5):
    return box((1.0, 120.0, 120.0), at(distance + 0.5, 0, 0), reflectivity)


@pytest.mark.parametrize(("rain_rate", "published"), [(5.0, 0.039), (10.0, 0.059), (25.0, 0.101), (50.0, 0.151)])
def test_rain_gives_the_published_number_of_echoes(rain_rate, published):
    """M(P_min) of a beam that meets nothing, for a sensor of 200 m."""
    x = np.linspace(1.5, 60, 20_000)
    assert np.trapezoid(drop_echoes(0.9 / 200**2, x, rain_rate, DIVERGENCE), x) == pytest.approx(published, rel=0.03)
    _, _, snr = sample_echoes(
        echo_table(rain_rate, 0.0, 0.0, 200.0, DIVERGENCE), np.full(200_000, 200.0), np.random.default_rng(0)
    )
    assert np.sum(snr > 1) / 200_000 == pytest.approx(1 - np.exp(-published), rel=0.04)


def test_the_strongest_drop_is_that_of_a_simulation_drop_by_drop():
    """Drops of a whole beam of 12 m, one by one, against one draw: power and place of the strongest."""
    rng, rays, reach, rain_rate = np.random.default_rng(1), 160_000, 12.0, 50.0
    shape = 4.1 * rain_rate**-0.21
    mean = 8000 / shape * np.pi / 3 * reach * (DIVERGENCE * reach / 2) ** 2
    ray = np.repeat(np.arange(rays), rng.poisson(mean, rays))
    distance = reach * rng.random(len(ray)) ** (1 / 3)
    diameter = 1e-3 * rng.exponential(1 / shape, len(ray))
    power = DROP * (diameter / (DIVERGENCE * distance)) ** 2 / distance**2 * (distance > 1.5)
    order = np.lexsort((power, ray))
    last = order[np.flatnonzero(np.diff(np.append(ray[order], rays)))]
    expected, place = power[last] / (0.9 / 1e4), distance[last]

    _, drawn, snr = sample_echoes(echo_table(rain_rate, 0.0, 0.0, 100.0, DIVERGENCE), np.full(rays, reach), rng)
    for level in (0.5, 1.0, 3.0):
        assert (snr > level).sum() / rays == pytest.approx((expected > level).sum() / rays, rel=0.1)
    for level in (0.4, 1.0):
        assert np.median(drawn[snr > level]) == pytest.approx(np.median(place[expected > level]), rel=0.05)


def test_false_returns_of_rain_are_near_faint_and_no_body():
    clear, wet = (sweep_of(scene(with_ground=False, condition=c)) for c in (AIR, Condition(rain_rate=50.0)))
    assert len(clear.points) == 0
    distance = np.linalg.norm(wet.points, axis=1)
    assert 0.02 < len(distance) / RAYS < 0.08
    assert 1.1 < distance.min() < np.quantile(distance, 0.95) < 6.0
    assert np.all(wet.body == NOTHING)
    assert wet.intensity.max() < 5


def test_no_drop_is_heard_from_behind_a_wall():
    sweep = sweep_of(scene(walls=[wall(2.2, 0.001)], with_ground=False, condition=Condition(rain_rate=50.0)))
    assert np.count_nonzero(sweep.body == NOTHING) > 20
    assert in_ego(sweep)[:, 0].max() < 2.6


def test_fog_returns_come_from_a_few_metres_and_grow_with_its_density():
    share = []
    for visibility in (50.0, 100.0, 200.0, 1500.0):
        sweep = sweep_of(scene(with_ground=False, condition=Condition("fog", visibility=visibility)))
        distance = np.linalg.norm(sweep.points, axis=1)
        share.append(len(distance) / RAYS)
        if visibility < 150:
            assert 2.0 < np.median(distance) < 6.0
            assert distance.max() < 20.0
    assert 0.1 < share[0] < 0.4
    assert share[0] > 4 * share[1] > 16 * share[2]
    assert share[3] == 0


def test_the_power_of_fog_falls_with_what_lies_before_it():
    power = fog_power(np.array([2.0, 4.0, 10.0, 20.0, 40.0]), 0.06, 0.06)
    assert np.all(np.diff(power) < 0)
    assert power[0] / power[1] == pytest.approx(np.exp(2 * 0.06 * 2))  # the overlap makes up for the distance
    assert power[2] / power[3] == pytest.approx(4 * np.exp(2 * 0.06 * 10))


def test_fog_hides_what_is_weaker_than_itself():
    """A 10 % wall in a visibility of 50 m is lost near 14 m, and a 50 % one between 17 and 25."""
    fog = Condition("fog", visibility=50.0)

    def share(distance, reflectivity):
        sweep = sweep_of(scene(walls=[wall(distance, reflectivity)], with_ground=False, condition=fog))
        level = np.abs(sweep.points[:, 2] / sweep.points[:, 1]) < 0.1
        return np.mean(sweep.body[level] == WORLD) if level.any() else 0.0

    assert share(11.0, 0.1) > 0.7
    assert share(17.0, 0.1) < 0.25
    assert share(17.0, 0.5) > 0.7
    assert share(25.0, 0.5) < 0.25


def test_wet_asphalt_mirrors_the_far_returns_away():
    reach, near = [], []
    for film in (0.0, 0.6, 1.2, 5.0):
        sweep = sweep_of(scene(condition=Condition(visibility=1e9, water_film=film)))
        distance = np.linalg.norm(sweep.points, axis=1)
        reach.append(np.quantile(distance, 0.995))
        near.append(np.count_nonzero(distance < 6.0))
    assert reach[0] > 23
    assert 13 < reach[2] < 18
    assert reach[0] > reach[1] + 2 > reach[2] + 3
    assert reach[3] == reach[2]  # the texture has drowned
    assert near[2] > 0.95 * near[0]
    soaked = [sweep_of(scene(condition=Condition(visibility=1e9, water_film=w), ground="grass")) for w in (0.0, 1.2)]
    np.testing.assert_array_equal(soaked[0].points, soaked[1].points)


def test_the_film_passes_steep_light_and_mirrors_grazing_light():
    np.testing.assert_allclose(film_loss(np.array([1.0]), 1.0), (1 - DROP) ** 2)
    loss = film_loss(np.cos(np.radians([0, 60, 80, 85, 90])), 1.0)
    assert np.all(np.diff(loss) < 0)
    assert loss[-1] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(film_loss(np.array([0.1]), 0.0), 1.0)


def lorry(condition, *, speed=25.0, more=()):
    size = (9.0, 2.5, 3.5)
    body = car(size=size)
    truck = Asset("truck", "vehicle.truck", size, body.mesh, body.scatterers)
    moving = (speed, 0.0, 0.0)
    actors = [(truck, path(at(25, 0, 0), moving)), *((asset, path(p, moving)) for asset, p in more)]
    return scene(actors=actors, ego=path(at(0, 0, 0), moving), condition=condition)


def test_spray_returns_cluster_behind_the_truck_and_are_faint():
    sweep = sweep_of(lorry(SPRAY))
    x, y, z = in_ego(sweep)[sweep.body == NOTHING].T
    assert len(x) > 100
    rear = np.median(in_ego(sweep)[sweep.body == 0, 0])
    assert rear - 9 < x.min() < rear - 5
    assert np.mean(x < rear) > 0.9  # the rest flies beside the body, between its tyres and its end
    assert x.max() < rear + 2
    assert np.abs(y).max() < 2.0
    assert -0.2 < z.min() < z.max() < 3.1
    intensity = sweep.intensity[sweep.body == NOTHING]
    assert 0 <= intensity.min() < np.median(intensity) < intensity.max() < 16


def test_spray_shadows_what_is_behind_it():
    """The lorry that throws it, and a car two lanes off whose sight line passes the plume."""
    hidden = (car(reflectivity=0.3), at(37, -2.2, 0))
    dry, wet = (sweep_of(lorry(c, speed=32.0, more=[hidden])) for c in (Condition(water_film=1.2), SPRAY))
    for body, most in ((0, 0.8), (1, 0.7)):
        counts = [np.count_nonzero(s.body == body) for s in (dry, wet)]
        assert counts[0] > 5
        assert counts[1] < most * counts[0]
    np.testing.assert_array_equal(dry.reached, wet.reached)  # a label's visibility counts bodies, not weather


def test_a_slow_lorry_and_a_dry_road_give_no_spray():
    for world in (lorry(SPRAY, speed=6.0), lorry(Condition(spray=True))):
        assert not np.any(sweep_of(world).body == NOTHING)


def sunny(azimuth=0.0, elevation=6.0, walls=()):
    return scene(
        with_ground=False,
        walls=walls,
        condition=Condition(sun_azimuth=azimuth, sun_elevation=elevation, visibility=1e9),
    )


def test_a_low_sun_ahead_is_noise_near_its_direction_alone():
    sweep = sweep_of(sunny())
    azimuth = np.degrees(np.arctan2(-sweep.points[:, 0], sweep.points[:, 1]))
    assert 5 < len(azimuth) < 0.01 * RAYS
    assert np.abs(azimuth).max() < 10.5
    assert np.ptp(np.linalg.norm(sweep.points, axis=1)) > 40
    assert np.all(sweep.body == NOTHING)
    for world in (sunny(azimuth=180.0), sunny(elevation=45.0), sunny(elevation=-5.0)):
        assert len(sweep_of(world).points) == 0


def test_a_sun_behind_a_wall_does_not_shine_into_the_sensor():
    world = sunny(walls=[wall(30.0)])
    assert not np.any(sweep_of(world).body == NOTHING)


def test_a_low_sun_costs_far_targets_before_it():
    low = box((0.5, 4.0, 4.0), at(60.0, 0, 0), 0.4)
    counts = [len(sweep_of(sunny(azimuth, walls=[low])).points) for azimuth in (180.0, 0.0)]
    beside = sweep_of(sunny(0.0, walls=[low]))
    assert np.count_nonzero(beside.body == WORLD) < 0.8 * counts[0]


def test_crosstalk_has_the_rate_of_the_rig():
    noisy = Lidar(
        model=HDL32E, translation=[0.0, 0.0, 1.8], columns=2170, sector_deg=[-35.0, 35.0], rate=10.0, crosstalk=0.01
    )
    sweep = sweep_of(scene(with_ground=False, condition=AIR), noisy)
    assert 0.006 * RAYS < len(sweep.points) < 0.01 * RAYS
    assert np.linalg.norm(sweep.points, axis=1).max() > 90


def test_clear_air_returns_the_surfaces_themselves():
    surfaces = Returns(np.arange(3), np.full(3, 9.0), np.ones(3), np.ones(3), np.zeros(3, np.int32))
    rays = Rays(np.zeros((5, 3)), np.tile([1.0, 0.0, 0.0], (5, 1)), np.zeros(5))
    rng = stream(1)
    assert with_weather(scene(), rays, surfaces, lidar=LIDAR, rng=rng) is surfaces
    assert rng.random() == stream(1).random()  # and draws nothing


def test_the_strongest_echo_of_a_ray_wins():
    def returns(ray, snr, body):
        return Returns(np.array(ray), np.array(snr) * 10.0, np.array(snr), np.array(snr), np.full(len(ray), body))

    best = strongest(5, returns([0, 2, 3], [1.0, 4.0, 2.0], 7), returns([2, 3, 4], [3.0, 5.0, 1.0], NOTHING))
    np.testing.assert_array_equal(best.ray, [0, 2, 3, 4])
    np.testing.assert_array_equal(best.body, [7, 7, NOTHING, NOTHING])
    np.testing.assert_array_equal(best.distance, [10.0, 40.0, 50.0, 10.0])


@pytest.mark.parametrize(
    "condition",
    [
        Condition(rain_rate=25.0, visibility=500.0, water_film=0.8, spray=True),
        Condition(visibility=70.0),
        Condition(sun_azimuth=0.0, sun_elevation=5.0),
    ],
    ids=["rain and spray", "fog", "glare"],
)
def test_the_same_stream_gives_the_same_weather(condition):
    world = lorry(condition)
    one = sweep_of(world)
    sweep_of(lorry(Condition(visibility=120.0)), key=3)
    two, other = sweep_of(world), sweep_of(world, key=1)
    for name in ("points", "intensity", "ring", "time", "body"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()
    assert one.points.tobytes() != other.points.tobytes()
