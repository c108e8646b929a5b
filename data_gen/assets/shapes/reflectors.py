"""Where bodies reflect at 77 GHz: corners, bumpers, wheel houses, plates, each with outward normal and mean RCS."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from data_gen.assets.shapes.mesh import Scatterers

Size = tuple[float, float, float]


def points(position: ArrayLike, rcs: ArrayLike, normal: ArrayLike = (0.0, 0.0, 0.0)) -> Scatterers:
    """Reflectors at (S, 3) of ``rcs`` dBsm each (a number or S), seen from every side unless a ``normal`` is given."""
    position = np.atleast_2d(np.asarray(position, np.float32))
    normal = np.broadcast_to(np.asarray(normal, np.float32), position.shape).copy()
    return Scatterers(position, normal, np.broadcast_to(np.asarray(rcs, np.float32), len(position)).copy())


def cloud(positions: ArrayLike, total: float) -> Scatterers:
    """Reflectors seen from every side that share ``total`` dBsm evenly: people, cones, trees."""
    positions = np.atleast_2d(np.asarray(positions, np.float32))
    return points(positions, total - 10 * np.log10(len(positions)))


def body(
    size: Size, *, end: float, side: float, wheels: Sequence[float], height: float = 0.6, spacing: float = 1.75
) -> Scatterers:
    """A vehicle: seen end on its visible points sum to ``end`` dBsm, broadside to ``side``.

    End on: the bumper's centre has half the power, each corner a quarter. Broadside: the corners keep theirs, the
    wheel houses at x = ``wheels`` have 40 % of the rest and plates every ``spacing`` metres the other 60 %.
    """
    half_length, half_width = size[0] / 2, size[1] / 2
    front, flank = 10 ** (end / 10), 10 ** (side / 10)
    corner = np.array([(a * half_length, b * half_width, height) for a in (1, -1) for b in (1, -1)])
    bumper = np.array([(a * half_length, 0, 0.9 * height) for a in (1, -1)])
    houses = np.array([(x, b * half_width, 0.5 * height) for x in wheels for b in (1, -1)])
    count = max(1, round((size[0] - 1.0) / spacing))
    along = (np.arange(count) + 0.5) / count * (size[0] - 1.0) - half_length + 0.5
    plates = np.array([(x, b * half_width, 1.3 * height) for x in along for b in (1, -1)])
    rest = max(flank - 0.5 * front, 0.1 * flank)
    sideways = [
        points(p, 10 * np.log10(share * rest / (len(p) / 2)), np.sign(p) * (0, 1, 0))
        for p, share in ((houses, 0.4), (plates, 0.6))
    ]
    return Scatterers.concatenate(
        [
            points(corner, 10 * np.log10(front / 4), np.sign(corner) * (0.5**0.5, 0.5**0.5, 0)),
            points(bumper, 10 * np.log10(front / 2), np.sign(bumper) * (1, 0, 0)),
            *sideways,
        ]
    )


def line(start: ArrayLike, end: ArrayLike, *, per_metre: float, normal: ArrayLike = (0.0, 0.0, 0.0)) -> Scatterers:
    """Reflectors about every metre from ``start`` to ``end`` (3,), ``per_metre`` dBsm a metre: rails, beams."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(end - start))
    count = max(1, round(length))
    at = (np.arange(count)[:, None] + 0.5) / count
    return points(start + at * (end - start), per_metre + 10 * np.log10(length / count), normal)
