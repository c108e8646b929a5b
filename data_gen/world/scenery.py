"""The static world of a layout: ground, kerbs, houses, trees, lamps, guard rails, and their radar reflections."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_gen.assets.catalogue import VARIANT_NAMES, build_asset
from data_gen.assets.shapes.mesh import Mesh, Scatterers, Surface
from data_gen.road.layout import Layout
from data_gen.world.buildings import build_houses, fitted
from data_gen.world.ground import GroundMap
from data_gen.world.marks import Crossing, crossings
from data_gen.world.paint import KERB, URBAN, VERGE, paint_ground
from data_gen.world.planting import RURAL_PLANTS, URBAN_PLANTS, plant
from data_gen.world.props import Props
from data_gen.world.roadside import Verge, kerb_mesh, trace_verges
from data_gen.world.site import REACH, Site
from fusion_net.common.random import stream

Array = NDArray[np.float64]

__all__ = ["BEYOND", "REACH", "World", "build_world"]

BEYOND = 400.0
"""The ground goes on for this far beyond the layout, in metres."""


@dataclass(frozen=True)
class World:
    """The static world in the global frame. The first ``ground_faces`` faces take their material from ``ground``."""

    mesh: Mesh
    ground_faces: int
    ground: GroundMap
    scatterers: Scatterers


def build_world(layout: Layout, *, seed: int) -> World:
    """Everything that stands still on a layout, placed by ``seed``. Within :data:`REACH` of the ego's path only."""
    rng = stream(seed, "scenery", layout.name)
    ground = paint_ground(layout, rng=stream(seed, "ground", layout.name))
    verges = trace_verges(ground)
    site, props = Site(layout, ground, verges), Props()
    urban = layout.name in URBAN
    meshes, scatterers = [_ground_plane(layout.extent)], []
    ground_faces = len(meshes[0].faces)
    if urban:
        meshes.append(kerb_mesh(verges, width=KERB))
        ground_faces += len(meshes[-1].faces)
        houses, fronts = _houses(verges, site, rng)
        meshes.append(houses)
        scatterers.append(fronts)
    if layout.name == "intersection":
        _signals(crossings(layout), props, rng)
    if layout.name in ("highway", "merge", "exit"):
        _gantry(layout, site, props, rng)
    lush = rng.uniform(0.4, 1.3)
    for planting in URBAN_PLANTS if urban else RURAL_PLANTS:
        share = planting.share * (lush if planting.kind in ("tree", "bush", "grove") else 1.0)
        plant(planting, share, verges, site, props, rng)
    stands, reflections = props.build(rng)
    mesh = Mesh.concatenate([*meshes, *stands])
    return World(mesh, ground_faces, ground, Scatterers.concatenate([*scatterers, *reflections]))


def _ground_plane(extent: tuple[float, float]) -> Mesh:
    x, y = extent[0] + BEYOND, extent[1] + BEYOND
    corners = np.array([(-BEYOND, -BEYOND, 0), (x, -BEYOND, 0), (x, y, 0), (-BEYOND, y, 0)], np.float32)
    return Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)], np.int32), Surface.uniform(2, (0.1, 0.16, 0.05), 0.45))


def _houses(verges: list[Verge], site: Site, rng: np.random.Generator) -> tuple[Mesh, Scatterers]:
    """Rows of houses behind the pavements, where the plot is free; taller in some towns than in others."""
    tall, density = rng.uniform(4.0, 16.0), rng.uniform(0.4, 0.95)
    rows = [verge.places(9.0, rng) for verge in verges if not verge.is_island]
    at, outward = (np.concatenate(part) for part in zip(*rows, strict=True)) if rows else (np.zeros((0, 2)),) * 2
    count = len(at)
    size = rng.uniform((8.0, 8.0, 0.7 * tall), (19.0, 13.0, 1.4 * tall + 2.0), (count, 3))  # width, depth, height
    front = at + (VERGE + rng.choice([1.2, 3.5, 8.0], (count, 1))) * outward
    front, size = fitted(front, outward, size)
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


def _gantry(layout: Layout, site: Site, props: Props, rng: np.random.Generator) -> None:
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
