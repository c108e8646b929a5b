"""Radar returns against the labelled boxes, by radar and age: place across and along the ray, radial velocity.

A gate about a box would hide an error smaller than the gate and lose one that is larger. So the offsets of all returns from
all boxes nearby are gathered: returns of other things lie anywhere, those of the boxes pile up where the error is.
"""

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from findings import Finding, share
from radar_scans import ALL_RADARS, FRONT, Scan, Seen, by_case

BODIES = ("vehicle.car", "vehicle.truck", "vehicle.bus", "vehicle.trailer")
"""Categories that fill their boxes, so that the near side reflects. Not so the boom of an excavator or a heap of debris; cones
and barriers stand in rows, each among the returns of the next."""
PLAIN = 20
"""LiDAR points from which a vehicle has to show in a radar."""
BROAD = 8.0
"""Degrees of half a width from which a box says little about the bearing."""
CELL = 3.0
"""Degrees about a box that its returns lie in, mostly: the bearing's noise is 1.4 to 2.2 of them, more to the sides."""
STILL, FAST = 0.05, 2.0
"""m/s up to which an object is at rest, and along the ray from which it moves: either sign is then plain."""
OFF_VELOCITY = (0.35, 0.5)
"""m/s at rest and moving: the noise of the bearing (2 degrees) times the speed across the ray (10 m/s), wheels and legs."""


@dataclass(frozen=True)
class Pile:
    """Offsets are gathered up to ``reach``, smoothed by ``soft``, and should pile up at ``at``: within ``systematic`` and
    ``noise`` / sqrt(N) of it, N being all offsets. Returns of one object come in threes, so that the noise is some five times
    their scatter. Of a few objects, seen again and again, the wheels or the cab of one can make the pile: hence the least
    number of ``objects``."""

    what: str
    unit: str
    reach: float
    soft: float
    at: float
    systematic: float
    noise: float
    objects: int

    def finding(self, offsets: dict[str, list[np.ndarray]], case: str) -> Finding:
        """How far from where they should do the offsets of each object pile up."""
        of = [np.concatenate(mine) for mine in offsets.values()]
        every = np.concatenate([np.zeros(0), *of])
        limit = self.systematic + self.noise / math.sqrt(max(len(every), 1))
        count = sum(len(mine) > 0 for mine in of)
        return Finding(self.what, abs(self._top(every) - self.at), "<=", limit, count, self.unit, case, self.objects)

    def _top(self, offsets: np.ndarray) -> float:
        """Where most lie: the mode, smoothed by a Gaussian, refined by mean shift."""
        grid = np.linspace(-self.reach, self.reach, 241)
        top = float(grid[np.exp(-0.5 * ((offsets[:, None] - grid) / self.soft) ** 2).sum(axis=0).argmax()])
        for _ in range(20):
            weights = np.exp(-0.5 * ((offsets - top) / self.soft) ** 2)
            top = float(weights @ offsets / max(weights.sum(), 1e-9))
        return top


ACROSS = Pile("radar: bearing of returns, off the boxes", "deg", 25.0, 2.0, 0.0, 0.5, 20.0, objects=10)
"""Noise of the bearing and half the widths of boxes: some 4 degrees."""
ALONG = Pile("radar: range of returns, off the near side of boxes", "m", 4.0, 0.3, 0.3, 0.25, 4.0, objects=20)
"""Behind the nearest point of a box by 0.3 m: bumpers are rounded, sides are seen aslant. Noise of at most 0.2 m, and depth."""


def check_radar(scans: list[Scan]) -> Iterator[Finding]:
    """Everything that boxes and returns say of each other."""
    for channel, age, mine in by_case(scans):
        if channel != ALL_RADARS:
            pairs = [(scan, seen) for scan in mine for seen in scan.objects]
            yield from _place(f"{channel}, {age}", pairs)
            yield from _velocity(f"{channel}, {age}", pairs)


def _place(case: str, pairs: list[tuple[Scan, Seen]]) -> Iterator[Finding]:
    across, along, met, of = defaultdict(list), defaultdict(list), 0, 0
    for scan, seen in pairs:
        aside, behind, half = scan.offsets(seen)
        in_front = (behind > FRONT[0]) & (behind < FRONT[1])
        if seen.category.startswith(BODIES):
            along[seen.instance].append(behind[(np.abs(aside) < half + 1) & (np.abs(behind) < ALONG.reach)])
            if half < BROAD:
                across[seen.instance].append(aside[in_front & (np.abs(aside) < ACROSS.reach)])
        if seen.category.startswith("vehicle") and seen.lidar_points >= PLAIN:
            of += 1
            met += bool(np.any((np.abs(aside) < half + CELL) & (behind > -0.6) & (scan.range < seen.distance[1] + 0.6)))
    yield share("radar: vehicles in plain sight have a return", met, of, 0.90 - 0.8 / math.sqrt(max(of, 1)), case, 30)
    yield ACROSS.finding(across, case)
    yield ALONG.finding(along, case)


def _velocity(case: str, pairs: list[tuple[Scan, Seen]]) -> Iterator[Finding]:
    """Returns of an object at rest do not move over ground; of one that moves, the best return has its radial velocity."""
    at_rest, moving = [np.zeros(0)], []
    for scan, seen in pairs:
        aside, behind, half = scan.offsets(seen)
        near = scan.unfolded & (np.abs(aside) < half + 1) & (behind > FRONT[0]) & (behind < FRONT[1])
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
        limit += 1.5 / math.sqrt(max(len(off), 1))
        yield Finding(what, float(np.median(off)) if len(off) else 0.0, "<=", limit, len(off), "m/s", case, need)
