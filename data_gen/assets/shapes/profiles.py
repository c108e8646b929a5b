"""Bodies from profiles: outlines extruded across, cross-sections lofted along a path, patches laid on faces.

Everything is built in the body's own frame (x forward, y left, z up), outward normals by construction. :func:`assemble`
joins the parts and fits them to the labelled box.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import mapbox_earcut
import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_gen.assets.shapes.mesh import Asset, Mesh, Scatterers, Surface
from data_gen.assets.shapes.palette import RIM, TYRE, Material

Outline = Sequence[tuple]
"""Points (x, z) around a side view; a third entry is the material of the face from that point to the next."""
Width = float | Callable[[NDArray, NDArray], NDArray]
"""Half-width in metres, or a function of x and z that gives it: a tapered body."""


def _mesh(vertices: ArrayLike, faces: ArrayLike, materials: Sequence[tuple[Material, int]]) -> Mesh:
    surface = Surface.concatenate([material.on(count) for material, count in materials if count])
    return Mesh(np.asarray(vertices, np.float32), np.asarray(faces, np.int32), surface)


def _triangulate(xz: NDArray) -> NDArray:
    """Triangles (T, 3) of a polygon (N, 2), counter-clockwise; empty ones left out."""
    triangles = mapbox_earcut.triangulate_float64(xz, np.array([len(xz)], np.uint32)).reshape(-1, 3).astype(np.int64)
    area = _cross(xz[triangles[:, 1]] - xz[triangles[:, 0]], xz[triangles[:, 2]] - xz[triangles[:, 0]])
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    return triangles[np.abs(area) > 1e-9]


def _cross(a: NDArray, b: NDArray) -> NDArray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _half(width: Width, xz: NDArray) -> NDArray:
    return np.broadcast_to(width(xz[:, 0], xz[:, 1]) if callable(width) else width, len(xz)).astype(float)


def extrude(
    outline: Outline, width: Width, material: Material, *, sides: Material | None = None, y: float = 0.0
) -> Mesh:
    """The outline drawn out from ``y`` - width to ``y`` + width; ``sides`` is the material of the two side faces."""
    xz = np.array([point[:2] for point in outline], float)
    skins = [point[2] if len(point) > 2 else material for point in outline]
    if _cross(xz, np.roll(xz, -1, axis=0)).sum() < 0:
        xz, skins = xz[::-1], [*skins[-2::-1], skins[-1]]
    count, half = len(xz), _half(width, xz)
    right = np.stack([xz[:, 0], y - half, xz[:, 1]], axis=1)
    left = np.stack([xz[:, 0], y + half, xz[:, 1]], axis=1)
    cap = _triangulate(np.ascontiguousarray(xz))
    i = np.arange(count)
    j = (i + 1) % count
    strip = np.stack([i, i + count, j + count, i, j + count, j], axis=1).reshape(-1, 3)
    faces = np.concatenate([cap, cap[:, ::-1] + count, strip])
    return _mesh(
        np.concatenate([right, left]), faces, [(sides or material, 2 * len(cap)), *((skin, 2) for skin in skins)]
    )


def side_patch(
    outline: Outline, width: Width, material: Material, *, proud: float = 0.012, sides: Sequence[int] = (-1, 1)
) -> Mesh:
    """The outline laid on the ``sides`` (-1 right, 1 left) of a body of the same ``width``, ``proud`` metres outside it:
    windows, stripes."""
    xz = np.array(outline, float)
    half = _half(width, xz) + proud
    cap, count = _triangulate(xz), len(xz)
    vertices = [np.stack([xz[:, 0], side * half, xz[:, 1]], axis=1) for side in sides]
    faces = [(cap if side < 0 else cap[:, ::-1]) + i * count for i, side in enumerate(sides)]
    return _mesh(np.concatenate(vertices), np.concatenate(faces), [(material, len(sides) * len(cap))])


def end_patch(x: float, y: tuple[float, float], z: tuple[float, float], material: Material, *, facing: int = 1) -> Mesh:
    """A rectangle across the body at ``x`` that faces forward (1) or back (-1): lamps, plates, grilles."""
    corners = [(x, y[0], z[0]), (x, y[1], z[0]), (x, y[1], z[1]), (x, y[0], z[1])]
    return _mesh(corners if facing > 0 else corners[::-1], [(0, 1, 2), (0, 2, 3)], [(material, 2)])


def face_patch(x: float, outline: Sequence[tuple[float, float]], material: Material, *, facing: int = 1) -> Mesh:
    """A polygon of points (y, z) across the body at ``x`` that faces forward (1) or back (-1): symbols on signs."""
    yz = np.array(outline, float)
    cap = _triangulate(yz)
    vertices = np.column_stack([np.full(len(yz), x), yz])
    return _mesh(vertices, cap if facing > 0 else cap[:, ::-1], [(material, len(cap))])


def end_pair(x: float, y: tuple[float, float], z: tuple[float, float], material: Material, *, facing: int = 1) -> Mesh:
    """:func:`end_patch` on the left and its mirror image on the right."""
    return Mesh.concatenate([end_patch(x, span, z, material, facing=facing) for span in (y, (-y[1], -y[0]))])


def box(low: ArrayLike, high: ArrayLike, material: Material, **skins: Material) -> Mesh:
    """An axis-aligned box; ``skins`` names other materials of its faces: back, front, right, left, bottom, top."""
    x, y, z = np.stack([np.asarray(low, float), np.asarray(high, float)], axis=1)
    vertices = [(a, b, c) for a in x for b in y for c in z]
    quads = {
        "back": (0, 1, 3, 2),
        "front": (4, 6, 7, 5),
        "right": (0, 4, 5, 1),
        "left": (2, 3, 7, 6),
        "bottom": (0, 2, 6, 4),
        "top": (1, 5, 7, 3),
    }
    faces = [face for a, b, c, d in quads.values() for face in ((a, b, c), (a, c, d))]
    return _mesh(vertices, faces, [(skins.get(name, material), 2) for name in quads])


def loft(
    centres: ArrayLike,
    radii: Sequence[float | tuple[float, float]],
    materials: Material | Sequence[Material],
    *,
    sections: int = 8,
    caps: tuple[Material, Material] | None = None,
) -> Mesh:
    """Elliptic cross-sections at K ``centres`` joined to a closed skin: wheels, limbs, poles, cones, tanks.

    All cross-sections lie across the line from first to last centre. ``radii`` K numbers or pairs (upright: along x,
    then y; lying along x: along y, then z); ``materials`` one for all or K - 1 for the parts between.
    """
    centres = np.asarray(centres, float)
    axis = centres[-1] - centres[0]
    axis /= np.linalg.norm(axis)
    u = np.cross((0.0, 0.0, 1.0), axis) if abs(axis[2]) < 0.5 else np.array([1.0, 0, 0]) - axis[0] * axis
    u /= np.linalg.norm(u)
    angle = (np.arange(sections) + 0.5) * 2 * np.pi / sections
    across = np.array([r if isinstance(r, tuple) else (r, r) for r in radii]) / np.cos(np.pi / sections) ** 0.5
    rings = across[:, None, :1] * np.cos(angle)[:, None] * u + across[:, None, 1:] * np.sin(angle)[:, None] * np.cross(
        axis, u
    )
    vertices = (centres[:, None] + rings).reshape(-1, 3)
    k = np.arange(sections)
    a, b = k, (k + 1) % sections
    band = np.stack([a, b, b + sections, a, b + sections, a + sections], axis=1).reshape(-1, 3)
    parts = len(centres) - 1
    fan = np.stack([np.zeros(sections - 2, int), k[1:-1], k[2:]], axis=1)
    faces = np.concatenate([*(band + i * sections for i in range(parts)), fan[:, ::-1], fan + parts * sections])
    skins = [materials] * parts if isinstance(materials, Material) else list(materials)
    first, last = caps or (skins[0], skins[-1])
    return _mesh(vertices, faces, [*((skin, 2 * sections) for skin in skins), (first, len(fan)), (last, len(fan))])


def ball(centre: ArrayLike, radii: tuple[float, float, float], material: Material, *, sections: int = 8) -> Mesh:
    """An ellipsoid with half-axes along x, y, z, of three bands."""
    x, y, z = radii
    centre = np.asarray(centre, float)
    levels = np.array([-1.0, -0.5, 0.5, 1.0])
    return loft(
        centre + levels[:, None] * (0, 0, z),
        [(0.45 * x, 0.45 * y), (x, y), (x, y), (0.45 * x, 0.45 * y)],
        material,
        sections=sections,
    )


def ring(
    centre: ArrayLike, radius: float, thickness: float, width: float, material: Material, *, sections: int = 14
) -> Mesh:
    """A hoop about the y axis, through which one looks: a spoked wheel."""
    angle = np.arange(sections) * 2 * np.pi / sections
    rim = [(radius, -width / 2), (radius, width / 2), (radius - thickness, width / 2), (radius - thickness, -width / 2)]
    vertices = [np.stack([r * np.cos(angle), np.full(sections, y), r * np.sin(angle)], axis=1) for r, y in rim]
    k = np.arange(sections)
    n = (k + 1) % sections
    pairs = [(i * sections, (i + 1) % 4 * sections) for i in range(4)]
    bands = [np.stack([k + a, k + b, n + b, k + a, n + b, n + a], axis=1).reshape(-1, 3) for a, b in pairs]
    return _mesh(np.concatenate(vertices) + np.asarray(centre), np.concatenate(bands), [(material, 8 * sections)])


def rod(points: ArrayLike, radius: float, material: Material) -> Mesh:
    """A thin square tube along ``points`` (K, 3): frames, forks, handlebars."""
    return loft(points, [radius] * len(np.asarray(points)), material, sections=4)


def axle(
    x: float, half_track: float, radius: float, width: float, *, sections: int = 10, rim: Material = RIM
) -> list[Mesh]:
    """Two wheels whose outer faces are at y = +-``half_track``, standing on the ground."""
    return [wheel(x, side * half_track, radius, side * width, sections=sections, rim=rim) for side in (-1, 1)]


def wheel(x: float, y: float, radius: float, width: float, *, sections: int = 10, rim: Material = RIM) -> Mesh:
    """A wheel on the ground with its outer face at ``y``; it reaches inwards by ``width``, whose sign is the side."""
    centres = [(x, y - width, radius), (x, y, radius), (x, y + 0.01 * np.sign(width), radius)]
    return loft(centres, [radius, radius, 0.6 * radius], TYRE, sections=sections, caps=(TYRE, rim))


def arch(x: float, radius: float, floor: float, *, points: int = 6) -> list[tuple[float, float, Material]]:
    """Outline points of a wheel house about a wheel at ``x``, to be put between two points of the body's under side as
    it runs forward at height ``floor``."""
    outer = 1.14 * radius
    low = np.arcsin((floor - radius) / outer)
    angle = np.linspace(np.pi - low, low, points)
    return [(x + outer * np.cos(a), radius + outer * np.sin(a), TYRE) for a in angle]


def at(origin: ArrayLike, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> NDArray:
    """The point (3,) that lies (x, y, z) from ``origin``."""
    return np.asarray(origin, float) + np.array([x, y, z])


def moved(mesh: Mesh, *, offset: Sequence[float] = (0.0, 0.0, 0.0), yaw: float = 0.0) -> Mesh:
    """The mesh turned about z by ``yaw`` radians, then shifted."""
    c, s = np.cos(yaw), np.sin(yaw)
    return mesh.moved(np.array([[c, -s, 0, offset[0]], [s, c, 0, offset[1]], [0, 0, 1, offset[2]], [0, 0, 0, 1]]))


def assemble(
    name: str,
    category: str,
    parts: Sequence[Mesh],
    scatter: Callable[[tuple[float, float, float]], Scatterers],
    *,
    size: tuple[float, float, float] | None = None,
) -> Asset:
    """Join the parts, drop empty faces, stretch to ``size`` (length, width, height; None: as built), put the origin on
    the ground below the centre of the box. ``scatter`` gives the radar's view of a body of that size."""
    mesh = Mesh.concatenate(parts)
    solid = _solid(mesh)
    surface = Surface(*(values[solid] for values in vars(mesh.surface).values()))
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    if size is None:
        length, width, height = (round(float(value), 3) for value in high - low)
        size = (length, width, height)
    origin = np.array([*(low + high)[:2] / 2, low[2]])
    vertices = ((mesh.vertices - origin) * (np.array(size) / (high - low))).astype(np.float32)
    return Asset(name, category, size, Mesh(vertices, mesh.faces[solid], surface), scatter(size))


def animated(asset: Asset, phases: Sequence[Sequence[Mesh]], stride: float) -> Asset:
    """An assembled asset that moves its limbs: ``phases`` are its parts over a cycle of ``stride`` metres, the first as they
    were assembled. Each stands on the ground and is as tall as the box."""
    first, gait = Mesh.concatenate(phases[0]), []
    solid, middle = _solid(first), (first.vertices.min(axis=0) + first.vertices.max(axis=0)) / 2
    for parts in phases:
        vertices = Mesh.concatenate(parts).vertices - middle
        low, high = vertices[:, 2].min(), vertices[:, 2].max()
        vertices[:, 2] = (vertices[:, 2] - low) * asset.size[2] / (high - low)
        gait.append(Mesh(vertices.astype(np.float32), first.faces[solid], asset.mesh.surface))
    return replace(asset, gait=tuple(gait), stride=stride)


def _solid(mesh: Mesh) -> NDArray[np.bool_]:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-7
