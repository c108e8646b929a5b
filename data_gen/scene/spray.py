"""Spray: the plumes of water that wheels throw up behind fast vehicles on a wet road, one field for all three sensors.

A plume is a wedge that trails its vehicle and grows backwards. Its extinction falls with the distance from the tyres (as the
drops settle), towards its sides and towards its top, and is patchy: the patches hang in the air while the wedge moves on.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_gen.jobs.jit import jit
from data_gen.scene.noise import noise3
from data_gen.scene.ray_cones import passing
from data_gen.scene.scene import Scene, kernel_rays

Array = NDArray[np.float64]

LEAST_SPEED = 8.0
"""Speed in m/s from which tyres throw a plume."""
EXTINCTION = 0.3
"""1/m at the tyres of a car at 25 m/s on 1 mm of water."""
THROWN = {"truck": 2.0, "bus": 2.0, "trailer": 2.0, "motorcycle": 0.4, "bicycle": 0.1}
"""Times as much as by a car."""
PATCH = 0.8
"""Metres of one patch."""
CONTRAST = 1.8
"""How much thicker than the mean the thickest patch is."""


class Plumes(NamedTuple):
    """Plumes at one time, in the global frame; widths and heights are those at the tyres and at the far end."""

    origin: Array  # (P, 3) the point on the ground between the rear tyres
    axis: Array  # (P, 2) unit, backwards from the travel
    length: Array  # (P,) metres
    half_width: Array  # (P, 2) metres
    height: Array  # (P, 2) metres
    extinction: Array  # (P,) 1/m at the origin
    speed: Array  # (P, 2) velocity of the vehicle in m/s


def plumes_at(scene: Scene, t: float) -> Plumes:
    """The plumes of all vehicles but the ego at ``t`` seconds; none on a dry road and where the condition has no spray.

    Length 0.4 s x v within 3 .. 15 m; extinction 0.3/m x (film / 1 mm) (v / 25 m/s)^2, more behind large vehicles. The rear
    tyres are a sixth of the vehicle's length before its end; the plume rises to 2 m behind a car, 3 m behind a truck.
    """
    film = scene.condition.water_film
    vehicles = []
    if scene.condition.spray and scene.wetness.feeds_spray:
        moving = [actor for actor in scene.actors if actor.track.velocity.any()]
        vehicles = [actor for actor in moving if actor.asset.category.startswith("vehicle.")]
    states = [actor.track.at(t) for actor in vehicles]
    position = np.array([position for position, _, _ in states]).reshape(-1, 3)
    velocity = np.array([velocity[:2] for _, _, velocity in states]).reshape(-1, 2)
    size = np.array([actor.asset.size for actor in vehicles], float).reshape(-1, 3)
    thrown = np.array([THROWN.get(actor.asset.category.split(".")[1], 1.0) for actor in vehicles])
    speed = np.linalg.norm(velocity, axis=1)
    fast = speed > LEAST_SPEED
    position, velocity, size, thrown, speed = (a[fast] for a in (position, velocity, size, thrown, speed))
    back, (length, width, tall) = -velocity / speed[:, None], size.T
    return Plumes(
        origin=position + np.pad(back * length[:, None] / 3, ((0, 0), (0, 1))),
        axis=back,
        length=np.clip(0.4 * speed, 3.0, 15.0),
        half_width=np.stack([width / 2, width / 2 + 0.6], axis=1),
        height=np.stack([0.5 * tall, np.minimum(1.2 * tall, 1.2 + 0.5 * tall)], axis=1),
        extinction=EXTINCTION * film * (speed / 25.0) ** 2 * thrown,
        speed=velocity,
    )


def optical_depth(
    plumes: Plumes, origins: ArrayLike, directions: ArrayLike, distances: ArrayLike, dt: ArrayLike = 0.0
) -> Array:
    """Integral of the extinction (N,) along rays with ``origins`` (N, 3) or (3,) and unit ``directions`` (N, 3) from 0 to
    ``distances`` (N,) or a scalar, in metres. ``dt`` (N,) or a scalar: seconds of each ray after the plumes' time."""
    return penetrate(plumes, origins, directions, distances, np.inf, dt)[0]


