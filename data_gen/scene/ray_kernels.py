"""Loops over rays behind the queries of a scene: which rays concern which body, and whose hit is the nearest."""

import numpy as np

from data_gen.jobs.jit import jit

_BLOCK, _GROUP = 32, 1024
"""Rays that follow each other and are tested against a sphere as one cone: first many, then few."""


@jit
def keep_nearer(
    rays, prim, tfar, ng, moved_o, moved_d, cos, sin, index, start, max_range, distance, body, face, normal, local
):
    """Write one actor's hits where they are the nearest so far; returns how many rays met it at all."""
    met = 0
    for k in range(len(rays)):
        i, t = rays[k], tfar[k]
        if prim[k] < 0 or t >= max_range:
            continue
        met += 1
        if t >= distance[i]:
            continue
        distance[i], body[i], face[i] = t, index, prim[k] + start
        normal[i, 0] = cos[k] * ng[k, 0] - sin[k] * ng[k, 1]
        normal[i, 1] = sin[k] * ng[k, 0] + cos[k] * ng[k, 1]
        normal[i, 2] = ng[k, 2]
        for c in range(3):
            local[i, c] = moved_o[k, c] + moved_d[k, c] * t
    return met


@jit
def finish(origins, directions, distance, body, normal, local):
    """Local points of the static world's hits; normals to unit length, turned towards the ray's origin."""
    for i in range(len(distance)):
        length = max(np.sqrt(normal[i, 0] ** 2 + normal[i, 1] ** 2 + normal[i, 2] ** 2), np.float32(1e-12))
        along = normal[i, 0] * directions[i, 0] + normal[i, 1] * directions[i, 1] + normal[i, 2] * directions[i, 2]
        for c in range(3):
            normal[i, c] = (-normal[i, c] if along > 0 else normal[i, c]) / length
            if body[i] == -1:
                local[i, c] = origins[i, c] + directions[i, c] * distance[i]


@jit
def into_bodies(origins, directions, rays, which, position, cos, sin, each, bounds):
    """Of pairs of a ray and a body, those (K,) whose ray passes the body's bounding box ``bounds`` (A, 2, 3), with origins
    and directions (K, 3) in the body's frame. ``position``, ``cos`` and ``sin`` hold a pose for ``each`` pair, or else one a
    body."""
    kept = np.empty(len(rays), np.int64)
    moved_o = np.empty((len(rays), 3), np.float32)
    moved_d = np.empty((len(rays), 3), np.float32)
    n = 0
    for k in range(len(rays)):
        i, p = rays[k], k if each else which[k]
        x, y = origins[i, 0] - position[p, 0], origins[i, 1] - position[p, 1]
        moved_o[n, 0], moved_o[n, 1] = cos[p] * x + sin[p] * y, cos[p] * y - sin[p] * x
        moved_o[n, 2] = origins[i, 2] - position[p, 2]
        x, y = directions[i, 0], directions[i, 1]
        moved_d[n, 0], moved_d[n, 1] = cos[p] * x + sin[p] * y, cos[p] * y - sin[p] * x
        moved_d[n, 2] = directions[i, 2]
        enter, leave = np.float32(0.0), np.float32(np.inf)
        for c in range(3):
            d = moved_d[n, c]
            d = d if abs(d) > 1e-9 else np.float32(1e-9)
            a = (bounds[which[k], 0, c] - np.float32(1e-3) - moved_o[n, c]) / d
            b = (bounds[which[k], 1, c] + np.float32(1e-3) - moved_o[n, c]) / d
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
        if enter <= leave:
            kept[n] = k
            n += 1
    return kept[:n], moved_o[:n], moved_d[:n]


@jit
def passing(origins, directions, center, radius, max_range):
    """Pairs (sphere, ray), sorted by sphere, of rays that pass a sphere in front of them.

    A block of rays that follow each other, as neighbours in a picture do, is first tested against the sphere as one cone, and
    before it a group of blocks.
    """
    groups, blocks = _cones(origins, directions, _GROUP), _cones(origins, directions, _BLOCK)
    which = np.empty(len(center) * len(directions), np.int32)
    rays = np.empty(len(which), np.int32)
    count = 0
    for k in range(len(center)):
        cx, cy, cz, r = center[k, 0], center[k, 1], center[k, 2], radius[k]
        for b in range(len(blocks[2])):
            if b % (_GROUP // _BLOCK) == 0:
                group_apart = _apart(cx, cy, cz, r, groups, b // (_GROUP // _BLOCK))
            if group_apart or _apart(cx, cy, cz, r, blocks, b):
                continue
            for i in range(b * _BLOCK, min((b + 1) * _BLOCK, len(directions))):
                x, y, z = cx - origins[i, 0], cy - origins[i, 1], cz - origins[i, 2]
                along = x * directions[i, 0] + y * directions[i, 1] + z * directions[i, 2]
                if x * x + y * y + z * z - along * along < r * r and -r < along < max_range + r:
                    which[count], rays[count] = k, i
                    count += 1
    return which[:count].copy(), rays[:count].copy()


@jit
def _apart(cx, cy, cz, r, cones, b):
    """Whether no ray of cone ``b`` can pass the sphere of radius ``r`` about (cx, cy, cz)."""
    base, axis, sine, spread = cones
    x, y, z = cx - base[b, 0], cy - base[b, 1], cz - base[b, 2]
    along = x * axis[b, 0] + y * axis[b, 1] + z * axis[b, 2]
    square = x * x + y * y + z * z
    distance = np.sqrt(square)
    reach = distance * sine[b] + r + spread[b]  # sin(a + b) <= sin(a) + sin(b)
    return reach < distance and (along < 0 or square - along * along > reach * reach)


@jit
def _cones(origins, directions, size):
    """Of each ``size`` rays: mean origin (B, 3), mean direction (B, 3), the sine of the largest angle from it and the largest
    distance from the mean origin, both a little on the safe side."""
    blocks = (len(directions) + size - 1) // size
    base, axis = np.zeros((blocks, 3), np.float32), np.zeros((blocks, 3), np.float32)
    sine, spread = np.empty(blocks, np.float32), np.empty(blocks, np.float32)
    for b in range(blocks):
        start, stop = b * size, min((b + 1) * size, len(directions))
        for i in range(start, stop):
            for c in range(3):
                base[b, c] += origins[i, c] / np.float32(stop - start)
                axis[b, c] += directions[i, c]
        length = np.sqrt(axis[b, 0] ** 2 + axis[b, 1] ** 2 + axis[b, 2] ** 2)
        axis[b] /= max(length, np.float32(1e-6))
        cosine, far = np.float32(1.0), np.float32(0.0)
        for i in range(start, stop):
            ahead, square = np.float32(0.0), np.float32(0.0)
            for c in range(3):
                ahead += directions[i, c] * axis[b, c]
                square += (origins[i, c] - base[b, c]) ** 2
            cosine, far = min(cosine, ahead), max(far, square)
        sine[b] = min(np.sqrt(1 - cosine * cosine) + 1e-3, 1.0) if cosine > 0 else 1.0
        spread[b] = np.sqrt(far) + 1e-3
    return base, axis, sine, spread
