"""Ray queries: per-ray times, moving and rotated bodies, occlusion, visibility counts."""

import gc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_gen.assets.catalogue import VARIANT_NAMES, build_asset
from data_gen.assets.shapes.mesh import Asset, Mesh, Surface
from data_gen.road.track import Track
from data_gen.scene.scene import _TREES, NOTHING, WORLD
from tests.fixtures.box_world import ORIGIN, box, car, path, scene


def at(x: float, y: float, z: float) -> np.ndarray:
    """A place (3,) seen from the middle of the scene."""
    return ORIGIN + np.array([x, y, z])


EYE = at(0.0, 0.0, 0.8)
AHEAD = np.array([[1.0, 0.0, 0.0]])


def fan(count: int, spread: float = 0.6, seed: int = 0) -> np.ndarray:
    """Unit directions about +x."""
    d = np.random.default_rng(seed).uniform(-spread, spread, (count, 3)) + AHEAD
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def crowd(seed: int = 3, count: int = 25) -> list:
    """Cars of three sizes in motion all around, not level in speed or heading."""
    rng = np.random.default_rng(seed)
    assets = [car(size=size) for size in ((4.5, 1.9, 1.5), (9.0, 2.5, 3.4), (0.6, 0.7, 1.7))]
    return [
        (
            assets[i % 3],
            path(at(*rng.uniform(-60, 60, 2), 0), [*rng.uniform(-15, 15, 2), 0.0], rng.uniform(-3, 3), 0.3),
        )
        for i in range(count)
    ]


def test_each_ray_sees_the_body_at_its_own_time():
    """A car receding at 20 m/s is hit a metre further away after 50 ms, in the same call."""
    world = scene(actors=[(car(), path(at(20, 0, 0), (20, 0, 0)))])
    hits = world.cast(EYE, np.repeat(AHEAD, 3, axis=0), np.array([0.0, 0.05, -0.1]))
    np.testing.assert_allclose(hits.distance, 20 - 2.25 + np.array([0.0, 1.0, -2.0]), atol=1e-4)
    np.testing.assert_array_equal(hits.body, 0)
    np.testing.assert_allclose(hits.local[:, 0], -2.25, atol=1e-4)


def test_oncoming_body_near_the_end_of_a_long_sweep_is_not_culled():
    """Times half a second apart: the body crosses the ray only at one of them."""
    world = scene(actors=[(car(), path(at(25, -8, 0), (0, 32, 0), np.pi / 2))])
    hits = world.cast(EYE, np.repeat(AHEAD, 2, axis=0), np.array([0.0, 0.25]), max_range=60.0)
    assert hits.body.tolist() == [NOTHING, 0]


def test_scalar_time_equals_equal_times():
    world, rays = scene(actors=crowd()), fan(3000)
    a, b = world.cast(EYE, rays, 0.3), world.cast(EYE, rays, np.full(3000, 0.3))
    np.testing.assert_array_equal(a.body, b.body)
    np.testing.assert_allclose(a.distance, b.distance, rtol=1e-5)
    np.testing.assert_array_equal(a.aimed, b.aimed)


def test_all_at_once_equals_one_by_one():
    """Culling may drop nothing: each ray alone, at its time, meets the same as among others."""
    rng = np.random.default_rng(1)
    world, rays = scene(actors=crowd()), fan(200, 2.0)
    times, origins = rng.uniform(0, 0.1, 200), EYE + rng.normal(0, 5, (200, 3)) * [1, 1, 0]
    together = world.cast(origins, rays, times)
    alone = [world.cast(origins[i], rays[i : i + 1], times[i : i + 1]) for i in range(200)]
    assert (together.body >= 0).sum() > 20
    np.testing.assert_array_equal(together.body, [hit.body[0] for hit in alone])
    np.testing.assert_allclose(together.distance, [hit.distance[0] for hit in alone], atol=1e-3)
    np.testing.assert_array_equal(together.face, [hit.face[0] for hit in alone])


def test_normals_are_unit_and_face_the_origin_of_the_ray():
    world, rays = scene(actors=crowd(), walls=[box((1, 60, 8), at(55, 0, 4))]), fan(4000)
    hits = world.cast(EYE, rays, 0.1)
    met = hits.body != NOTHING
    np.testing.assert_allclose(np.linalg.norm(hits.normal[met], axis=1), 1.0, atol=1e-5)
    assert (np.einsum("ij,ij->i", hits.normal[met], rays[met]) <= 1e-6).all()