def penetrate(
    plumes: Plumes,
    origins: ArrayLike,
    directions: ArrayLike,
    distances: ArrayLike,
    depth: ArrayLike,
    dt: ArrayLike = 0.0,
) -> tuple[Array, Array]:
    """:func:`optical_depth` (N,), and the distance (N,) at which it reaches ``depth`` (N,) or a scalar, inf where it does not.

    With ``depth`` sampled from an exponential distribution of mean 1 / k, that is the distance of the first event of a process
    that happens with k times the extinction per metre. Plumes are passed in the order of their distance.
    """
    origins, directions = kernel_rays(origins, directions)
    count = len(directions)
    tau, stop = np.zeros(count), np.full(count, np.inf)
    if not count or not len(plumes.length):
        return tau, stop
    distances, depth, dt = (np.array(np.broadcast_to(v, (count,)), float) for v in (distances, depth, dt))
    order = np.argsort(np.linalg.norm(plumes.origin - origins.mean(axis=0), axis=1), kind="stable")
    plumes = Plumes(*(np.ascontiguousarray(field[order]) for field in plumes))
    # A sphere about the middle of each wedge, wide enough for its motion within the rays' times.
    middle, half_span = (dt.max() + dt.min()) / 2, (dt.max() - dt.min()) / 2
    center = plumes.origin.copy()
    center[:, :2] += plumes.axis * plumes.length[:, None] / 2 + plumes.speed * middle
    center[:, 2] += plumes.height[:, 1] / 2
    radius = np.sqrt((plumes.length / 2) ** 2 + plumes.half_width[:, 1] ** 2 + (plumes.height[:, 1] / 2) ** 2)
    radius += np.linalg.norm(plumes.speed, axis=1) * half_span
    near = passing(
        origins, directions, center.astype(np.float32), radius.astype(np.float32), np.float32(distances.max())
    )
    _penetrate(*near, origins, directions, distances, depth, dt, *plumes, tau, stop)
    return tau, stop


@jit
def _penetrate(
    which, rays, origins, directions, distances, depth, dt, origin, axis, length, half_width, height, extinction, speed,
    tau, stop,
):  # fmt: skip
    for k in range(len(which)):
        p, i = which[k], rays[k]
        # The ray in the wedge's frame: x backwards along the axis, y to its left, z up.
        gx = origins[i, 0] - origin[p, 0] - speed[p, 0] * dt[i]
        gy = origins[i, 1] - origin[p, 1] - speed[p, 1] * dt[i]
        x, dx = gx * axis[p, 0] + gy * axis[p, 1], directions[i, 0] * axis[p, 0] + directions[i, 1] * axis[p, 1]
        y, dy = gy * axis[p, 0] - gx * axis[p, 1], directions[i, 1] * axis[p, 0] - directions[i, 0] * axis[p, 1]
        z, dz = origins[i, 2] - origin[p, 2], float(directions[i, 2])
        widens = (half_width[p, 1] - half_width[p, 0]) / length[p]
        rises = (height[p, 1] - height[p, 0]) / length[p]
        side, top = half_width[p, 0] + widens * x, height[p, 0] + rises * x
        enter, leave = _clip(-x, -dx, 0.0, distances[i])
        enter, leave = _clip(x - length[p], dx, enter, leave)
        enter, leave = _clip(y - side, dy - widens * dx, enter, leave)
        enter, leave = _clip(-y - side, -dy - widens * dx, enter, leave)
        enter, leave = _clip(-z, -dz, enter, leave)
        enter, leave = _clip(z - top, dz - rises * dx, enter, leave)
        if enter >= leave:
            continue
        steps = min(max(int((leave - enter) / (PATCH / 3)), 4), 32)
        step = (leave - enter) / steps
        for n in range(steps):
            s = enter + (n + 0.5) * step
            u = (x + s * dx) / length[p]
            a, b = (y + s * dy) / (side + s * widens * dx), (z + s * dz) / (top + s * rises * dx)
            patch = 1.0 + CONTRAST * noise3(
                (origins[i, 0] + s * directions[i, 0]) / PATCH,
                (origins[i, 1] + s * directions[i, 1]) / PATCH,
                (origins[i, 2] + s * directions[i, 2]) / PATCH,
                71,
            )
            gain = np.exp(-2.0 * u) * (1 - u**4) * (1 - a * a) * (1 - b * b) * max(patch, 0.0) * extinction[p] * step
            if tau[i] < depth[i] <= tau[i] + gain:
                stop[i] = enter + (n + (depth[i] - tau[i]) / gain) * step
            tau[i] += gain


@jit
def _clip(value, slope, enter, leave):
    """The part of [enter, leave] in which value + slope * s <= 0."""
    if slope > 1e-12:
        return enter, min(leave, -value / slope)
    if slope < -1e-12:
        return max(enter, -value / slope), leave
    return (enter, leave) if value <= 0 else (enter, enter)
