"""Which rays pass which spheres: rays that follow each other are first tested together, as a cone."""

import numpy as np

from data_gen.jobs.jit import jit

_BLOCK, _GROUP = 32, 32
"""Rays that follow each other and are tested against a sphere as one cone, and blocks of them that are before."""


@jit
def passing(origins, directions, center, radius, max_range):
    """Pairs (sphere, ray), sorted by sphere, of rays that pass a sphere in front of them.

    A block of rays that follow each other, as neighbours in a picture do, is first tested against the sphere as one cone and,
    seen from above, as one wedge: a LiDAR's column is high, but narrow. Before it, a group of blocks is.
    """
    blocks = _cones(origins, directions)
    groups = _around(blocks)
    which, rays = np.empty(4096, np.int32), np.empty(4096, np.int32)
    count = 0
    for k in range(len(center)):
        cx, cy, cz, r = center[k, 0], center[k, 1], center[k, 2], radius[k]
        for b in range(len(blocks)):
            if b % _GROUP == 0:
                group_apart = _apart(cx, cy, cz, r, groups[b // _GROUP])
            if group_apart or _apart(cx, cy, cz, r, blocks[b]):
                continue
            if count + _BLOCK > len(which):
                which, rays = np.append(which, which), np.append(rays, rays)
            for i in range(b * _BLOCK, min((b + 1) * _BLOCK, len(directions))):
                x, y, z = cx - origins[i, 0], cy - origins[i, 1], cz - origins[i, 2]
                along = x * directions[i, 0] + y * directions[i, 1] + z * directions[i, 2]
                if x * x + y * y + z * z - along * along < r * r and -r < along < max_range + r:
                    which[count], rays[count] = k, i
                    count += 1
    return which[:count].copy(), rays[:count].copy()


@jit
def _apart(cx, cy, cz, r, cone):
    """Whether no ray of a cone can pass the sphere of radius ``r`` about (cx, cy, cz)."""
    x, y, z = cx - cone[0], cy - cone[1], cz - cone[2]
    r += cone[_SPREAD]
    return _outside(x * x + y * y + z * z, x * cone[3] + y * cone[4] + z * cone[5], cone[_SINE], r) or _outside(
        x * x + y * y, x * cone[6] + y * cone[7], cone[_LEVEL_SINE], r
    )


@jit
def _outside(square, along, sine, r):
    distance = np.sqrt(square)
    reach = distance * sine + r  # sin(a + b) <= sin(a) + sin(b)
    return reach < distance and (along < 0 or square - along * along > reach * reach)


_SINE, _LEVEL_SINE, _SPREAD = 8, 9, 10
"""Columns of :func:`_cones` after the mean origin and the mean directions in space and from above."""


@jit
def _cones(origins, directions):
    """Of each block of rays (B, 11): mean origin, mean direction, mean direction seen from above, the sines of the largest
    angles from either, and the largest distance from the mean origin, all three a little on the safe side."""
    out = np.zeros(((len(directions) + _BLOCK - 1) // _BLOCK, 11), np.float32)
    level = np.empty(_BLOCK, np.float32)
    for b in range(len(out)):
        cone, first, count = out[b], b * _BLOCK, min(_BLOCK, len(directions) - b * _BLOCK)
        share = np.float32(1.0) / np.float32(count)
        for k in range(count):
            d, o = directions[first + k], origins[first + k]
            level[k] = np.float32(1.0) / max(np.sqrt(d[0] * d[0] + d[1] * d[1]), np.float32(1e-6))
            for c in range(3):
                cone[c] += o[c] * share
                cone[3 + c] += d[c]
            for c in range(2):
                cone[6 + c] += d[c] * level[k]
        _to_unit(cone)
        cosine, level_cosine, far = np.float32(1.0), np.float32(1.0), np.float32(0.0)
        for k in range(count):
            d, o = directions[first + k], origins[first + k]
            x, y, z = o[0] - cone[0], o[1] - cone[1], o[2] - cone[2]
            cosine = min(cosine, d[0] * cone[3] + d[1] * cone[4] + d[2] * cone[5])
            # A ray that stands upright has no side.
            towards = (d[0] * cone[6] + d[1] * cone[7]) * level[k] if level[k] < 1e3 else np.float32(-1.0)
            level_cosine, far = min(level_cosine, towards), max(far, x * x + y * y + z * z)
        cone[_SINE], cone[_LEVEL_SINE], cone[_SPREAD] = _sine(cosine), _sine(level_cosine), np.sqrt(far) + 1e-3
    return out


@jit
def _around(cones):
    """The same of each group of blocks, from their cones."""
    out = np.zeros(((len(cones) + _GROUP - 1) // _GROUP, 11), np.float32)
    for g in range(len(out)):
        around, parts = out[g], cones[g * _GROUP : (g + 1) * _GROUP]
        for part in parts:
            for c in range(8):
                around[c] += part[c] / np.float32(len(parts)) if c < 3 else part[c]
        _to_unit(around)
        angle, level_angle, far = 0.0, 0.0, 0.0
        for part in parts:
            cosine, level_cosine, square = 0.0, 0.0, 0.0
            for c in range(3):
                cosine += part[3 + c] * around[3 + c]
                square += (part[c] - around[c]) ** 2
            for c in range(2):
                level_cosine += part[6 + c] * around[6 + c]
            angle = max(angle, np.arccos(min(cosine, 1.0)) + np.arcsin(part[_SINE]))
            level_angle = max(level_angle, np.arccos(min(level_cosine, 1.0)) + np.arcsin(part[_LEVEL_SINE]))
            far = max(far, np.sqrt(square) + part[_SPREAD])
        around[_SINE], around[_LEVEL_SINE] = _sine(np.cos(angle)), _sine(np.cos(level_angle))
        around[_SPREAD] = far + 1e-3
    return out


@jit
def _to_unit(cone):
    length = max(np.sqrt(cone[3] ** 2 + cone[4] ** 2 + cone[5] ** 2), np.float32(1e-6))
    level = max(np.sqrt(cone[6] ** 2 + cone[7] ** 2), np.float32(1e-6))
    for c in range(3):
        cone[3 + c] /= length
    for c in range(2):
        cone[6 + c] /= level


@jit
def _sine(cosine):
    return min(np.sqrt(1 - cosine * cosine) + 1e-3, 1.0) if cosine > 0 else 1.0
