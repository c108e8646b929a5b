"""What colour a surface is where a ray meets it: materials, ground raster and procedural textures.

Textures are functions of the body's local coordinates, so they stick to a body that moves. Every feature is filtered over
the pixel's footprint in metres, analytically or by fading out, so that nothing shimmers with distance.
"""

import numpy as np

from data_gen.assets.shapes.mesh import TEXTURES
from data_gen.jobs.jit import jit
from data_gen.scene.noise import band, lattice, mix, octave2, octave3, ramp
from data_gen.sensors.camera.rendering.facades import facade
from data_gen.sensors.camera.rendering.ground_color import ground_colors, is_level_ground

(_PLAIN, _ASPHALT, _GRASS, _CONCRETE, _BRICK, _FACADE, _FOLIAGE, _HOARDING, _METAL, _FABRIC, _WOOD, _SLABS, _PAINT,
 _GRAVEL, _LACQUER, _TILES) = range(len(TEXTURES))  # fmt: skip


@jit
def _asphalt(x, y, footprint):
    """Blotches, grain of the stones, and cracks where the road is old. Returns the gain."""
    gain = 1 + 0.09 * octave2(x, y, 5.0, footprint, 11) + 0.07 * octave2(x, y, 0.9, footprint, 12)
    gain += 0.13 * octave2(x, y, 0.06, footprint, 13) + 0.15 * octave2(x, y, 0.021, footprint, 15)
    visible = 1 - footprint / 0.10
    if visible > 0:
        age = ramp(0.1, 0.5, octave2(x, y, 11.0, footprint, 16))
        if age > 0:
            seam = abs(octave2(x, y, 2.3, footprint, 14) + 0.12 * octave2(x, y, 0.3, footprint, 17))
            gain -= 0.5 * age * visible * max(0.0, 1 - seam / 0.016)
    return gain


@jit
def _grass(x, y, footprint, out):
    """Tufts and blades, dry and lush stretches, bare soil where it is thinnest, a flower here and there."""
    tone = 0.6 * octave2(x, y, 9.0, footprint, 21) + 0.5 * octave2(x, y, 1.4, footprint, 22)
    tuft = octave2(x, y, 0.30, footprint, 23)
    blade = octave2(x, 0.4 * y, 0.045, footprint, 24)
    gain = 1 + 0.25 * tone + 0.34 * tuft + 0.34 * blade
    out[0] *= 1 + 0.45 * tone
    out[2] *= 1 - 0.20 * tone
    mix(out, 0.7 * ramp(0.45, 0.8, -tone + 0.3 * tuft), 0.17, 0.12, 0.07)
    if footprint < 0.08 and lattice(int(np.floor(x / 0.12)), int(np.floor(y / 0.12)), 25) < 0.004 * (1 + tone):
        mix(out, 1 - footprint / 0.08, 0.62, 0.58, 0.30 * tone + 0.25)
    return gain


@jit
def _slabs(u, v, footprint):
    """Paving slabs of half a metre, laid in bond, no two quite alike."""
    row = int(np.floor(v / 0.5))
    shifted = u + 0.25 * (row % 2)
    joint = max(band(shifted, 0.5, 0.0, 0.014, footprint), band(v, 0.5, 0.0, 0.014, footprint))
    tint = lattice(int(np.floor(shifted / 0.5)), row, 33) - 0.5
    gain = 1 + 0.22 * tint * max(0.0, 1 - footprint / 0.5) - 0.55 * joint
    return gain + 0.10 * octave2(u, v, 2.1, footprint, 34) + 0.09 * octave2(u, v, 0.04, footprint, 35)


@jit
def _brick(u, v, footprint, out):
    row = int(np.floor(v / 0.09))
    shifted = u + 0.13 * (row % 2)
    mortar = 1 - band(shifted, 0.26, 0.0, 0.245, footprint) * band(v, 0.09, 0.0, 0.078, footprint)
    tint = lattice(int(np.floor(shifted / 0.26)), row, 41) - 0.5
    mix(out, mortar, 0.42, 0.42, 0.42)
    return 1 + 0.5 * tint * max(0.0, 1 - footprint / 0.25) + 0.10 * octave2(u, v, 2.0, footprint, 42)


@jit
def _foliage(x, y, z, footprint, out):
    """Light and dark leaves, and gaps that look into the dark of the crown."""
    clump = octave3(x, y, z, 0.9, footprint, 51)
    leaf = octave3(x, y, z, 0.13, footprint, 53)
    gap = ramp(0.30, 0.55, octave3(x, y, z, 0.27, footprint, 52))
    out[0] *= 1 + 0.30 * clump
    return (1 + 0.30 * clump + 0.45 * leaf) * (1 - 0.7 * gap)


@jit
def _billboard(u, v, footprint, rgb, out):
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
def _lacquer(x, y, z, footprint, rgb, out):
    """Car paint: road dirt from the sills up, more on some colours than on others; it takes the gloss too."""
    dirty = lattice(int(rgb[0] * 16381), int(rgb[1] * 16381), 94)
    reach = 0.5 + 0.9 * dirty * dirty
    dirt = ramp(reach, 0.1, z) * (0.6 + 0.4 * octave3(x, y, z, 0.45, footprint, 95)) + 0.16 * dirty * dirty
    dirt = min(max(dirt, 0.0), 0.8)
    mix(out, dirt, 0.14, 0.12, 0.095)
    out[3] *= 1 - 0.9 * dirt


