"""The static world of a layout: ground, kerbs, houses, trees, lamps, guard rails, and their radar reflections."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data_gen.assets import VARIANT_NAMES, VARIANTS, build_asset
from data_gen.buildings import build_houses
from data_gen.ground import GroundMap
from data_gen.layout import Layout
from data_gen.mesh import Mesh, Scatterers, Surface
from data_gen.props import Props
from data_gen.random import stream
from data_gen.road_paint import KERB, URBAN, VERGE, Crossing, crossings, paint_ground
from data_gen.roadside import Verge, carriageway, kerb_mesh, trace_verges

Array = NDArray[np.float64]

REACH = 110.0
"""Nothing stands further than this from the ego's path, in metres."""
BEYOND = 400.0
"""The ground goes on for this far beyond the layout, in metres."""
_COARSE = 5  # pixels of the ground raster a cell of the clearance map


@dataclass(frozen=True)
class World:
    """The static world in the global frame. The first ``ground_faces`` faces take their material from ``ground``."""

    mesh: Mesh
    ground_faces: int
    ground: GroundMap
    scatterers: Scatterers


@dataclass(frozen=True)
class Planting:
    """A kind of prop along the verges: every ``spacing`` metres, ``setback`` metres off the road (a range), each with
    probability ``share``; it needs ``room`` metres free of road around it and wanders by ``jitter`` metres (1 sigma)."""

    kind: str
    spacing: float
    setback: tuple[float, float]
    share: float = 1.0
    room: float = 0.4
    jitter: float = 0.0


# Setbacks count from the carriageway's edge: on urban roads the kerb's face, then 2.5 m of pavement; elsewhere the outer
# edge of the hard shoulder. The middle of the pavement (1.25 m) stays free for those who walk.
_URBAN = (
    Planting("street_lamp", 27.0, (0.55, 0.6)),
    Planting("sign_post", 23.0, (0.5, 0.6), 0.5),
    Planting("pole", 34.0, (2.3, 2.4), 0.4),
    Planting("bench", 31.0, (2.1, 2.2), 0.3, 1.5),
    Planting("tree", 11.0, (5.5, 7.0), 0.5, 4.5, 0.3),
    Planting("bush", 6.0, (3.4, 4.6), 0.35, 2.6, 0.3),
    Planting("billboard", 70.0, (6.0, 9.0), 0.5, 5.0),
    Planting("tree", 9.0, (24.0, 42.0), 0.5, 20.0, 4.0),
)
_RURAL = (
    Planting("guard_rail", 4.0, (0.6, 0.6), room=0.3),
    Planting("street_lamp", 38.0, (1.3, 1.4), 0.35, 0.8),
    Planting("sign_post", 45.0, (1.4, 2.2), 0.6, 1.0),
    Planting("pole", 48.0, (5.0, 6.5), 0.4, 3.0),
    Planting("bush", 7.0, (4.0, 11.0), 0.5, 3.0, 1.0),
    Planting("tree", 8.0, (8.0, 16.0), 0.5, 6.0, 1.5),
    Planting("billboard", 80.0, (9.0, 16.0), 0.5, 6.0),
    Planting("tree", 8.0, (22.0, 50.0), 0.6, 18.0, 5.0),
)
_BUDGET = {"tree": 4600, "bush": 3000, "guard_rail": 8000}
"""The most triangles of a planting of that kind, nearest to the ego's path first."""


def build_world(layout: Layout, *, seed: int) -> World:
    """Everything that stands still on a layout, placed by ``seed``. Within :data:`REACH` of the ego's path only."""
    rng = stream(seed, "scenery", layout.name)
    ground = paint_ground(layout, rng=stream(seed, "ground", layout.name))
    verges = trace_verges(ground)
    site, props = _Site(layout, ground, verges), Props()
    urban = layout.name in URBAN
    meshes, scatterers = [_ground_plane(layout.extent)], []
    ground_faces = len(meshes[0].faces)
    if urban:
        meshes.append(kerb_mesh(verges, width=KERB))
        ground_faces += len(meshes[-1].faces)
        houses, echoes = _houses(verges, site, rng)
        meshes.append(houses)
        scatterers.append(echoes)
    if layout.name == "intersection":
        _signals(crossings(layout), props, rng)
    if layout.name in ("highway", "merge", "exit"):
        _gantry(layout, site, props, rng)
    lush = rng.uniform(0.4, 1.3)
    for planting in _URBAN if urban else _RURAL:
        share = planting.share * (lush if planting.kind in ("tree", "bush") else 1.0)
        _plant(planting, share, verges, site, props, rng)
    stands, reflections = props.build(rng)
    mesh = Mesh.concatenate([*meshes, *stands])
    return World(mesh, ground_faces, ground, Scatterers.concatenate([*scatterers, *reflections]))


