"""A scene: a static world and actors on tracks, and ray queries that give every ray its own time.

Every body has an embree tree of its own, built once in its local frame. A query moves each ray into a body's frame at
that ray's time and keeps the nearest hit, so nothing is rebuilt between frames and a LiDAR's rolling sweep is exact.
It also yields, where asked to, which bodies a ray would have met had nothing stood in the way: the visibility of a label.
"""

import copy
import weakref
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_gen.assets.shapes.mesh import Asset, Mesh, Scatterers, Surface
from data_gen.road.track import Track, TrackBundle
from data_gen.scene.conditions import Condition
from data_gen.scene.embree import Tree
from data_gen.scene.luminaires import luminaires
from data_gen.scene.noise import GOLDEN
from data_gen.scene.ray_cones import passing
from data_gen.scene.ray_kernels import blocked_by_bodies, blocked_by_world, finish, meet_bodies, meet_world
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


class _Body:
    """An embree tree over a mesh in its local frame, or one a phase of its gait."""

    def __init__(self, *phases: Mesh) -> None:
        self._phases = [Tree(mesh.vertices, mesh.faces) for mesh in phases]
        vertices = np.concatenate([mesh.vertices for mesh in phases])
        self.bounds = np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float32)
        self.center = self.bounds.mean(axis=0)
        self.radius = float(np.linalg.norm(vertices - self.center, axis=1).max())

    def handle(self, turn: float = 0.0) -> int:
        """Of the tree ``turn`` cycles of the gait after its first phase."""
        return self._phases[int(turn * len(self._phases)) % len(self._phases)].handle


_TREES: dict[int, _Body] = {}


def kernel_rays(origins: ArrayLike, directions: ArrayLike) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """``origins`` (N, 3) or (3,) and ``directions`` (N, 3) as the loops take them, each (N, 3). Both can be written to: what
    cannot is of another type to numba, which would compile everything once more for it."""
    directions = np.require(directions, np.float32, ("C", "W"))
    return np.array(np.broadcast_to(origins, directions.shape), np.float32, order="C"), directions


def _tree_of(asset: Asset) -> _Body:
    """The tree of an asset, kept as long as the asset lives: several scenes may use it."""
    if id(asset) not in _TREES:
        _TREES[id(asset)] = _Body(*(asset.gait or [asset.mesh]))
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
        self._world = _Body(world)
        trees = {id(actor.asset): actor.asset for actor in actors}
        self._bodies = spheres = [_tree_of(actor.asset) for actor in actors]
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
        first = dict(zip(trees, starts[1:].tolist(), strict=True))
        self._starts = np.array([first[id(actor.asset)] for actor in actors], np.int64)

    def under(self, condition: Condition) -> "Scene":
        """The same scene in other weather and light; who is there stays, and all that costs time is shared."""
        other = copy.copy(self)
        other.condition, other.wetness = condition, Wetness(condition.water_film)
        return other

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

    def cast(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        times: ArrayLike,
        max_range: float = 250.0,
        *,
        counted: bool = True,
        middle: float | None = None,
    ) -> Hits:
        """Nearest hits of rays with global ``origins`` (N, 3) or (3,), unit ``directions`` (N, 3), ``times`` (N,) or a
        scalar in seconds. Rays that follow each other are cast together: the more alike they are, the faster. Whose ``aimed``
        nobody wants is cast faster without: it is then too low. Limbs are where they are at the time ``middle``, or in the
        middle of ``times``."""
        origins, directions = kernel_rays(origins, directions)
        count = len(directions)
        distance = np.full(count, np.inf, np.float32)
        body, face = np.full(count, NOTHING, np.int32), np.full(count, -1, np.int32)
        normal, local = np.zeros((2, count, 3), np.float32)
        far = np.float32(max_range)
        meet_world(self._world.handle(), origins, directions, far, distance, body, face, normal)
        aimed = np.zeros(len(self.actors), np.int64)
        if count and self.actors:
            trees, *pairs = self._towards(origins, directions, times, max_range, middle)
            aimed = meet_bodies(
                trees, self._starts, origins, directions, *pairs, self._bounds, far, counted, distance, body, face, normal,
                local,
            )  # fmt: skip
        finish(origins, directions, distance, body, normal, local)
        reached = np.bincount(body[body >= 0], minlength=len(self.actors))
        return Hits(distance, body, face, local, normal, aimed, reached)

    def occluded(
        self, origins: ArrayLike, directions: ArrayLike, times: ArrayLike, max_distance: ArrayLike = 250.0
    ) -> NDArray[np.bool_]:
        """Whether anything lies on each ray nearer than ``max_distance`` (N,) or a scalar. Arguments as in :meth:`cast`."""
        origins, directions = kernel_rays(origins, directions)
        count = len(directions)
        limit = np.array(np.broadcast_to(max_distance, (count,)), np.float32)
        blocked = np.zeros(count, bool)
        blocked_by_world(self._world.handle(), origins, directions, limit, blocked)
        if count and self.actors:
            trees, *pairs = self._towards(origins, directions, times, float(limit.max()))
            blocked_by_bodies(trees, origins, directions, limit, *pairs, self._bounds, blocked)
        return blocked

    def _towards(self, origins, directions, times, max_range, middle=None):
        """The tree of each actor (A,); pairs of an actor and a ray that passes near it, and each pair's pose at the ray's own
        time; and the poses: position, cosine and sine of the yaw. Limbs are where they are at the time ``middle``, or in
        the middle of all times."""
        times = np.asarray(times, float)
        middle = (times.max() + times.min()) / 2 if middle is None else middle
        half_span = max(times.max() - middle, middle - times.min())
        position, yaw, velocity = self._tracks.at(middle, np.arange(len(self.actors)))
        speed = np.linalg.norm(velocity, axis=1)
        turn = speed * middle / self._stride + self._first_phase
        trees = np.array([tree.handle(phase) for tree, phase in zip(self._bodies, turn.tolist(), strict=True)])
        slack = half_span * 1.5 * speed + (0.2 if half_span else 0.0)
        center = position + rotate_yaw(self._sphere_center, yaw)
        radius = self._sphere_radius + slack
        which, rays = passing(
            origins, directions, center.astype(np.float32), radius.astype(np.float32), np.float32(max_range)
        )
        pose = which
        if times.ndim and len(late := np.flatnonzero(self._moving[which])):  # most bodies are at rest and have one pose
            pose = which.copy()
            pose[late] = len(position) + np.arange(len(late))
            there, heading, _ = self._tracks.at(times[rays[late]], which[late])
            position, yaw = np.concatenate([position, there]), np.concatenate([yaw, heading])
        return trees, which, rays, pose, *(a.astype(np.float32) for a in (position, np.cos(yaw), np.sin(yaw)))
