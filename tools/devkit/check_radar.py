"""Radar returns against the labelled boxes, by radar and age: place across and along the ray, radial velocity.

A gate about a box would hide an error smaller than the gate and lose one that is larger. So the offsets of all returns from
all boxes nearby are gathered: returns of other things lie anywhere, those of the boxes pile up where the error is.
"""

import math
from collections.abc import Iterator

import numpy as np
from findings import Finding, share
from radar_scans import ALL_RADARS, FRONT, Scan, Seen, by_case

PLAIN = 20
"""LiDAR points from which a vehicle has to show in a radar."""
DEPTH = 0.3
"""Metres behind the nearest point of a box at which returns pile up: bumpers are rounded, sides are seen aslant."""
BROAD = 8.0
"""Degrees of half a width from which a box says little about the bearing."""
CELL, REACH, SOFT = 3.0, (25.0, 4.0), (2.0, 0.3)
"""Degrees about a box that its returns lie in, mostly (the noise is 1.4 to 2.2 of them, more to the sides); degrees and metres
in which offsets are gathered and by which they are smoothed."""
STILL, FAST = 0.05, 2.0
"""m/s up to which an object is at rest, and along the ray from which it moves: either sign is then plain."""
OFF_VELOCITY = (0.35, 0.6)
"""m/s at rest and moving: the noise of the bearing (2 degrees) times the speed across the ray (10 m/s), wheels and legs."""


def check_radar(scans: list[Scan]) -> Iterator[Finding]:
    """Everything that boxes and returns say of each other."""
    for channel, age, mine in by_case(scans):
        if channel != ALL_RADARS:
            pairs = [(scan, seen) for scan in mine for seen in scan.objects]
            yield from _place(f"{channel}, {age}", pairs)
            yield from _velocity(f"{channel}, {age}", pairs)


def _place(case: str, pairs: list[tuple[Scan, Seen]]) -> Iterator[Finding]:
    across, along, met, of = [np.zeros(0)], [np.zeros(0)], 0, 0
    for scan, seen in pairs:
        aside, behind, half = scan.offsets(seen)
        in_front = (behind > FRONT[0]) & (behind < FRONT[1])
        if half < BROAD:
            across.append(aside[in_front & (np.abs(aside) < REACH[0])])
        along.append(behind[(np.abs(aside) < half + 1) & (np.abs(behind) < REACH[1])])
        if seen.category.startswith("vehicle") and seen.lidar_points >= PLAIN:
            of += 1
            met += bool(np.any((np.abs(aside) < half + CELL) & (behind > -0.6) & (scan.range < seen.distance[1] + 0.6)))
    yield share("radar: vehicles in plain sight have a return", met, of, 0.92 - 0.8 / math.sqrt(max(of, 1)), case, 30)
    for what, offsets, truth, unit, kind in (
        ("radar: bearing of returns, off the boxes", np.concatenate(across), 0.0, "deg", 0),
        ("radar: range of returns, off the near side of boxes", np.concatenate(along), DEPTH, "m", 1),
    ):
        limit = (0.5 + 20 / math.sqrt(max(len(offsets), 1)), 0.25 + 4 / math.sqrt(max(len(offsets), 1)))[kind]
        off = abs(_densest(offsets, REACH[kind], SOFT[kind]) - truth)
        yield Finding(what, off, "<=", limit, len(offsets), unit, case, 60)


def _densest(offsets: np.ndarray, reach: float, soft: float) -> float:
    """Where most of the offsets (N,) lie: the mode, smoothed by a Gaussian of ``soft``, refined by mean shift."""
    grid = np.linspace(-reach, reach, 241)
    mode = float(grid[np.exp(-0.5 * ((offsets[:, None] - grid) / soft) ** 2).sum(axis=0).argmax()])
    for _ in range(20):
        weights = np.exp(-0.5 * ((offsets - mode) / soft) ** 2)
        mode = float(weights @ offsets / max(weights.sum(), 1e-9))
    return mode


def _velocity(case: str, pairs: list[tuple[Scan, Seen]]) -> Iterator[Finding]:
    """Returns of an object at rest do not move over ground; of one that moves, the best return has its radial velocity."""
    at_rest, moving = [np.zeros(0)], []
    for scan, seen in pairs:
        aside, behind, half = scan.offsets(seen)
        near = (np.abs(aside) < half + 1) & (behind > FRONT[0]) & (behind < FRONT[1])
        if not near.any():
            continue
        bearing = np.clip(scan.bearing[near], *seen.bearing)
        expected = seen.velocity @ np.stack([np.cos(bearing), np.sin(bearing)])
        off = np.abs(scan.ground_speed[near] - expected)
        if np.hypot(*seen.velocity) < STILL:
            at_rest.append(off)
        elif np.abs(expected).min() > FAST:
            moving.append(off.min())
    resting = np.concatenate(at_rest)
    for what, off, limit, need in (
        ("radar vx_comp: of boxes at rest, off zero, median", resting, OFF_VELOCITY[0], 30),
        ("radar vx_comp: of moving boxes, off their velocity along the ray, median", moving, OFF_VELOCITY[1], 12),
    ):
        yield Finding(what, float(np.median(off)) if len(off) else 0.0, "<=", limit, len(off), "m/s", case, need)