class _Site:
    """What is free: ``room`` (rows, columns) metres from the carriageway, 0 where something stands or the ego never comes
    near; where people walk; and which way traffic runs."""

    def __init__(self, layout: Layout, ground: GroundMap, verges: list[Verge]) -> None:
        self.cell = ground.resolution * _COARSE
        off_road = ~carriageway(ground, _COARSE)
        self.room = cv2.distanceTransform(off_road.view(np.uint8), cv2.DIST_L2, 3) * self.cell
        self.path = layout.ego.position[:, :2]
        near = np.zeros(off_road.shape, np.uint8)
        cv2.polylines(near, [np.rint(self.path / self.cell).astype(np.int32)], False, 1, int(2 * REACH / self.cell))
        self.room[near == 0] = 0.0
        walk = [verge.points + VERGE / 2 * verge.outward for verge in verges] if layout.name in URBAN else []
        self._walk = cKDTree(np.concatenate([*walk, np.full((1, 2), -BEYOND)]))
        self._lanes = cKDTree(np.concatenate([lane.centre for lane in layout.lanes]))
        self._yaw = np.concatenate([lane.yaw for lane in layout.lanes])

    def room_at(self, at: Array) -> NDArray[np.float32]:
        """Metres of room at places (K, 2); 0 outside and in the middle of a pavement."""
        column, row = np.floor(at / self.cell).astype(int).T
        inside = (row >= 0) & (row < self.room.shape[0]) & (column >= 0) & (column < self.room.shape[1])
        inside &= self._walk.query(at)[0] > 0.62
        return np.where(inside, self.room[row * inside, column * inside], 0.0)

    def fits(self, corners: Array, room: float) -> NDArray[np.bool_]:
        """Whether plots with corners (K, P, 2) have ``room`` all along their outline."""
        share = np.linspace(0, 1, 6)[:, None, None, None]
        outline = corners + share * (np.roll(corners, -1, axis=1) - corners)
        return self.room_at(outline.reshape(-1, 2)).reshape(6, len(corners), corners.shape[1]).min(axis=(0, 2)) >= room

    def take(self, corners: Array) -> None:
        """Build on the plot with corners (P, 2)."""
        cv2.fillConvexPoly(self.room, np.rint(corners / self.cell).astype(np.int32), 0.0)

    def travel(self, at: Array) -> Array:
        """Heading (K,) of the traffic on the lane nearest to each place."""
        return self._yaw[self._lanes.query(at)[1]]

    def on_lane(self, at: Array) -> tuple[Array, float]:
        """The point (2,) in the middle of a lane that is nearest to a place (2,), and the heading there."""
        nearest = self._lanes.query(at)[1]
        return self._lanes.data[nearest], float(self._yaw[nearest])


def _ground_plane(extent: tuple[float, float]) -> Mesh:
    x, y = extent[0] + BEYOND, extent[1] + BEYOND
    corners = np.array([(-BEYOND, -BEYOND, 0), (x, -BEYOND, 0), (x, y, 0), (-BEYOND, y, 0)], np.float32)
    return Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)], np.int32), Surface.uniform(2, (0.1, 0.16, 0.05), 0.45))


