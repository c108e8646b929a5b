"""House fronts as a texture: bays of windows, shops, doors, in a style that follows from the house's own colour."""

import numpy as np

from data_gen.jobs.jit import jit
from data_gen.scene.noise import band, lattice, mix, octave2
from data_gen.world.buildings import BAY, STOREY

_ONCE = 1e3  # a period that never comes round


@jit
def _window(u, v, sill, width, height, footprint):
    """Share of the footprint within the bay's middle ``width`` and from ``sill`` up by ``height``."""
    return band(u, BAY, (BAY - width) / 2, width, footprint) * band(v, STOREY, sill, height, footprint)


@jit
def _shop(u, v, footprint, style, out):
    """Plate glass under a sign of dark blocks on a bright board; an entrance each few bays. Returns the fraction of glass."""
    front = band(u, BAY, 0.12, BAY - 0.24, footprint)
    glass = front * band(v, _ONCE, 0.45, 2.0, footprint)
    sign = band(v, _ONCE, 2.6, 0.5, footprint)
    tint = lattice(style, int(np.floor(u / (3 * BAY))), 3)  # a shop takes three bays
    mix(out, sign, 0.05 + 0.6 * tint, 0.08 + 0.5 * abs(0.6 - tint), 0.08 + 0.5 * (1 - tint))
    letter = int(np.floor(u / 0.34))
    inked = lattice(letter, style, 5) < 0.72 and 0.12 < (u / (3 * BAY)) % 1.0 < 0.80
    if inked:
        part = band(u, 0.34, 0.05, 0.24, footprint) * band(v, _ONCE, 2.71, 0.28, footprint)
        hole = band(u, 0.34, 0.12, 0.10, footprint) * band(
            v, _ONCE, 2.76 + 0.09 * lattice(letter, style, 6), 0.08, footprint
        )
        mix(out, part - hole, 0.75, 0.74, 0.70)
    return glass


@jit
def _door(u, v, footprint, style, out):
    """A door in some bays of the ground floor. Returns whether this bay has one."""
    if lattice(int(np.floor(u / BAY)), style, 7) > 0.34:
        return False
    leaf = band(u, BAY, 0.85, 1.1, footprint) * band(v, _ONCE, 0.05, 2.2, footprint)
    around = band(u, BAY, 0.73, 1.34, footprint) * band(v, _ONCE, 0.0, 2.37, footprint) - leaf
    pick = lattice(style, 0, 8)
    mix(out, around, 0.45, 0.44, 0.42)
    mix(out, leaf, 0.04 + 0.20 * (pick > 0.66), 0.05 + 0.09 * (0.33 < pick < 0.66), 0.04 + 0.05 * pick)
    return True


@jit
def facade(u, v, footprint, rgb, out, night):
    """Paint a wall in place. (u, v) metres along and up it; ``out`` holds r, g, b, specular, emission. ``rgb`` is the wall's
    colour; its last bits choose width and height of the windows, shutters, shops, plinth and ledges. Glass reflects, some
    rooms are lit at night."""
    style = int(rgb[0] * 16381) * 31 + int(rgb[1] * 16381)
    modern = lattice(style, 1, 11) < 0.16
    width = 2.4 if modern else 0.95 + 0.85 * lattice(style, 2, 11)
    height = 2.1 if modern else 1.3 + 0.6 * lattice(style, 3, 11)
    sill = 2.65 - height
    column, storey = int(np.floor(u / BAY)), int(np.floor(v / STOREY))

    wear = 1 + 0.10 * octave2(u, v, 2.5, footprint, 72) + 0.07 * octave2(u, v, 0.35, footprint, 73)
    wear -= 0.10 * max(octave2(u, 0.12 * v, 0.5, footprint, 75), 0.0)  # rain runs down
    wear -= 0.25 * band(v, _ONCE, 0.0, 0.6, footprint)
    if lattice(style, 4, 11) < 0.6:
        wear -= 0.22 * band(v, STOREY, 0.0, 0.16, footprint)
    for c in range(3):
        out[c] = rgb[c] * wear

    glass, lit, blind = 0.0, 0.02, 0.0
    if storey == 0 and lattice(style, 5, 11) < 0.45:
        glass, lit = _shop(u, v, footprint, style, out), 0.03
    elif storey != 0 or not _door(u, v, footprint, style, out):
        glass = _window(u, v, sill, width, height, footprint)
        frame = _window(u, v, sill - 0.09, width + 0.18, height + 0.18, footprint) - glass
        pale = 0.62 if lattice(style, 6, 11) < 0.7 else 0.10
        mix(out, min(frame, 1.0), pale, pale, pale * 0.96)
        if not modern and lattice(style, 7, 11) < 0.28:
            shutter = _window(u, v, sill, width + 0.9, height, footprint) - _window(
                u, v, sill, width + 0.1, height, footprint
            )
            tint = lattice(style, 8, 11)
            mix(out, max(shutter, 0.0), 0.05 + 0.14 * tint, 0.12 - 0.05 * tint, 0.05)
        mix(out, 0.7 * band(u, BAY, BAY / 2 - 0.03, 0.06, footprint) * glass, pale, pale, pale)
        lowered = lattice(column, storey, 71)  # how far the blind is down
        top = sill + height
        down = lowered * height
        blind = glass * (band(v, STOREY, top - down, down, footprint) if lowered > 0.66 else 0.0)
        blind = min(blind, glass)
    mix(out, glass - blind, 0.025, 0.032, 0.04)
    mix(out, blind, 0.42, 0.40, 0.36)
    out[3] = max(out[3], 0.45 * (glass - blind))
    if night and lattice(column, storey, 74) < (0.6 if storey == 0 else 0.3):
        out[4] = max(out[4], lit * glass)
        out[0], out[1], out[2] = out[0] + 0.5 * glass, out[1] + 0.36 * glass, out[2] + 0.18 * glass