@jit
def _worn_paint(x, y, footprint, out):
    """Lane paint that has chipped where wheels cross it."""
    wear = 0.35 * octave2(x, y, 6.0, footprint, 96)
    chip = octave2(x, y, 0.05, footprint, 97) + 0.6 * octave2(x, y, 0.22, footprint, 98)
    mix(out, 0.8 * ramp(0.45, 0.75, chip + wear), 0.13, 0.13, 0.135)
    return 1 + 0.5 * min(wear, 0.0) + 0.05 * chip


@jit
def texture(kind, x, y, z, u, v, footprint, rgb, out, night):
    """Modulate a surface in place. (x, y, z) local metres, (u, v) metres along the surface, ``rgb`` its mean colour;
    ``out`` holds r, g, b, specular, emission."""
    gain = 1.0
    if kind == _ASPHALT:
        gain = _asphalt(x, y, footprint)
    elif kind == _GRASS:
        gain = _grass(x, y, footprint, out)
    elif kind == _CONCRETE:
        joint = max(band(u, 3.0, 0.0, 0.03, footprint), band(v, 3.0, 0.0, 0.03, footprint))
        gain += 0.09 * octave3(x, y, z, 1.7, footprint, 31) + 0.08 * octave3(x, y, z, 0.12, footprint, 32) - 0.4 * joint
    elif kind == _SLABS:
        gain = _slabs(u, v, footprint)
    elif kind == _PAINT:
        gain = _worn_paint(x, y, footprint, out)
    elif kind == _GRAVEL:
        gain += 0.16 * octave2(x, y, 0.7, footprint, 36) + 0.35 * octave2(x, y, 0.05, footprint, 37)
    elif kind == _LACQUER:
        _lacquer(x, y, z, footprint, rgb, out)
    elif kind == _BRICK:
        gain = _brick(u, v, footprint, out)
    elif kind == _TILES:
        row = band(v, 0.34, 0.0, 0.09, footprint)
        gain += 0.12 * octave2(u, v, 0.9, footprint, 43) + 0.14 * octave2(u, v, 0.25, footprint, 44) - 0.4 * row
    elif kind == _FACADE:
        facade(u, v, footprint, rgb, out, night)
    elif kind == _FOLIAGE:
        gain = _foliage(x, y, z, footprint, out)
    elif kind == _HOARDING:
        _billboard(u, v, footprint, rgb, out)
    elif kind == _METAL:
        gain += 0.10 * octave2(u, 0.15 * v, 0.12, footprint, 61) + 0.06 * octave2(u, v, 0.8, footprint, 62)
    elif kind == _FABRIC:
        gain += 0.16 * octave3(x, y, 0.4 * z, 0.11, footprint, 63) + 0.10 * octave3(x, y, z, 0.02, footprint, 64)
    elif kind == _WOOD:
        gain += 0.22 * octave2(u, 0.1 * v, 0.05, footprint, 65) + 0.12 * octave2(u, v, 0.7, footprint, 66)
    for c in range(3):
        out[c] = max(out[c] * gain, 0.004)


@jit
def paint(view, rays, pixel, span, hit, surface, ground, yaw, night):
    """Colour of every hit.

    ``view`` (4, 3): origin, forward, and the global change of a depth-one ray per pixel to the right and down. ``rays``
    (N, 3) unit. ``pixel`` rad a pixel, ``span`` the part of a pixel that a ray stands for. ``hit``: body, face, distance,
    local, normal. ``surface``: albedo, texture, specular, emission of all faces. ``ground``: first face that is none,
    rasters of material, cover and tone, origin, resolution, albedo table, texture table. ``yaw`` (A,) of the bodies.
    Returns (N, 5): linear r, g, b, specular fraction, emission.
    """
    body, face, distance, local, normal = hit
    albedo, kinds, specular, emission = surface
    ground_faces, raster, cover, tone, origin, resolution, table, ground_kinds = ground
    out = np.zeros((len(rays), 5), np.float32)
    rasters = (raster, cover, tone, origin, resolution, table)
    ground_colors(view, rays, pixel, span, hit, ground_faces, rasters, out)
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
        kind, level = kinds[f], abs(n[2]) > 0.7
        if is_level_ground(body[i], f, n[2], ground_faces):
            row, column = int((y - origin[1]) / resolution), int((x - origin[0]) / resolution)
            inside = 0 <= row < raster.shape[0] and 0 <= column < raster.shape[1]
            kind = ground_kinds[raster[row, column]] if inside else ground_kinds[0]
        else:
            for c in range(3):
                o[c] = albedo[f, c]
            o[3], o[4] = specular[f], emission[f]
            if body[i] >= 0:
                cos, sin = np.cos(yaw[body[i]]), np.sin(yaw[body[i]])
                nx, ny = cos * nx + sin * ny, cos * ny - sin * nx
        across = max(np.hypot(nx, ny), 1e-6)
        u = x if level else (nx * y - ny * x) / across
        v = y if level else z
        if kind != _PLAIN:
            for c in range(3):
                rgb[c] = o[c]
            texture(kind, x, y, z, u, v, footprint * np.sqrt(min(slant, 12.0)), rgb, o, night)
    return out
