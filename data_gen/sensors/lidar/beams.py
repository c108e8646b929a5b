"""Loops over the rays of a sweep: where each leaves, what the surface that it met sends back, where that is taken to lie."""

import numpy as np

from data_gen.jobs.jit import jit
from data_gen.sensors.lidar.power import film_loss, rough_cosine, signal_to_noise

RETRO = 0.85
"""Reflectivity from which a surface is retro-reflective sheeting, reported up to 255 where diffuse per cent end at 100."""

_film_loss, _rough_cosine, _signal_to_noise = (jit(law) for law in (film_loss, rough_cosine, signal_to_noise))


@jit
def leave(in_sensor, ego_T_sensor, position, yaw):
    """Origins and directions (N, 3) in the global frame of rays with the unit directions ``in_sensor`` (N, 3), each from an ego
    at its ``position`` (N, 3) and ``yaw`` (N,)."""
    origins, directions = np.empty((len(yaw), 3)), np.empty((len(yaw), 3))
    for i in range(len(yaw)):
        cos, sin, d = np.cos(yaw[i]), np.sin(yaw[i]), in_sensor[i]
        x, y, z = _turned(ego_T_sensor, d[0], d[1], d[2])
        directions[i, 0], directions[i, 1], directions[i, 2] = cos * x - sin * y, sin * x + cos * y, z
        x, y = ego_T_sensor[0, 3], ego_T_sensor[1, 3]
        origins[i, 0], origins[i, 1] = position[i, 0] + (cos * x - sin * y), position[i, 1] + (sin * x + cos * y)
        origins[i, 2] = position[i, 2] + ego_T_sensor[2, 3]
    return origins, directions


@jit
def compensated(in_sensor, distance, ego_T_sensor, position, yaw, sensor_T_global):
    """Points (N, 3) in the frame that ``sensor_T_global`` leads to, at a ``distance`` (N,) along the rays of :func:`leave`."""
    points = np.empty((len(yaw), 3), np.float32)
    for i in range(len(yaw)):
        cos, sin, d, r = np.cos(yaw[i]), np.sin(yaw[i]), in_sensor[i], distance[i]
        x, y, z = _turned(ego_T_sensor, d[0] * r, d[1] * r, d[2] * r)
        x, y, z = x + ego_T_sensor[0, 3], y + ego_T_sensor[1, 3], z + ego_T_sensor[2, 3]
        x, y, z = position[i, 0] + (cos * x - sin * y), position[i, 1] + (sin * x + cos * y), position[i, 2] + z
        x, y, z = _turned(sensor_T_global, x, y, z)
        points[i, 0], points[i, 1] = x + sensor_T_global[0, 3], y + sensor_T_global[1, 3]
        points[i, 2] = z + sensor_T_global[2, 3]
    return points


@jit
def _turned(a_T_b, x, y, z):
    return (
        a_T_b[0, 0] * x + a_T_b[0, 1] * y + a_T_b[0, 2] * z,
        a_T_b[1, 0] * x + a_T_b[1, 1] * y + a_T_b[1, 2] * z,
        a_T_b[2, 0] * x + a_T_b[2, 1] * y + a_T_b[2, 2] * z,
    )


@jit
def echoed(hit, directions, reflectivities, ground, water, extinction, max_range):
    """Ray, distance, SNR, calibrated reflectivity and body of what each surface that was met sends back: P = reflectivity x
    cos(incidence) x e^(-2 a r) / r^2.

    ``hit``: body, face, distance, local, normal. ``reflectivities`` (F,) of all faces; ``ground``: first face that is none,
    raster of material, origin, resolution, reflectivities of its materials; ``water``: which of them hold no film, and the
    fraction of the others that water covers, 0 where there is none.
    """
    body, face, distance, local, normal = hit
    ground_faces, raster, origin, resolution, of_material = ground
    absorbing, covered = water
    ray, range_ = np.empty(len(body), np.int64), np.empty(len(body))
    snr, byte, owner = np.empty(len(body)), np.empty(len(body)), np.empty(len(body), np.int32)
    n = 0
    for i in range(len(body)):
        if body[i] < -1:
            continue
        r, reflectivity, cosine = np.float64(distance[i]), np.float64(reflectivities[face[i]]), 0.0
        for c in range(3):
            cosine += normal[i, c] * directions[i, c]
        cosine = abs(cosine)
        if face[i] < ground_faces:
            row = int(np.floor((np.float64(local[i, 1]) - origin[1]) / resolution))
            column = int(np.floor((np.float64(local[i, 0]) - origin[0]) / resolution))
            inside = 0 <= row < raster.shape[0] and 0 <= column < raster.shape[1]
            material = raster[row, column] if inside else 0
            reflectivity = np.float64(of_material[material])
            if covered > 0 and not absorbing[material]:
                reflectivity *= _film_loss(cosine, covered)
            cosine = _rough_cosine(cosine)
        transmission = np.exp(-2 * extinction * r)
        ray[n], range_[n], owner[n] = i, r, body[i]
        snr[n] = _signal_to_noise(reflectivity * cosine * transmission, r, max_range)
        # The byte is calibrated for range, not for weather; it keeps some of the incidence angle.
        byte[n] = (100.0 if reflectivity < RETRO else 255.0) * reflectivity * np.sqrt(cosine) * transmission
        n += 1
    return ray[:n], range_[:n], snr[:n], byte[:n], owner[:n]