def _plant(
    planting: Planting, share: float, verges: list[Verge], site: _Site, props: Props, rng: np.random.Generator
) -> None:
    kind = planting.kind
    rows = [verge.places(planting.spacing, rng) for verge in verges]
    at, outward = (np.concatenate(part) for part in zip(*rows, strict=True)) if rows else (np.zeros((0, 2)),) * 2
    at = at + rng.uniform(*planting.setback, (len(at), 1)) * outward + rng.normal(0.0, 1.0, at.shape) * planting.jitter
    kept = np.flatnonzero((rng.random(len(at)) < share) & (site.room_at(at) >= planting.room))
    kept = kept[np.argsort(cKDTree(site.path).query(at[kept])[0], kind="stable")]
    at, outward = at[kept], outward[kept]
    along = np.arctan2(outward[:, 0], -outward[:, 1])  # the road on the left
    yaw = {
        "tree": rng.uniform(-np.pi, np.pi, len(at)),
        "bush": rng.uniform(-np.pi, np.pi, len(at)),
        "sign_post": site.travel(at),
        "billboard": site.travel(at) + rng.uniform(-0.5, 0.5, len(at)),
        "bench": along + np.pi / 2,
    }.get(kind, along)
    # One model of lamp or rail a road; trees and signs mix.
    models = rng.integers(VARIANTS[kind], size=len(at) if kind in ("tree", "bush", "sign_post", "pole") else 1)
    models = np.broadcast_to(models, len(at))
    for variant in np.unique(models).tolist():
        asset = build_asset(kind, variant)
        chosen = np.flatnonzero(models == variant)
        chosen = chosen[: _BUDGET.get(kind, 10_000) // (len(asset.mesh.faces) * len(np.unique(models)))]
        arm = asset.size[1] / 2 - 0.15 if VARIANT_NAMES[kind][variant].startswith("arm") else 0.0
        props.add(kind, variant, 0, at[chosen] - arm * outward[chosen], yaw[chosen])


def _houses(verges: list[Verge], site: _Site, rng: np.random.Generator) -> tuple[Mesh, Scatterers]:
    """Rows of houses behind the pavements, where the plot is free; taller in some towns than in others."""
    tall, density = rng.uniform(4.0, 16.0), rng.uniform(0.4, 0.95)
    rows = [verge.places(9.0, rng) for verge in verges if not verge.is_island]
    at, outward = (np.concatenate(part) for part in zip(*rows, strict=True)) if rows else (np.zeros((0, 2)),) * 2
    count = len(at)
    size = rng.uniform((8.0, 8.0, 0.7 * tall), (19.0, 13.0, 1.4 * tall + 2.0), (count, 3))  # width, depth, height
    front = at + (VERGE + rng.choice([1.2, 3.5, 8.0], (count, 1))) * outward
    along = np.stack([-outward[:, 1], outward[:, 0]], axis=1)
    depth, width = (
        size[:, 1, None, None] * [[0], [0], [1], [1]],
        size[:, 0, None, None] * [[-0.5], [0.5], [0.5], [-0.5]],
    )
    plots = front[:, None] + depth * outward[:, None] + width * along[:, None]
    built = []
    for i in np.flatnonzero(site.fits(plots, VERGE + 0.6) & (rng.random(count) < density)).tolist():
        if site.fits(plots[i : i + 1], VERGE + 0.6)[0]:  # not where a neighbour has been built meanwhile
            site.take(plots[i])
            built.append(i)
    facing = np.arctan2(-outward[built, 1], -outward[built, 0])
    return build_houses(front[built], facing, size[built], rng=rng)


def _signals(arms: list[Crossing], props: Props, rng: np.random.Generator) -> None:
    """A traffic light on the right of each arm, on an arm over the road or a post; one street has green."""
    green, style = rng.random() < 0.5, rng.choice(["arm", "post"])
    names = VARIANT_NAMES["traffic_light"]
    for crossing in arms:
        ahead = np.array([np.cos(crossing.yaw), np.sin(crossing.yaw)])
        right = np.array([ahead[1], -ahead[0]])
        variant = names.index(f"{style} {'green' if (abs(ahead[0]) > 0.7) == green else 'red'}")
        reach = build_asset("traffic_light", variant).size[1] / 2 - 0.15 if style == "arm" else 0.0
        at = crossing.middle - 2.4 * ahead + (crossing.width / 2 + 1.1 - reach) * right
        props.add("traffic_light", variant, 0, at[None], np.array([crossing.yaw]))


def _gantry(layout: Layout, site: _Site, props: Props, rng: np.random.Generator) -> None:
    """Often a gantry ahead: a bridge where the road is narrow enough, else a cantilever from the right."""
    if rng.random() < 0.3:
        return
    position, course, _ = layout.ego.at(rng.uniform(0.3, 1.0) * layout.ego.times[-1])
    middle, yaw = site.on_lane(position[:2] + rng.uniform(15.0, 70.0) * np.array([np.cos(course), np.sin(course)]))
    left = np.array([-np.sin(yaw), np.cos(yaw)])
    offset = np.arange(-25.0, 25.0, 0.25)
    free = site.room_at(middle + offset[:, None] * left) > 0.3
    right_edge, left_edge = (
        offset[free & (offset < 0)].max(initial=-25.0),
        offset[free & (offset > 0)].min(initial=25.0),
    )
    bridge = left_edge - right_edge < build_asset("gantry", 0).size[1] - 0.3
    variant = VARIANT_NAMES["gantry"].index("bridge" if bridge else "cantilever")
    half = build_asset("gantry", variant).size[1] / 2
    across = (left_edge + right_edge) / 2 if bridge else right_edge - 0.8 + half
    feet = across + np.array([-half, half] if bridge else [-half])
    if (site.room_at(middle + feet[:, None] * left) > 0.3).all():
        props.add("gantry", variant, 0, (middle + across * left)[None], np.array([yaw]))