def test_normal_is_global_and_local_is_the_bodys():
    """A car turned by 90 degrees: its right side looks at us along -x global, local y is -width / 2 there."""
    world = scene(actors=[(car(), Track.static(at(10, 0.3, 0), -np.pi / 2))])
    hits = world.cast(EYE, AHEAD, 0.0)
    np.testing.assert_allclose(hits.normal[0], [-1, 0, 0], atol=1e-5)
    np.testing.assert_allclose(hits.local[0], [0.3, -0.95, 0.8], atol=1e-4)
    assert hits.distance[0] == pytest.approx(10 - 0.95, abs=1e-4)


@settings(max_examples=25)
@given(yaw=st.floats(-3.1, 3.1), x=st.floats(6, 60), y=st.floats(-3, 3), t=st.floats(-0.5, 0.5))
def test_local_point_placed_back_is_the_point_on_the_ray(yaw, x, y, t):
    world = scene(actors=[(car(), path(at(x, y, 0), (3, -1, 0), yaw, 0.2))])
    rays = fan(300, 0.2)
    hits = world.cast(EYE, rays, t)
    met = hits.body != NOTHING
    np.testing.assert_allclose(
        world.place(hits.body[met], hits.local[met], t), EYE + rays[met] * hits.distance[met, None], atol=2e-3
    )


def test_face_indexes_the_surface_of_what_was_hit():
    dark, bright = car(reflectivity=0.1), car(reflectivity=0.7)
    world = scene(actors=[(dark, Track.static(at(10, 0, 0), 0)), (bright, Track.static(at(0, 10, 0), 0)),
                          (dark, Track.static(at(-10, 0, 0), 0))])  # fmt: skip
    hits = world.cast(EYE, np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, -1]]), 0.0)
    assert hits.body.tolist() == [0, 1, 2, WORLD]
    np.testing.assert_allclose(world.surface.reflectivity[hits.face], [0.1, 0.7, 0.1, 0.99])


def test_occluded_agrees_with_cast():
    world, rays = scene(actors=crowd(), walls=[box((1, 30, 8), at(50, 5, 4))]), fan(4000)
    times = np.random.default_rng(2).uniform(0, 0.1, 4000)
    hits = world.cast(EYE, rays, times)
    np.testing.assert_array_equal(world.occluded(EYE, rays, times), hits.body != NOTHING)
    near = np.random.default_rng(4).uniform(1, 80, 4000)
    sure = np.abs(hits.distance - near) > 1e-3
    np.testing.assert_array_equal(world.occluded(EYE, rays, times, near)[sure], (hits.distance < near)[sure])


def test_parallel_rays_from_everywhere_cast_shadows_of_bodies_beside_and_behind_their_middle():
    """Sun rays share a direction; their origins lie all around. One body stands where the mean origin does not look."""
    body = car(size=(4.0, 4.0, 6.0))
    sun = np.array([0.8, 0.0, 0.6])
    for place in ([-40, 0, 0], [40, 0, 0], [0, 40, 0], [0, -40, 0]):
        world = scene(actors=[(body, Track.static(at(*place), 0.0))])
        x, y = np.meshgrid(np.arange(-55, 56, 5.0), np.arange(-55, 56, 5.0))
        feet = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.05)], axis=1) + ORIGIN
        blocked = world.occluded(feet, np.tile(sun, (len(feet), 1)), 0.0)
        shaded = feet[blocked] - ORIGIN - place
        assert len(shaded) > 0, place
        assert (np.abs(shaded[:, 1]) <= 2.0).all()
        assert (shaded[:, 0] < 2.0).all()
        alone = [world.occluded(foot, sun[None], 0.0)[0] for foot in feet]
        np.testing.assert_array_equal(blocked, alone)


def test_body_behind_a_wall_is_aimed_at_but_not_reached():
    hidden, open_ = Track.static(at(30, 0, 0), 0), Track.static(at(30, 9, 0), 0)
    world = scene(actors=[(car(), hidden), (car(), open_)], walls=[box((0.5, 6, 5), at(15, 0, 2.5))])
    hits = world.cast(EYE, fan(20_000), 0.0)
    assert hits.aimed[0] > 30
    assert hits.reached[0] == 0
    assert hits.reached[1] == hits.aimed[1] > 30
    np.testing.assert_array_equal(hits.reached, [(hits.body == 0).sum(), (hits.body == 1).sum()])


