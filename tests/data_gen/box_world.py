"""Small scenes of boxes for the sensor tests: a flat ground of one material, walls and cars whose places are known."""

import numpy as np
import trimesh

from data_gen.conditions import Condition
from data_gen.ground import GROUND_NAMES, GroundMap
from data_gen.mesh import Asset, Mesh, Scatterers, Surface
from data_gen.scene import Actor, Scene
from data_gen.track import Track

NO_SCATTERERS = Scatterers(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
ORIGIN = np.array([200.0, 130.0, 0.0])
"""Where the ego stands at t = 0, unless it is told otherwise."""


def at(x, y, z):
    """The global point (3,) that lies (x, y, z) m from ``ORIGIN``."""
    return np.add(ORIGIN, (x, y, z))


def box(size, center, reflectivity=0.5) -> Mesh:
    """A box of ``size`` (3,) about ``center`` (3,)."""
    mesh = trimesh.creation.box(size)
    surface = Surface.uniform(len(mesh.faces), (0.5, 0.5, 0.5), reflectivity)
    return Mesh((mesh.vertices + center).astype(np.float32), mesh.faces.astype(np.int32), surface)


def reflectors(position, rcs, normal=(0.0, 0.0, 0.0)) -> Scatterers:
    """Reflectors at ``position`` (S, 3) of ``rcs`` dBsm each."""
    position = np.atleast_2d(np.asarray(position, np.float32))
    normal = np.broadcast_to(np.asarray(normal, np.float32), position.shape)
    return Scatterers(position, normal, np.broadcast_to(np.float32(rcs), len(position)))


def car(scatterers: Scatterers = NO_SCATTERERS, size=(4.5, 1.9, 1.5), reflectivity=0.5) -> Asset:
    """A box on the ground."""
    return Asset("car", "vehicle.car", size, box(size, (0, 0, size[2] / 2), reflectivity), scatterers)


def path(start, velocity=(0.0, 0.0, 0.0), yaw=0.0, yaw_rate=0.0) -> Track:
    """Straight motion from ``start`` at t = 0, or, with a yaw rate, a turn of constant speed."""
    times = np.linspace(-1, 3, 401)
    angle = yaw_rate * times
    c, s = np.cos(angle), np.sin(angle)
    v = np.asarray(velocity, float)
    velocities = np.stack([c * v[0] - s * v[1], s * v[0] + c * v[1], np.full_like(c, v[2])], axis=1)
    if yaw_rate:
        turned = np.stack([s * v[0] + (c - 1) * v[1], (1 - c) * v[0] + s * v[1], 0 * c], axis=1) / yaw_rate
    else:
        turned = times[:, None] * v
    return Track(times, np.asarray(start, float) + turned, yaw + angle, velocities)


def scene(
    *, actors=(), walls=(), ego=None, scatterers=NO_SCATTERERS, condition=None, ground="asphalt", with_ground=True
) -> Scene:
    """A scene of ``actors`` (asset, track) and ``walls`` (meshes in the global frame)."""
    corners = np.array([[0, 0, 0], [500, 0, 0], [500, 300, 0], [0, 300, 0]], np.float32)
    if not with_ground:
        corners += np.float32([0, 0, -1000])
    plane = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Surface.uniform(2, (0.1, 0.1, 0.1), 0.99))
    material = np.full((30, 50), GROUND_NAMES.index(ground), np.uint8)
    return Scene(
        name="boxes",
        ego=ego or path(ORIGIN),
        actors=[Actor(index, asset, track) for index, (asset, track) in enumerate(actors)],
        world=Mesh.concatenate([plane, *walls]),
        ground_faces=2,
        ground=GroundMap(material, (0.0, 0.0), 10.0),
        world_scatterers=scatterers,
        condition=condition or Condition(),
    )
