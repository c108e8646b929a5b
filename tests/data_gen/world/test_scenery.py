"""The static world: what stands where, on every layout."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from data_gen.road.layout import LAYOUTS, Lane, Layout, record_layout
from data_gen.road.track import Track
from data_gen.scene.conditions import Condition
from data_gen.scene.scene import WORLD, Scene
from data_gen.world.ground import GROUND_NAMES
from data_gen.world.paint import KERB, SHOULDER, URBAN, VERGE, paint_ground
from data_gen.world.roadside import KERB_HEIGHT, kerb_mesh, trace_verges
from data_gen.world.scenery import BEYOND, REACH, build_world
from fusion_net.common.random import stream
from tests.fixtures.scenarios import MIXED


def straight_road(name="two_way", y=45.0) -> Layout:
    x = np.linspace(0.0, 260.0, 175)
    ahead = Lane(np.stack([x, np.full(175, y)], axis=1), np.full(175, 4.0), "striped", "continuous", 14.0, False)
    back = Lane(
        np.stack([x[::-1], np.full(175, y + 4.0)], axis=1), np.full(175, 4.0), "none", "continuous", 14.0, False
    )
    ego = Track(
        np.array([0.0, 4.0]), np.array([[100.0, y, 0], [156.0, y, 0]]), np.zeros(2), np.array([[14.0, 0, 0]] * 2)
    )
    return Layout(name, [ahead, back], ego, [], (260.0, 110.0))


@pytest.fixture(scope="module", params=LAYOUTS)
def built(request):
    layout = record_layout(request.param, seed=21, duration=3.0, traffic=MIXED.traffic)
    return layout, build_world(layout, seed=21)


def test_budget_and_bounds(built):
    layout, world = built
    mesh = world.mesh
    assert len(mesh.faces) <= 30_000  # their tree takes about 10 ms, once a scene
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)
    assert len(mesh.surface.albedo) == len(mesh.surface.texture) == len(mesh.faces)
    props = mesh.vertices[np.unique(mesh.faces[world.ground_faces :])]
    assert cKDTree(layout.ego.position[:, :2]).query(props[:, :2])[0].max() < REACH + 25.0
    assert props[:, 2].max() < 30.0
    assert props[:, 2].min() > -0.2


def test_ground_faces_come_first_and_reach_far(built):
    layout, world = built
    ground = world.mesh.vertices[np.unique(world.mesh.faces[: world.ground_faces])]
    np.testing.assert_allclose(ground[:, :2].min(axis=0), -BEYOND)
    np.testing.assert_allclose(ground[:, :2].max(axis=0), np.array(layout.extent) + BEYOND, rtol=1e-6)
    assert ground[:, 2].max() == pytest.approx(KERB_HEIGHT if layout.name in URBAN else 0.0)
    assert ground[:, 2].min() == 0.0


def test_nothing_stands_on_a_lane(built):
    """Nothing below the height of a truck is within a lane, whatever may hang above."""
    layout, world = built
    low = world.mesh.vertices[np.unique(world.mesh.faces[world.ground_faces :])]
    low = low[low[:, 2] < 4.2]
    for lane in layout.lanes:
        distance = cKDTree(lane.centre).query(low[:, :2])[0]
        assert distance.min(initial=np.inf) > lane.width.mean() / 2 - 0.05


@pytest.mark.parametrize(
    ("name", "seed"), [("highway", 104), ("exit", 102), ("merge", 101), ("exit", 7), ("highway", 8)]
)
def test_gantries_keep_their_feet_off_the_lanes(name, seed):
    layout = record_layout(name, seed=seed, duration=2.0, traffic=MIXED.traffic)
    test_nothing_stands_on_a_lane((layout, build_world(layout, seed=seed)))


def test_the_middle_of_pavements_is_free(built):
    layout, world = built
    if layout.name not in URBAN:
        pytest.skip("no pavement")
    walk = np.concatenate([verge.points + VERGE / 2 * verge.outward for verge in trace_verges(world.ground)])
    props = world.mesh.vertices[np.unique(world.mesh.faces[world.ground_faces :])]
    props = props[props[:, 2] < 2.2]
    assert (cKDTree(props[:, :2]).query(walk)[0] > 0.25).all()


def test_ego_sees_ahead(built):
    """Along its own future path nothing of the static world stands in the way."""
    layout, world = built
    scene = _scene(layout, world)
    start, end = layout.ego.at(0.0)[0], layout.ego.at(2.0)[0]
    distance = np.linalg.norm(end - start)
    if distance < 3 or abs(layout.ego.at(2.0)[1] - layout.ego.at(0.0)[1]) > 0.1:
        pytest.skip("stands or turns")
    hits = scene.cast(start + np.array([0, 0, 1.5]), ((end - start) / distance)[None], 0.0, max_range=float(distance))
    assert hits.body[0] != WORLD


def test_scatterers_are_outside_the_lanes_and_normals_unit_or_zero(built):
    layout, world = built
    points = world.scatterers
    assert len(points.rcs) == len(points.position) == len(points.normal) > 20
    length = np.linalg.norm(points.normal, axis=1)
    assert np.all((length < 1e-6) | (np.abs(length - 1) < 1e-4))
    assert points.rcs.min() > -25
    assert points.rcs.max() < 30
    low = points.position[points.position[:, 2] < 4]
    for lane in layout.lanes:
        assert cKDTree(lane.centre).query(low[:, :2])[0].min() > lane.width.mean() / 2 - 0.1


def test_same_seed_same_world_other_seed_other_world():
    layout = straight_road()
    a, b, c = (build_world(layout, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a.mesh.vertices, b.mesh.vertices)
    np.testing.assert_array_equal(a.scatterers.rcs, b.scatterers.rcs)
    np.testing.assert_array_equal(a.ground.material, b.ground.material)
    assert len(a.mesh.vertices) != len(c.mesh.vertices) or (a.mesh.vertices != c.mesh.vertices).any()


def test_kerb_stands_where_kerb_is_painted_and_faces_outwards():
    """The raised kerb of a straight road: seen from above its top is 12 cm up and looks up "kerb" in the raster."""
    layout = straight_road()
    world = build_world(layout, seed=4)
    scene = _scene(layout, world)
    y = 45.0 - 2.0 - SHOULDER - 0.1
    xs = np.arange(20.0, 240.0, 7.3)
    hits = scene.cast(
        np.stack([xs, np.full_like(xs, y), np.full_like(xs, 1.0)], axis=1), np.tile([0.0, 0, -1], (len(xs), 1)), 0.0
    )
    np.testing.assert_allclose(hits.distance, 1.0 - KERB_HEIGHT, atol=1e-4)
    assert (hits.face < world.ground_faces).all()
    assert {GROUND_NAMES[i] for i in world.ground.at(hits.local)} == {"kerb"}
    kerb = kerb_mesh(trace_verges(world.ground), width=KERB)
    a, b, c = kerb.vertices[kerb.faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    top = np.abs(normal[:, 2]) > np.hypot(normal[:, 0], normal[:, 1])
    assert (normal[top, 2] > 0).all()
    right = (a[:, 1] < 45.0) & ~top
    front = right & (a[:, 1] > y)
    assert (normal[front, 1] > 0).mean() > 0.95  # towards the road
    assert (normal[right & (a[:, 1] < y), 1] < 0).mean() > 0.95


@pytest.mark.parametrize("name", ["two_way", "highway"])
def test_verges_run_along_the_carriageway_with_normals_away(name):
    layout = straight_road(name)
    verges = trace_verges(paint_ground(layout, rng=stream(0, "t")))
    assert len(verges) == 2
    strip = SHOULDER if name in URBAN else VERGE
    for verge in verges:
        side = np.sign(verge.points[0, 1] - 47.0)
        np.testing.assert_allclose(verge.points[:, 1], 47.0 + side * (4.0 + strip), atol=0.2)
        np.testing.assert_allclose(verge.outward, np.tile([0, side], (len(verge.points), 1)), atol=0.1)
        np.testing.assert_allclose(np.linalg.norm(np.diff(verge.points, axis=0), axis=1), 1.0, atol=0.1)


def test_guard_rails_line_the_highway_on_both_sides():
    layout = straight_road("highway")
    world = build_world(layout, seed=9)
    points = world.scatterers.position
    for side in (-1, 1):
        y = 47.0 + side * (4.0 + VERGE + 0.6)
        rail = points[(np.abs(points[:, 1] - y) < 0.4) & (points[:, 2] < 1.0)]
        near = rail[np.abs(rail[:, 0] - 128.0) < 50]
        assert np.diff(np.sort(near[:, 0])).max() < 1.5


def _scene(layout, world) -> Scene:
    return Scene(
        name="t", ego=layout.ego, actors=[], world=world.mesh, ground_faces=world.ground_faces, ground=world.ground,
        world_scatterers=world.scatterers, condition=Condition(),
    )  # fmt: skip
