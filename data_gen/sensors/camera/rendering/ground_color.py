"""The ground's colour under a pixel: an area average over the rasters of material, lane paint and wear."""

import numpy as np

from data_gen.jobs.jit import jit
from data_gen.scene.noise import lattice
from data_gen.world.ground import EVEN, IS_MARK, TONE_STRIDE

_NEAR = 0.15
"""Metres that a pixel covers across, below which the raster's cells would show: edges are then sought within the cell."""


@jit
def _bilinear(raster, x, y):
    """The raster at (x, y) in pixels from its corner, not nearer to its border than a pixel."""
    i, j = int(y - 0.5), int(x - 0.5)
    v, u = y - 0.5 - i, x - 0.5 - j
    low = raster[i, j] * (1 - u) + raster[i, j + 1] * u
    high = raster[i + 1, j] * (1 - u) + raster[i + 1, j + 1] * u
    return low * (1 - v) + high * v


@jit
def _close(material, cover, x, y, width):
    """What lies at (x, y) in pixels of the raster: a mark, the ground under or beside it, and the fraction of
    ``width`` pixels across the mark's edge that it takes. Edges
    between other materials are ragged by half a cell instead of running along cells."""
    i, j = int(y - 0.5), int(x - 0.5)
    first = int(material[i, j])
    mark, ground = (first, 0) if IS_MARK[first] else (0, first)
    second, third, fourth = int(material[i, j + 1]), int(material[i + 1, j]), int(material[i + 1, j + 1])
    if second == first and third == first and fourth == first:
        return mark, ground, 1.0 if mark else 0.0
    for found in (second, third, fourth):
        if IS_MARK[found]:
            mark = max(mark, found)
        else:
            ground = max(ground, found)
    if mark:  # its edge is where half of a cell is covered, as in a distance field
        return mark, ground, min(max(0.5 + (_bilinear(cover, x, y) / 255.0 - 0.5) / width, 0.0), 1.0)
    row, column = int(4 * y), int(4 * x)
    dx, dy = lattice(column, row, 91) - 0.5, lattice(column, row, 92) - 0.5
    return 0, int(material[int(y + 1.2 * dy), int(x + 1.2 * dx)]), 0.0


@jit
def is_level_ground(body, face, normal, ground_faces):
    """Whether a hit lies on the ground and looks up: the front of a kerb has a colour of its own."""
    return body == -1 and face < ground_faces and abs(normal) > 0.7


@jit
def ground_colors(view, rays, pixel, span, hit, ground_faces, ground, out):
    """Mean albedo of the ground over the part of its plane that each pixel sees, written to the first columns of ``out`` (N, 5)
    for hits on level ground. A pixel is cut into sub-rays by how much ground it covers. ``ground``: rasters of material, cover
    and tone, origin, resolution, albedo table; the rest as in ``textures.paint``."""
    body, face, distance, local, normal = hit
    material, cover, tone, origin, resolution, table = ground
    rows, columns = material.shape
    for i in range(len(rays)):
        if not is_level_ground(body[i], face[i], normal[i, 2], ground_faces):
            continue
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        px, py = local[i, 0], local[i, 1]
        depth = rays[i, 0] * view[1, 0] + rays[i, 1] * view[1, 1] + rays[i, 2] * view[1, 2]
        facing = abs(rays[i, 0] * nx + rays[i, 1] * ny + rays[i, 2] * nz)
        footprint = pixel * span * distance[i]
        x, y = (px - origin[0]) / resolution, (py - origin[1]) / resolution
        gain = 1.0
        if 4 <= x < columns - 4 and 4 <= y < rows - 4:
            gain = _bilinear(tone, x / TONE_STRIDE, y / TONE_STRIDE) / EVEN
        bright = min(gain, 1.0)  # old asphalt is pale, old paint is not brighter than new
        count_v = int(min(max(np.ceil(footprint / max(facing, 0.02) / 0.3), 2.0), 8.0))
        count_u = int(min(max(np.ceil(footprint / 0.12), 2.0), 4.0))
        gap = nx * (px - view[0, 0]) + ny * (py - view[0, 1]) + nz * (local[i, 2] - view[0, 2])
        width = max(footprint / count_u / resolution, 0.25)
        used = 0
        red = green = blue = 0.0
        for a in range(count_v):
            for b in range(count_u):
                # Sheared: no two sub-rays lie in one row or column.
                dv = span * ((a + (b + 0.5) / count_u) / count_v - 0.5)
                du = span * ((b + (a + 0.5) / count_v) / count_u - 0.5)
                rx = rays[i, 0] / depth + du * view[2, 0] + dv * view[3, 0]
                ry = rays[i, 1] / depth + du * view[2, 1] + dv * view[3, 1]
                rz = rays[i, 2] / depth + du * view[2, 2] + dv * view[3, 2]
                slope = nx * rx + ny * ry + nz * rz
                if slope * gap <= 0 or gap > 600.0 * slope > 0 or gap < 600.0 * slope < 0:
                    continue
                s = gap / slope
                x, y = (view[0, 0] + s * rx - origin[0]) / resolution, (view[0, 1] + s * ry - origin[1]) / resolution
                used += 1
                mark, under, fraction = 0, 0, 0.0
                if footprint < _NEAR and 2 <= x < columns - 2 and 2 <= y < rows - 2:
                    mark, under, fraction = _close(material, cover, x, y, width)
                elif 0 <= x < columns and 0 <= y < rows:
                    under = int(material[int(y), int(x)])
                    fraction, mark = (1.0, under) if IS_MARK[under] else (0.0, 0)
                over, below = fraction * bright, (1 - fraction) * gain
                red += over * table[mark, 0] + below * table[under, 0]
                green += over * table[mark, 1] + below * table[under, 1]
                blue += over * table[mark, 2] + below * table[under, 2]
        used = max(used, 1)
        out[i, 0], out[i, 1], out[i, 2] = red / used, green / used, blue / used
