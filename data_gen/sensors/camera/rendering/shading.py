"""Light on surfaces: sun, sky, the ground's bounce, lamps, mirror reflection, and the haze before it all."""

import numpy as np

from data_gen.jobs.jit import jit
from data_gen.scene.light import airlight, gradient
from data_gen.scene.noise import ramp
from data_gen.sensors.camera.rendering.lamps import LAMP_COLOR, add_street_lux, beam_lux, sent
from data_gen.sensors.camera.rendering.wet_road import fresnel, glitter

_MEAN_GROUND_ALBEDO = 0.13
"""Of the ground as a whole, for the light that it throws up on what stands on it."""
_STREET_EMISSION = 20.0
"""Emission from which a face of the static world is a street lamp's."""


@jit
def _glow(paint, body, gain):
    """Luminance per unit of albedo of a face that shines; ``gain`` as in ``lamps.Lamps``."""
    if paint[4] <= 0:
        return 0.0
    second = paint[4] > _STREET_EMISSION if body < 0 else paint[0] > 4 * paint[1]
    return paint[4] * 1000.0 / np.pi * gain[body, 1 if second else 0]


@jit
def _add_glitter(p, d, covered, lit, light, points, out):
    """Sun and lamps on the ripples of a road at ``p`` of which water covers the fraction ``covered``, seen along ``d``,
    added to ``out`` (3,)."""
    sun = light.sun_direction
    sparkle = lit * glitter(d, sun[0], sun[1], sun[2], covered) if lit > 0 else 0.0
    for c in range(3):
        out[c] += light.sun[c] * sparkle
    position, axis, flux = points
    for j in range(len(position)):
        x, y, z = position[j, 0] - p[0], position[j, 1] - p[1], position[j, 2] - p[2]
        distance = np.sqrt(x * x + y * y + z * z)
        x, y, z = x / distance, y / distance, z / distance
        sparkle = glitter(d, x, y, z, covered)
        if sparkle > 0:
            sparkle *= sent(-x, -y, -z, axis[j]) / (distance * distance)
            for c in range(3):
                out[c] += flux[j, c] * sparkle


@jit
def shade(at, rays, hit, paint, lit, open_sky, mirror, ground_faces, light, lamps, out):
    """Luminance (N, 3) in cd/m^2 of every hit ``at`` global points (N, 3), written into ``out``; rows without a hit stay.

    ``hit``: body, face, distance, local, normal. ``paint`` (N, 5) of ``textures.paint``. ``lit`` (N,) fraction of
    the sun that arrives, ``open_sky`` (N,) fraction of the sky that the ground sees; ``mirror`` (N, 3) what a wet ground
    mirrors (never read where it is dry). Lambert: L = albedo E / pi. Mirror: Schlick's rise of the specular fraction towards
    grazing. Haze (Koschmieder): t = exp(-extinction * distance).
    """
    body, face, distance, local, normal = hit
    beams, street, points, gain = lamps
    sun = light.sun_direction
    bounce, level = np.empty(3), np.empty(3)
    for c in range(3):
        level[c] = light.ambient[c] + light.street[c]
        bounce[c] = _MEAN_GROUND_ALBEDO * (level[c] + light.sun[c] * max(sun[2], 0.0))
    air, lux, mirrored = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(rays)):
        if body[i] < -1:
            continue
        n, d, p = normal[i], rays[i], at[i]
        on_ground = body[i] == -1 and face[i] < ground_faces
        up = 0.5 + 0.5 * n[2]
        near_floor = open_sky[i] if on_ground else 0.45 + 0.55 * min(max(local[i, 2], 0.0) / 0.9, 1.0)
        facing_sun = max(n[0] * sun[0] + n[1] * sun[1] + n[2] * sun[2], 0.0) * lit[i]
        cosine = -(n[0] * d[0] + n[1] * d[1] + n[2] * d[2])
        beam = beam_lux(p, n, beams)
        for c in range(3):
            lux[c] = (
                (level[c] * up + bounce[c] * (1 - up)) * near_floor + light.sun[c] * facing_sun + beam * LAMP_COLOR[c]
            )
            mirrored[c] = 0.0
        add_street_lux(p, n, street, lux)
        specular = 0.0
        if on_ground and paint[i, 3] > 0:
            specular = paint[i, 3] * fresnel(cosine)
            for c in range(3):
                mirrored[c] = specular * mirror[i, c]
            _add_glitter(p, d, paint[i, 3], lit[i], light, points, mirrored)
        elif paint[i, 3] > 0:
            specular = paint[i, 3] * (0.22 + 0.78 * (1 - min(max(cosine, 0.0), 1.0)) ** 4)
            rx, ry, rz = d[0] + 2 * cosine * n[0], d[1] + 2 * cosine * n[1], d[2] + 2 * cosine * n[2]
            gradient(rx, ry, rz, light, mirrored)
            above = ramp(-0.02, 0.16, rz)  # below, the mirror shows what stands around: dark
            toward = rx * sun[0] + ry * sun[1] + rz * sun[2]
            glint = lit[i] * toward**500 * 45.0 if toward > 0.95 else 0.0
            for c in range(3):
                around = bounce[c] / np.pi * 0.8
                mirrored[c] = (mirrored[c] * above + around * (1 - above)) * near_floor + light.sun[c] / np.pi * glint
                mirrored[c] *= specular
        glow = _glow(paint[i], body[i], gain)
        t = np.exp(-light.extinction * distance[i])
        airlight(d[0], d[1], d[2], light, air)
        for c in range(3):
            value = paint[i, c] * (lux[c] / np.pi * (1 - specular) + glow) + mirrored[c]
            out[i, c] = value * t + air[c] * (1 - t)
