"""Packets of rays against embreex, which casts them one by one."""

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from data_gen.scene.embree import Tree
from data_gen.scene.ray_kernels import blocked_by_world, meet_world


def _mesh():
    rng = np.random.default_rng(3)
    corners = rng.uniform(-20, 20, (3_000, 1, 3)) + rng.normal(size=(3_000, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(9_000, dtype=np.int32).reshape(-1, 3)


def _rays(count=1_003):
    rng = np.random.default_rng(4)
    directions = rng.normal((3.0, 0.0, 0.0), 1.0, (count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.zeros((count, 3), np.float32) + np.float32([-25, 0, 0]), directions.astype(np.float32)


def _met(tree, origins, directions, max_range):
    count = len(directions)
    distance, body, face = (
        np.full(count, np.inf, np.float32),
        np.full(count, -2, np.int32),
        np.full(count, -1, np.int32),
    )
    normal = np.zeros((count, 3), np.float32)
    meet_world(tree.handle, origins, directions, np.float32(max_range), distance, body, face, normal)
    return distance, body, face, normal


def test_packets_meet_the_same_triangles_at_the_same_distances_as_single_rays():
    vertices, faces = _mesh()
    origins, directions = _rays()
    distance, body, face, normal = _met(Tree(vertices, faces), origins, directions, 40.0)
    scene = EmbreeScene()
    TriangleMesh(scene, vertices, faces)
    one = scene.run(origins, directions, query="INTERSECT", output=True)
    hit = one["tfar"] < 40.0
    assert 0.2 < hit.mean() < 1.0
    np.testing.assert_array_equal(distance, np.where(hit, one["tfar"], np.inf))
    np.testing.assert_array_equal(face, np.where(hit, one["primID"], -1))
    np.testing.assert_array_equal(body, np.where(hit, -1, -2))
    np.testing.assert_array_equal(normal[hit], one["Ng"][hit])


def test_faces_that_coincide_are_met_at_one_distance_whichever_it_is():
    """Single rays and packets may differ in which of the two they name: nothing else may."""
    vertices, faces = _mesh()
    twice = np.concatenate([faces, faces])
    origins, directions = _rays()
    once, both = (_met(Tree(vertices, some), origins, directions, 40.0) for some in (faces, twice))
    np.testing.assert_array_equal(once[0], both[0])
    np.testing.assert_array_equal(once[2] % len(faces), both[2] % len(faces))


def test_occlusion_agrees_with_the_nearest_hit():
    vertices, faces = _mesh()
    origins, directions = _rays()
    tree = Tree(vertices, faces)
    distance = _met(tree, origins, directions, 100.0)[0]
    limit = np.random.default_rng(5).uniform(5, 60, len(directions)).astype(np.float32)
    blocked = np.zeros(len(directions), bool)
    blocked_by_world(tree.handle, origins, directions, limit, blocked)
    np.testing.assert_array_equal(blocked, distance < limit)
