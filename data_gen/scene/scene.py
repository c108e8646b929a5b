"""A scene: a static world and actors on tracks, and ray queries that give every ray its own time.

Every body has an embree tree of its own, built once in its local frame. A query moves each ray into a body's frame at
that ray's time and keeps the nearest hit, so nothing is rebuilt between frames and a LiDAR's rolling sweep is exact.
It also yields, at no cost, which bodies a ray would have met had nothing stood in the way: the visibility of a label.
"""

import weakref
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import ArrayLike, NDArray

from data_gen.assets.shapes.mesh import Asset, Mesh, Scatterers, Surface
from data_gen.road.track import Track, TrackBundle
from data_gen.scene.conditions import Condition
from data_gen.scene.luminaires import luminaires
from data_gen.scene.noise import GOLDEN
from data_gen.scene.ray_kernels import finish, into_bodies, keep_nearer, passing
from data_gen.scene.wetness import Wetness
from data_gen.world.ground import GroundMap
from fusion_net.common.geometry import rotate_yaw

WORLD = -1
"""Body index of the static world; actors count from 0."""
NOTHING = -2
"""Body index of a ray that met nothing."""


STANDSTILL = 0.2
"""Speed in m/s below which somebody stands."""
_HALTED = {"vehicle.moving": "vehicle.stopped", "pedestrian.moving": "pedestrian.standing"}


@dataclass(frozen=True)
class Actor:
    """A body in the scene. ``instance`` is stable over the scene; ``attribute`` is a nuScenes attribute or "": of who takes
    part in traffic, the one that it has on its way."""

    instance: int
    asset: Asset
    track: Track
    attribute: str = ""

    def attribute_at(self, speed: float) -> str:
        """The attribute at a ``speed`` in m/s: a driver who halts has stopped and is not parked."""
        return _HALTED.get(self.attribute, self.attribute) if speed < STANDSTILL else self.attribute


@dataclass(frozen=True)
class Hits:
    """What N rays met. ``face`` indexes ``Scene.surface``; ``local`` and ``normal`` are in the body's frame and in the
    global frame. ``aimed`` and ``reached`` count, per actor, the rays that would meet it alone and those that did."""

    distance: NDArray[np.float32]  # (N,) metres, inf for none
    body: NDArray[np.int32]  # (N,) actor index, WORLD or NOTHING
    face: NDArray[np.int32]  # (N,) -1 for none
    local: NDArray[np.float32]  # (N, 3)
    normal: NDArray[np.float32]  # (N, 3) unit, turned towards the ray's origin
    aimed: NDArray[np.int64]  # (A,)
    reached: NDArray[np.int64]  # (A,)


class _Tree:
    """An embree tree over a mesh in its local frame, or one a phase of its gait."""

    def __init__(self, *phases: Mesh) -> None:
        self.phases = [EmbreeScene() for _ in phases]
        for embree, mesh in zip(self.phases, phases, strict=True):
            TriangleMesh(embree, mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))
        vertices = np.concatenate([mesh.vertices for mesh in phases])
        self.bounds = np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float32)
        self.center = self.bounds.mean(axis=0)
        self.radius = float(np.linalg.norm(vertices - self.center, axis=1).max())

    def at(self, turn: float) -> EmbreeScene:
        """The tree ``turn`` cycles of the gait after its first phase."""
        return self.phases[int(turn * len(self.phases)) % len(self.phases)]


_TREES: dict[int, _Tree] = {}


def _tree_of(asset: Asset) -> _Tree:
    """The tree of an asset, kept as long as the asset lives: several scenes may use it."""
    if id(asset) not in _TREES:
        _TREES[id(asset)] = _Tree(*(asset.gait or [asset.mesh]))
        weakref.finalize(asset, _TREES.pop, id(asset), None)
    return _TREES[id(asset)]


