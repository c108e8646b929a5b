"""Loops over rays behind the queries of a scene: what each ray meets, and whose hit is the nearest."""

import numpy as np

from data_gen.jobs.jit import jit
from data_gen.scene.embree import PACKET, aim, intersect, occluded, packet

_SLACK = np.float32(0.01)
"""Metres by which a box is taken to begin nearer: it is a little smaller than what its body's triangles round to."""


@jit
def meet_world(tree, origins, directions, max_range, distance, body, face, normal):
    """Write what each ray meets of the static world within ``max_range`` to ``distance``, ``body``, ``face`` and ``normal``,
    which are set for rays that meet nothing."""
    rays, ids = packet()
    for first in range(0, len(directions), PACKET):
        count = min(PACKET, len(directions) - first)
        for k in range(count):
            o, d = origins[first + k], directions[first + k]
            aim(rays, k, o[0], o[1], o[2], d[0], d[1], d[2], max_range)
        intersect(tree, rays, ids, count)
        for k in range(count):
            if ids[17, k] >= 0 and rays[8, k] < max_range:
                i = first + k
                distance[i], body[i], face[i] = rays[8, k], -1, ids[17, k]
                for c in range(3):
                    normal[i, c] = rays[12 + c, k]


@jit
def meet_bodies(
    trees, starts, origins, directions, which, at, pose, position, cos, sin, bounds, max_range, counted, distance, body,
    face, normal, local,
):  # fmt: skip
    """Write the hits of bodies where they are the nearest so far; returns how many rays would meet each body (A,), had nothing
    stood in the way, if that is to be ``counted``.

    ``trees`` (A,) and ``starts`` (A,): each body's tree and its first face. Pairs of a body ``which`` (K,), in order, and a ray
    ``at`` (K,) are cast if the ray passes the body's box ``bounds`` (A, 2, 3). ``pose`` (K,) is the body's at that ray's time,
    an index of ``position``, ``cos`` and ``sin``.
    """
    met = np.zeros(len(trees), np.int64)
    near, near_ids = packet()
    hidden, hidden_ids = packet()
    queue, turn = np.empty(PACKET, np.int64), np.empty((PACKET, 2), np.float32)
    waiting = behind = 0
    for k in range(len(which)):
        i, b, p = at[k], which[k], pose[k]
        ox, oy, oz, dx, dy, dz, enter, leave = _into_body(
            origins[i], directions[i], position[p], cos[p], sin[p], bounds[b]
        )
        if enter <= leave:
            if enter < distance[i] + _SLACK:
                aim(near, waiting, ox, oy, oz, dx, dy, dz, max_range)
                queue[waiting], turn[waiting, 0], turn[waiting, 1] = i, cos[p], sin[p]
                waiting += 1
            elif counted:
                aim(hidden, behind, ox, oy, oz, dx, dy, dz, max_range)
                behind += 1
        last = k + 1 == len(which) or which[k + 1] != b
        if behind == PACKET or (last and behind):
            occluded(trees[b], hidden, hidden_ids, behind)
            for j in range(behind):
                met[b] += hidden[8, j] < 0
            behind = 0
        if waiting == PACKET or (last and waiting):
            intersect(trees[b], near, near_ids, waiting)
            for j in range(waiting):
                i, t = queue[j], near[8, j]
                if near_ids[17, j] < 0 or t >= max_range:
                    continue
                met[b] += 1
                if t >= distance[i]:
                    continue
                distance[i], body[i], face[i] = t, b, near_ids[17, j] + starts[b]
                normal[i, 0] = turn[j, 0] * near[12, j] - turn[j, 1] * near[13, j]
                normal[i, 1] = turn[j, 1] * near[12, j] + turn[j, 0] * near[13, j]
                normal[i, 2] = near[14, j]
                for c in range(3):
                    local[i, c] = near[c, j] + near[4 + c, j] * t
            waiting = 0
    return met


@jit
def blocked_by_world(tree, origins, directions, limit, blocked):
    """Set ``blocked`` where a ray meets the static world nearer than ``limit``."""
    rays, ids = packet()
    for first in range(0, len(directions), PACKET):
        count = min(PACKET, len(directions) - first)
        for k in range(count):
            o, d = origins[first + k], directions[first + k]
            aim(rays, k, o[0], o[1], o[2], d[0], d[1], d[2], limit[first + k])
        occluded(tree, rays, ids, count)
        for k in range(count):
            blocked[first + k] = rays[8, k] < 0


@jit
def blocked_by_bodies(trees, origins, directions, limit, which, at, pose, position, cos, sin, bounds, blocked):
    """The same for bodies, of those rays that nothing has blocked yet. Pairs and poses as in :func:`meet_bodies`."""
    rays, ids = packet()
    queue = np.empty(PACKET, np.int64)
    waiting = 0
    for k in range(len(which)):
        i, b, p = at[k], which[k], pose[k]
        if not blocked[i]:
            ox, oy, oz, dx, dy, dz, enter, leave = _into_body(
                origins[i], directions[i], position[p], cos[p], sin[p], bounds[b]
            )
            if enter <= leave and enter < limit[i] + _SLACK:
                aim(rays, waiting, ox, oy, oz, dx, dy, dz, limit[i])
                queue[waiting] = i
                waiting += 1
        if waiting == PACKET or (waiting and (k + 1 == len(which) or which[k + 1] != b)):
            occluded(trees[b], rays, ids, waiting)
            for j in range(waiting):
                blocked[queue[j]] = rays[8, j] < 0
            waiting = 0


@jit
def _into_body(o, d, position, cos, sin, bounds):
    """Origin and direction of a ray in a body's frame, and from where to where on it its bounding box (2, 3) extends."""
    x, y = o[0] - position[0], o[1] - position[1]
    ox, oy, oz = cos * x + sin * y, cos * y - sin * x, o[2] - position[2]
    dx, dy, dz = cos * d[0] + sin * d[1], cos * d[1] - sin * d[0], d[2]
    enter, leave = np.float32(0.0), np.float32(np.inf)
    enter, leave = _slab(ox, dx, bounds[0, 0], bounds[1, 0], enter, leave)
    enter, leave = _slab(oy, dy, bounds[0, 1], bounds[1, 1], enter, leave)
    enter, leave = _slab(oz, dz, bounds[0, 2], bounds[1, 2], enter, leave)
    return ox, oy, oz, dx, dy, dz, enter, leave


@jit
def _slab(o, d, low, high, enter, leave):
    d = d if abs(d) > np.float32(1e-9) else np.float32(1e-9)
    a, b = (low - np.float32(1e-3) - o) / d, (high + np.float32(1e-3) - o) / d
    return max(enter, min(a, b)), min(leave, max(a, b))


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
