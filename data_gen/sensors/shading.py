"""Light on surfaces: sun, sky, the ground's bounce, lamps, mirror reflection of the sky, and the haze before it all."""

import numpy as np

from data_gen.jit import jit
from data_gen.sensors.noise import noise2, ramp
from data_gen.sensors.sky import gradient

_GROUND_ALBEDO = 0.13
LAMP_COLOR = (1.06, 1.0, 0.86)


@jit
def _lamps(p, n, lamps, reach):
    """Illuminance in lux at ``p`` on a face with normal ``n`` from lamps (L, 6): position, direction (cos, sin of yaw),
    candela. Low beam: +-20 degrees across, -1 to -15 degrees down, E = I cos / d^2."""
    total = 0.0
    for j in range(len(lamps)):
        dx, dy, dz = p[0] - lamps[j, 0], p[1] - lamps[j, 1], p[2] - lamps[j, 2]
        d2 = dx * dx + dy * dy + dz * dz + 0.3
        if d2 > reach * reach:
            continue
        d = np.sqrt(d2)
        along = dx * lamps[j, 3] + dy * lamps[j, 4]
        if along < 0.2:
            continue
        facing = -(n[0] * dx + n[1] * dy + n[2] * dz) / d
        if facing <= 0:
            continue
        across = (dy * lamps[j, 3] - dx * lamps[j, 4]) / along
        down = -dz / along
        wide = np.exp(-((across / 0.36) ** 2) * 1.4)
        high = 0.06 + 0.94 * ramp(-0.012, 0.018, down) * (1 - ramp(0.10, 0.34, down))
        total += lamps[j, 5] * wide * high * facing / d2
    return total


@jit
def shade(origin, rays, hit, paint, lit, open_sky, ground_faces, light, lamps, out):
    """Luminance (N, 3) in cd/m^2 of every hit as seen from ``origin``, written into ``out``; rows without a hit stay.

    ``hit``: body, face, distance, local, normal. ``paint`` (N, 5) of :func:`data_gen.sensors.textures.paint`. ``lit`` (N,)
    share of the sun that arrives, ``open_sky`` (N,) share of the sky that the ground sees. Lambert: L = albedo E / pi.
    Mirror: Schlick's rise of the specular share towards grazing. Haze (Koschmieder): t = exp(-extinction * distance).
    """
    body, face, distance, local, normal = hit
    sun = light.sun_direction
    bounce = np.empty(3)
    mirrored = np.empty(3)
    for c in range(3):
        bounce[c] = _GROUND_ALBEDO * (light.ambient[c] + light.sun[c] * max(sun[2], 0.0))
    p = np.empty(3)
    for i in range(len(rays)):
        if body[i] < -1:
            continue
        n, d = normal[i], rays[i]
        for c in range(3):
            p[c] = origin[c] + d[c] * distance[i]
        on_ground = body[i] == -1 and face[i] < ground_faces
        up = 0.5 + 0.5 * n[2]
        near_floor = open_sky[i] if on_ground else 0.45 + 0.55 * min(max(local[i, 2], 0.0) / 0.9, 1.0)
        facing_sun = max(n[0] * sun[0] + n[1] * sun[1] + n[2] * sun[2], 0.0) * lit[i]
        cosine = -(n[0] * d[0] + n[1] * d[1] + n[2] * d[2])
        share = paint[i, 3] * (0.22 + 0.78 * (1 - min(max(cosine, 0.0), 1.0)) ** 4)
        rx, ry, rz = d[0] + 2 * cosine * n[0], d[1] + 2 * cosine * n[1], d[2] + 2 * cosine * n[2]
        gradient(rz, light, mirrored)
        above = ramp(-0.02, 0.16, rz)  # below, the mirror shows what stands around: dark
        toward = rx * sun[0] + ry * sun[1] + rz * sun[2]
        glint = lit[i] * max(toward, 0.0) ** 160 * 18.0
        street = 1.0 + 0.55 * noise2(p[0] / 16.0, p[1] / 16.0, 91) if light.night else 1.0
        lamp = _lamps(p, n, lamps, 90.0)
        t = np.exp(-light.extinction * distance[i])
        for c in range(3):
            lux = (light.ambient[c] * up * street + bounce[c] * (1 - up)) * near_floor + light.sun[c] * facing_sun
            lux += lamp * LAMP_COLOR[c]
            around = bounce[c] / np.pi * 0.8
            mirror = (mirrored[c] * above + around * (1 - above)) * near_floor + light.sun[c] / np.pi * glint
            glow = paint[i, 4] * 1000.0 / np.pi * paint[i, c]
            value = paint[i, c] * lux / np.pi * (1 - share) + share * mirror + glow
            out[i, c] = value * t + light.horizon[c] * (1 - t)