class Scene:
    """Static world, actors, ground map, ego path and physical condition of one episode.

    ``world`` and ``world_scatterers`` are in the global frame. The ground's material comes from ``ground``, a raster over
    x and y: a face of the world whose index is under ``ground_faces`` is ground and is looked up there.
    """

    def __init__(
        self,
        *,
        name: str,
        ego: Track,
        actors: list[Actor],
        world: Mesh,
        ground_faces: int,
        ground: GroundMap,
        world_scatterers: Scatterers,
        condition: Condition,
    ) -> None:
        self.name, self.ego, self.actors, self.condition = name, ego, actors, condition
        self.wetness = Wetness(condition.water_film)
        self.ground, self.ground_faces, self.world_scatterers = ground, ground_faces, world_scatterers
        self.luminaires = luminaires(world)
        self._world = _Tree(world)
        trees = {id(actor.asset): actor.asset for actor in actors}
        self._trees = {key: _tree_of(asset) for key, asset in trees.items()}
        spheres = [self._trees[id(actor.asset)] for actor in actors]
        self._sphere_center = np.array([tree.center for tree in spheres]).reshape(-1, 3)
        self._sphere_radius = np.array([tree.radius for tree in spheres])
        self._bounds = np.array([tree.bounds for tree in spheres], np.float32).reshape(-1, 2, 3)
        self._moving = np.array([len(a.track.times) > 1 or a.track.velocity.any() for a in actors], bool)
        self._stride = np.array([actor.asset.stride for actor in actors])
        self._first_phase = np.array([GOLDEN * actor.instance % 1.0 for actor in actors])  # nobody walks in step
        # The last track is the world's own, at rest at the origin, so that body index WORLD (-1) has a pose as well.
        self._tracks = TrackBundle([*(actor.track for actor in actors), Track.static(np.zeros(3), 0.0)])
        meshes = [world, *(asset.mesh for asset in trees.values())]
        self.surface = Surface.concatenate([mesh.surface for mesh in meshes])
        starts = np.cumsum([0, *(len(mesh.faces) for mesh in meshes[:-1])])
        self._face_start = dict(zip(trees, starts[1:].tolist(), strict=True))

    @cached_property
    def reflectors(self) -> tuple[NDArray[np.int64], Scatterers]:
        """Radar reflectors of all bodies: body index (S,), actors or WORLD, and points in the body's frame."""
        parts = [self.world_scatterers, *(actor.asset.scatterers for actor in self.actors)]
        bodies = np.arange(WORLD, len(self.actors))
        return np.repeat(bodies, [len(part.rcs) for part in parts]), Scatterers.concatenate(parts)

    def poses(self, t: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Position (A + 1, 3) and yaw (A + 1,) of all actors and, last, so that WORLD finds it, the world."""
        return self._tracks.at(t, np.arange(len(self.actors) + 1))[:2]

    def place(self, body: NDArray[np.int64], local: NDArray, t: ArrayLike) -> NDArray[np.float64]:
        """Global positions (N, 3) at times ``t`` (N,) or a scalar of points ``local`` (N, 3) fixed to bodies (N,): actors or
        WORLD."""
        position, yaw, _ = self._tracks.at(t, np.where(body == WORLD, len(self.actors), body))
        return position + rotate_yaw(local, yaw)

    def cast(self, origins: ArrayLike, directions: ArrayLike, times: ArrayLike, max_range: float = 250.0) -> Hits:
        """Nearest hits of rays with global ``origins`` (N, 3) or (3,), unit ``directions`` (N, 3), ``times`` (N,) or a
        scalar in seconds."""
        directions = np.ascontiguousarray(directions, np.float32)
        count = len(directions)
        origins = np.ascontiguousarray(np.broadcast_to(np.asarray(origins, np.float32), (count, 3)))
        found = self._world.at(0.0).run(origins, directions, query="INTERSECT", output=True)
        hit = found["tfar"] < max_range
        distance = np.where(hit, found["tfar"], np.float32(np.inf))
        body = np.where(hit, np.int32(WORLD), np.int32(NOTHING))
        face = np.where(hit, found["primID"], np.int32(-1))
        normal = found["Ng"]
        local = np.zeros((count, 3), np.float32)
        aimed = np.zeros(len(self.actors), np.int64)
        for index, tree, rays, moved_o, moved_d, cos, sin in self._towards(origins, directions, times, max_range):
            found = tree.run(moved_o, moved_d, query="INTERSECT", output=True)
            start = self._face_start[id(self.actors[index].asset)]
            aimed[index] = keep_nearer(
                rays,
                found["primID"],
                found["tfar"],
                found["Ng"],
                moved_o,
                moved_d,
                cos,
                sin,
                index,
                start,
                max_range,
                distance,
                body,
                face,
                normal,
                local,
            )
        finish(origins, directions, distance, body, normal, local)
        reached = np.bincount(body[body >= 0], minlength=len(self.actors))
        return Hits(distance, body, face, local, normal, aimed, reached)

    def occluded(
        self, origins: ArrayLike, directions: ArrayLike, times: ArrayLike, max_distance: ArrayLike = 250.0
    ) -> NDArray[np.bool_]:
        """Whether anything lies on each ray nearer than ``max_distance`` (N,) or a scalar. Arguments as in :meth:`cast`."""
        directions = np.ascontiguousarray(directions, np.float32)
        count = len(directions)
        origins = np.ascontiguousarray(np.broadcast_to(np.asarray(origins, np.float32), (count, 3)))
        limit = np.array(np.broadcast_to(max_distance, (count,)), np.float32)  # embree wants it writable
        blocked = self._world.at(0.0).run(origins, directions, limit, query="OCCLUDED") >= 0
        reach = float(limit.max(initial=0.0))
        for _, tree, rays, moved_o, moved_d, _, _ in self._towards(origins, directions, times, reach):
            blocked[rays] |= tree.run(moved_o, moved_d, limit[rays], query="OCCLUDED") >= 0
        return blocked

    def _towards(self, origins, directions, times, max_range):
        """For each actor in reach, its tree and the rays that pass near it, moved into its frame at their own times. Limbs
        are where they are in the middle of all times."""
        if not len(directions) or not self.actors:
            return
        times = np.asarray(times, float)
        middle, half_span = (times.max() + times.min()) / 2, (times.max() - times.min()) / 2
        position, yaw, velocity = self._tracks.at(middle, np.arange(len(self.actors)))
        turn = np.linalg.norm(velocity, axis=1) * middle / self._stride + self._first_phase
        slack = half_span * 1.5 * np.linalg.norm(velocity, axis=1) + (0.2 if half_span else 0.0)
        center = position + rotate_yaw(self._sphere_center, yaw)
        radius = self._sphere_radius + slack
        which, rays = passing(
            origins, directions, center.astype(np.float32), radius.astype(np.float32), np.float32(max_range)
        )
        position, cos, sin = (a.astype(np.float32) for a in (position, np.cos(yaw), np.sin(yaw)))
        each = bool(times.ndim)
        if each:  # a pose for every pair; most bodies are at rest and have one
            position, cos, sin = position[which], cos[which], sin[which]
            late = np.flatnonzero(self._moving[which])
            position[late], yaw, _ = self._tracks.at(times[rays[late]], which[late])
            cos[late], sin[late] = np.cos(yaw), np.sin(yaw)
        kept, moved_o, moved_d = into_bodies(origins, directions, rays, which, position, cos, sin, each, self._bounds)
        which, rays = which[kept], rays[kept]
        cos, sin = (cos[kept], sin[kept]) if each else (cos[which], sin[which])
        for index, (start, end) in enumerate(pairwise(np.searchsorted(which, np.arange(len(self.actors) + 1)))):
            if start < end:
                part = slice(start, end)
                tree = self._trees[id(self.actors[index].asset)].at(turn[index])
                yield index, tree, rays[part], moved_o[part], moved_d[part], cos[part], sin[part]
