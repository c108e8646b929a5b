"""What colour a surface is where a ray meets it: materials, ground raster and procedural textures.

Textures are functions of the body's local coordinates, so they stick to a body that moves. Every feature is filtered over
the pixel's footprint in metres, analytically or by fading out, so that nothing shimmers with distance.
"""

import numpy as np

from data_gen.jit import jit
from data_gen.mesh import TEXTURES
from data_gen.sensors.noise import band, lattice, octave2, octave3

_PLAIN, _ASPHALT, _GRASS, _CONCRETE, _BRICK, _FACADE, _FOLIAGE, _HOARDING, _METAL, _FABRIC, _WOOD = range(len(TEXTURES))


@jit
def _facade(u, v, footprint, rgb, out, night):
    """Storeys 3.2 m high with windows every 2.8 m: glass reflects, some rooms are lit at night."""
    ground_floor = v < 3.6
    inside = band(u, 2.8, 0.6, 1.6, footprint) * band(v, 3.2, 1.0, 1.6, footprint)
    column, storey = int(np.floor(u / 2.8)), int(np.floor(v / 3.2))
    pick = lattice(column, storey, 71)
    frame = band(u, 2.8, 0.5, 1.8, footprint) * band(v, 3.2, 0.85, 1.85, footprint) - inside
    ledge = band(v, 3.2, 0.0, 0.18, footprint)
    wear = 1 + 0.10 * octave2(u, v, 2.5, footprint, 72) + 0.06 * octave2(u, v, 0.4, footprint, 73)
    wear *= 1 - 0.25 * ledge - (0.12 if ground_floor else 0.0)
    glass = 0.03 + 0.20 * (pick > 0.72)  # a drawn blind is bright
    for c in range(3):
        out[c] = rgb[c] * wear * (1 - inside) + glass * inside + 0.25 * frame * (0.5 - rgb[c])
    out[3] = max(out[3], 0.45 * inside * (pick <= 0.72))
    if night and lattice(column, storey, 74) < 0.3:
        out[4] = max(out[4], 0.02 * inside)
        out[0], out[1], out[2] = out[0] + 0.5 * inside, out[1] + 0.36 * inside, out[2] + 0.18 * inside


@jit
def _hoarding(u, v, footprint, rgb, out):
    """Bold printed panels: colour and white in turn, crossed by dark diagonal stripes."""
    column, row = int(np.floor(u / 0.9)), int(np.floor(v / 0.7))
    stripe = band(u + v, 0.8, 0.0, 0.3, 1.4 * footprint)
    check = band(u, 1.8, 0.0, 0.9, footprint)
    level = band(v, 1.4, 0.0, 0.7, footprint)
    odd = check * (1 - level) + level * (1 - check)
    wear = 0.94 + 0.06 * lattice(column, row, 81)
    for c in range(3):
        panel = rgb[c] * (1 - odd) + 0.72 * odd
        out[c] = (panel * (1 - stripe) + (0.03 + 0.25 * rgb[c]) * stripe) * wear


@jit
def texture(kind, x, y, z, u, v, footprint, rgb, out, night):
    """Modulate a surface in place. (x, y, z) local metres, (u, v) metres along the surface, ``rgb`` its mean colour;
    ``out`` holds r, g, b, specular, emission."""
    gain = 1.0
    if kind == _ASPHALT:
        gain += 0.09 * octave2(x, y, 5.0, footprint, 11) + 0.07 * octave2(x, y, 0.9, footprint, 12)
        gain += 0.16 * octave2(x, y, 0.06, footprint, 13)
        seam = abs(octave2(x, y, 3.1, footprint, 14))
        gain -= 0.30 * max(0.0, 1 - seam / 0.02) * max(0.0, 1 - footprint / 0.12)
    elif kind == _GRASS:
        tone = 0.5 * octave2(x, y, 7.0, footprint, 21) + 0.5 * octave2(x, y, 1.3, footprint, 22)
        gain += 0.22 * tone + 0.28 * octave2(x, y, 0.22, footprint, 23) + 0.30 * octave2(x, y, 0.05, footprint, 24)
        out[0] *= 1 + 0.35 * tone
        out[2] *= 1 - 0.20 * tone
    elif kind == _CONCRETE:
        joint = max(band(u, 3.0, 0.0, 0.03, footprint), band(v, 3.0, 0.0, 0.03, footprint))
        gain += 0.09 * octave3(x, y, z, 1.7, footprint, 31) + 0.08 * octave3(x, y, z, 0.12, footprint, 32) - 0.4 * joint
    elif kind == _BRICK:
        row = int(np.floor(v / 0.09))
        shifted = u + 0.13 * (row % 2)
        mortar = 1 - band(shifted, 0.26, 0.0, 0.245, footprint) * band(v, 0.09, 0.0, 0.078, footprint)
        tint = lattice(int(np.floor(shifted / 0.26)), row, 41) - 0.5
        gain += 0.5 * tint * max(0.0, 1 - footprint / 0.25) + 0.10 * octave2(u, v, 2.0, footprint, 42)
        for c in range(3):
            out[c] += mortar * (0.42 - out[c])
    elif kind == _FACADE:
        _facade(u, v, footprint, rgb, out, night)
    elif kind == _FOLIAGE:
        clump = octave3(x, y, z, 0.9, footprint, 51)
        gain += (
            0.38 * clump + 0.40 * octave3(x, y, z, 0.30, footprint, 52) + 0.35 * octave3(x, y, z, 0.10, footprint, 53)
        )
        out[0] *= 1 + 0.25 * clump
    elif kind == _HOARDING:
        _hoarding(u, v, footprint, rgb, out)
    elif kind == _METAL:
        gain += 0.10 * octave2(u, 0.15 * v, 0.12, footprint, 61) + 0.06 * octave2(u, v, 0.8, footprint, 62)
    elif kind == _FABRIC:
        gain += 0.16 * octave3(x, y, 0.4 * z, 0.11, footprint, 63) + 0.10 * octave3(x, y, z, 0.02, footprint, 64)
    elif kind == _WOOD:
        gain += 0.22 * octave2(u, 0.1 * v, 0.05, footprint, 65) + 0.12 * octave2(u, v, 0.7, footprint, 66)
    for c in range(3):
        out[c] = max(out[c] * gain, 0.004)


