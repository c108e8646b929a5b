"""Houses: whole bays on every wall, balconies off the ground, and a facade that does not change its tone with distance."""

import numpy as np
import pytest

from data_gen.assets.shapes.mesh import TEXTURES
from data_gen.sensors.camera.rendering.facades import BAY, STOREY, facade
from data_gen.world.buildings import build_houses, fitted


@pytest.fixture(scope="module")
def plots():
    rng = np.random.default_rng(3)
    yaw = rng.uniform(-3, 3, 40)
    outward = np.stack([-np.cos(yaw), -np.sin(yaw)], axis=1)
    return yaw, outward, rng.uniform(10, 90, (40, 2)), rng.uniform((8, 8, 3), (19, 13, 18), (40, 3))


def test_houses_stand_on_the_grid_of_their_facade_and_never_nearer_to_the_street(plots):
    """On each wall the texture's coordinate, (nx y - ny x), is a whole number of bays at both corners."""
    yaw, outward, front, size = plots
    moved, fit = fitted(front, outward, size)
    shift = moved - front
    assert np.abs(np.einsum("ki,ki->k", shift, outward) - BAY / 2).max() <= BAY / 2
    assert np.linalg.norm(shift, axis=1).max() < 1.5 * BAY
    np.testing.assert_allclose(fit[:, 2] % STOREY, 0.5, atol=1e-9)
    mesh, _ = build_houses(moved, yaw, fit, rng=np.random.default_rng(0))
    walls = mesh.surface.texture == TEXTURES.index("facade")
    a, b, c = mesh.vertices[mesh.faces[walls]].astype(float).transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for corner in (a, b, c):
        bays = (normal[:, 0] * corner[:, 1] - normal[:, 1] * corner[:, 0]) / BAY
        np.testing.assert_allclose(bays, np.rint(bays), atol=1e-3)


def test_walls_look_outwards_and_nothing_hangs_below_the_first_floor(plots):
    yaw, outward, front, _ = plots
    moved, fit = fitted(front[:1], outward[:1], np.array([[14.0, 9.0, 13.0]]))
    for seed in range(12):
        mesh, echoes = build_houses(moved, yaw[:1], fit, rng=np.random.default_rng(seed))
        a, b, c = mesh.vertices[mesh.faces].astype(float).transpose(1, 0, 2)
        normal, middle = np.cross(b - a, c - a), (a + b + c) / 3
        walls = mesh.surface.texture == TEXTURES.index("facade")
        inside = moved[0] + fit[0, 1] / 2 * outward[0]
        assert (np.einsum("fi,fi->f", normal[walls, :2], middle[walls, :2] - inside) > 0).all()
        before = mesh.vertices[(mesh.vertices[:, :2] - moved[0]) @ -outward[0] > 0.6]  # towards the street
        assert before[:, 2].min(initial=9.0) >= STOREY - 0.2
        assert echoes.position[:, 2].max() <= fit[0, 2]


@pytest.mark.parametrize("rgb", [(0.45, 0.40, 0.33), (0.55, 0.371, 0.32), (0.284, 0.12, 0.09), (0.61, 0.56, 0.4)])
def test_a_facade_far_away_is_the_mean_of_what_it_is_close_up(rgb):
    """The filter is exact: one sample with a footprint of a house's size is close to the mean of many fine ones."""
    rgb = np.array(rgb, np.float32)

    def colour(u, v, footprint):
        out = np.array([*rgb, 0, 0], np.float32)
        facade(u, v, footprint, rgb, out, False)
        return out[:3]

    grid = np.meshgrid(np.arange(0.05, 12 * BAY, 0.1), np.arange(STOREY + 0.05, 3 * STOREY, 0.1))
    near = np.mean([colour(u, v, 0.02) for u, v in zip(*(part.ravel() for part in grid), strict=True)], axis=0)
    far = np.mean([colour((k + 0.5) * BAY, 2 * STOREY, 2 * STOREY) for k in range(12)], axis=0)
    np.testing.assert_allclose(far, near, rtol=0.2)