def test_half_hidden_body_is_reached_by_half():
    world = scene(
        actors=[(car(), Track.static(at(30, 0, 0), 0))],
        walls=[box((0.1, 6, 5), at(20, 3, 2.5))],
        with_ground=False,
    )
    hits = world.cast(EYE, fan(200_000, 0.08), 0.0)
    assert hits.reached[0] / hits.aimed[0] == pytest.approx(0.5, abs=0.03)


def test_beyond_the_range_nothing_is_hit_nor_aimed_at():
    world = scene(actors=[(car(), Track.static(at(30, 0, 0), 0))])
    hits = world.cast(EYE, AHEAD, 0.0, max_range=27.7)
    assert (hits.body[0], hits.face[0], hits.aimed[0]) == (NOTHING, -1, 0)
    assert np.isinf(hits.distance[0])
    assert world.cast(EYE, AHEAD, 0.0, max_range=27.8).body[0] == 0


@pytest.mark.parametrize("times", [0.0, np.zeros(0)])
def test_no_rays(times):
    world = scene(actors=crowd())
    hits = world.cast(EYE, np.zeros((0, 3)), times)
    assert len(hits.distance) == 0
    assert hits.aimed.tolist() == [0] * 25
    assert world.occluded(EYE, np.zeros((0, 3)), times).shape == (0,)


def test_no_actors_and_sky():
    world = scene()
    hits = world.cast(EYE, np.array([[0.0, 0.0, 1.0], [0.6, 0.0, -0.8]]), 0.0)
    assert hits.body.tolist() == [NOTHING, WORLD]
    assert np.isinf(hits.distance[0])
    assert hits.distance[1] == pytest.approx(1.0, rel=1e-5)
    np.testing.assert_allclose(hits.local[1], at(0.6, 0, 0), atol=1e-4)
    assert hits.aimed.shape == hits.reached.shape == (0,)


def test_body_with_its_origin_off_its_middle_is_found_when_turned():
    """The bounding volume turns with the body: a mast 6 m ahead of its origin."""
    mast = box((0.4, 0.4, 5.0), (6.0, 0.0, 2.5))
    asset = Asset(
        "mast", "", (1, 1, 5), Mesh(mast.vertices, mast.faces, Surface.uniform(12, (1, 1, 1), 0.5)), car().scatterers
    )
    world = scene(actors=[(asset, Track.static(at(20, -6, 0), np.pi / 2))])
    hits = world.cast(EYE, AHEAD, 0.0)
    assert hits.body[0] == 0
    assert hits.distance[0] == pytest.approx(19.8, abs=1e-3)


def test_ray_that_starts_inside_the_bounding_sphere():
    world = scene(actors=[(car(size=(18.0, 2.5, 3.5)), Track.static(ORIGIN, 0.0))])
    side = at(5.0, 2.0, 1.0)
    for direction, body in (([0.0, -1.0, 0.0], 0), ([0.0, 1.0, 0.0], NOTHING)):
        assert world.cast(side, np.array([direction]), 0.0).body[0] == body


def test_a_walker_is_met_in_the_pose_of_the_time():
    """The shape repeats after a stride and differs half a stride on; a body without a gait keeps its shape."""
    walker = build_asset("pedestrian", VARIANT_NAMES["pedestrian"].index("man walking"))
    pace = np.array([[1.5, 0.0, 0.0]])
    world = scene(actors=[(walker, Track(np.zeros(1), at(12.0, 0, 0)[None], np.zeros(1), pace))])
    z = np.linspace(0.05, 1.8, 60)

    def profile(t):
        x, y = np.linspace(-0.5, 0.5, 41), 3.0
        columns = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
        origins = at(12.0 + 1.5 * t, y, 0) + np.stack([columns[:, 0], 0 * columns[:, 0], columns[:, 1]], axis=1)
        return world.cast(origins, np.tile([0.0, -1.0, 0.0], (len(origins), 1)), t).body == 0

    cycle = walker.stride / 1.5
    seen = [profile(t) for t in (0.02, 0.02 + cycle, 0.02 + cycle / 4)]
    assert (seen[0] != seen[1]).mean() < 0.002
    assert (seen[0] != seen[2]).mean() > 0.02
    assert seen[0].sum() > 100


def test_tree_of_an_asset_is_shared_and_goes_with_it():
    asset = car()
    scenes = [scene(actors=[(asset, Track.static(at(10.0 + i, 0, 0), 0.0))]) for i in range(2)]
    assert [s.cast(EYE, AHEAD, 0.0).distance[0] for s in scenes] == pytest.approx([7.75, 8.75])
    key = id(asset)
    assert key in _TREES
    del asset, scenes
    gc.collect()
    assert key not in _TREES