@jit
def _ground(p, n, o, step_u, step_v, r, span, footprint, slant, raster, origin, resolution, table, out):
    """Mean albedo of the ground raster over the part of the plane (p, n) that one pixel sees, written to ``out``. The pixel
    is cut into sub-rays by how much ground it covers."""
    count_v = int(min(max(np.ceil(footprint * slant / 0.3), 2.0), 8.0))
    count_u = int(min(max(np.ceil(footprint / 0.12), 2.0), 4.0))
    gap = n[0] * (p[0] - o[0]) + n[1] * (p[1] - o[1]) + n[2] * (p[2] - o[2])
    rows, columns = raster.shape
    used = 0
    out[0] = out[1] = out[2] = 0.0
    for a in range(count_v):
        for b in range(count_u):
            dv = span * ((a + (b + 0.5) / count_u) / count_v - 0.5)  # sheared: no two sub-rays share a row or a column
            du = span * ((b + (a + 0.5) / count_v) / count_u - 0.5)
            rx = r[0] + du * step_u[0] + dv * step_v[0]
            ry = r[1] + du * step_u[1] + dv * step_v[1]
            facing = n[0] * rx + n[1] * ry + n[2] * (r[2] + du * step_u[2] + dv * step_v[2])
            if facing * gap <= 0 or gap > 600.0 * facing > 0 or gap < 600.0 * facing < 0:
                continue
            s = gap / facing
            column = int(np.floor((o[0] + s * rx - origin[0]) / resolution))
            row = int(np.floor((o[1] + s * ry - origin[1]) / resolution))
            inside = 0 <= row < rows and 0 <= column < columns
            material = raster[row, column] if inside else 0
            for c in range(3):
                out[c] += table[material, c]
            used += 1
    for c in range(3):
        out[c] /= max(used, 1)


@jit
def paint(view, rays, pixel, span, hit, surface, ground, yaw, night):
    """Colour of every hit.

    ``view`` (4, 3): origin, forward, and the global change of a depth-one ray per pixel to the right and down. ``rays``
    (N, 3) unit. ``pixel`` rad a pixel, ``span`` the part of a pixel that a ray stands for. ``hit``: body, face, distance,
    local, normal. ``surface``: albedo, texture, specular, emission of all faces. ``ground``: first face that is none,
    raster, origin, resolution, albedo table, texture table. ``yaw`` (A,) of the bodies.
    Returns (N, 5): linear r, g, b, specular share, emission.
    """
    body, face, distance, local, normal = hit
    albedo, kinds, specular, emission = surface
    ground_faces, raster, origin, resolution, table, ground_kinds = ground
    out = np.zeros((len(rays), 5), np.float32)
    rgb = np.zeros(3, np.float32)
    for i in range(len(rays)):
        if body[i] < -1:
            continue
        f, o, n, p = face[i], out[i], normal[i], local[i]
        facing = abs(rays[i, 0] * n[0] + rays[i, 1] * n[1] + rays[i, 2] * n[2])
        slant = 1 / max(facing, 0.02)
        footprint = pixel * span * np.float64(distance[i])
        x, y, z = np.float64(p[0]), np.float64(p[1]), np.float64(p[2])  # one type: the noise compiles once
        nx, ny = np.float64(n[0]), np.float64(n[1])
        kind = kinds[f]
        if body[i] == -1 and f < ground_faces:
            depth = rays[i, 0] * view[1, 0] + rays[i, 1] * view[1, 1] + rays[i, 2] * view[1, 2]
            ray = rays[i] / depth
            _ground(p, n, view[0], view[2], view[3], ray, span, footprint, slant, raster, origin, resolution, table, o)
            row, column = int((y - origin[1]) / resolution), int((x - origin[0]) / resolution)
            if 0 <= row < raster.shape[0] and 0 <= column < raster.shape[1]:
                kind = ground_kinds[raster[row, column]]
            else:
                kind = ground_kinds[0]
        else:
            for c in range(3):
                o[c] = albedo[f, c]
            o[3], o[4] = specular[f], emission[f]
            if body[i] >= 0:
                cos, sin = np.cos(yaw[body[i]]), np.sin(yaw[body[i]])
                nx, ny = cos * nx + sin * ny, cos * ny - sin * nx
        level = abs(n[2]) > 0.7
        across = max(np.hypot(nx, ny), 1e-6)
        u = x if level else (nx * y - ny * x) / across
        v = y if level else z
        if kind != _PLAIN:
            for c in range(3):
                rgb[c] = o[c]
            texture(kind, x, y, z, u, v, footprint * np.sqrt(min(slant, 12.0)), rgb, o, night)
    return out
