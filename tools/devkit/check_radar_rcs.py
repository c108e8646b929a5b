"""Radar cross-sections by radar and age: levels, and which class of object reflects more than which."""

import math
from collections.abc import Iterator

import numpy as np
from findings import Finding, share
from radar_scans import FRONT, Scan, by_case

GROUPS = {
    "people": ("human.pedestrian",),
    "cars": ("vehicle.car",),
    "large vehicles": ("vehicle.truck", "vehicle.bus", "vehicle.trailer", "vehicle.construction"),
}
LEVELS = {"people": (-5.0, 6.0), "cars": (8.0, 6.0), "large vehicles": (13.0, 8.0)}
"""dBsm of the strongest return of an object, and how far the median may be off: what is measured at 77 GHz."""
STEPS = (("cars", "people", 6.0), ("large vehicles", "cars", 1.0))
"""Which group is stronger than which, by how many dB at least."""
ENCODABLE = (-64.0, 63.5)
"""dBsm that an ARS 408 can write, the radar of nuScenes."""
LEVEL_OF_ALL = (2.0, 9.0)
"""dBsm of the median return, and how far it may be off; nuScenes' mean is 4.8."""


def check_radar_rcs(scans: list[Scan]) -> Iterator[Finding]:
    """What is possible at all, the level of all returns and of each group of classes, and their order; each with three
    standard errors of the median more."""
    for channel, age, mine in by_case(scans):
        case = f"{channel}, {age}"
        rcs = np.concatenate([scan.rcs for scan in mine])
        possible = int(np.sum((rcs >= ENCODABLE[0]) & (rcs <= ENCODABLE[1])))
        yield share("radar RCS: what a radar can write", possible, len(rcs), 0.98, case, 30)
        level, width = LEVEL_OF_ALL
        off = float(abs(np.median(rcs) - level)) if len(rcs) else 0.0
        yield Finding(f"radar RCS: of all returns, off {level:g} dBsm", off, "<=", width, len(rcs), "dB", case, 30)
        yield from _by_group(case, mine)


def _by_group(case: str, scans: list[Scan]) -> Iterator[Finding]:
    strongest = _strongest(scans)
    middle, error = {}, {}
    for group, (level, width) in LEVELS.items():
        values = np.array(strongest[group] or [level])
        middle[group] = float(np.median(values))
        spread = 1.48 * float(np.median(np.abs(values - middle[group])))
        error[group] = 1.25 * spread / math.sqrt(len(values))
        what, limit = f"radar RCS: of {group}, off {level:g} dBsm", width + 3 * error[group]
        yield Finding(what, abs(middle[group] - level), "<=", limit, len(strongest[group]), "dB", case, 20)
    for high, low, least in STEPS:
        limit = least - 3 * math.hypot(error[high], error[low])
        count = min(len(strongest[high]), len(strongest[low]))
        yield Finding(f"radar RCS: {high} over {low}", middle[high] - middle[low], ">=", limit, count, "dB", case, 20)


def _strongest(scans: list[Scan]) -> dict[str, list[float]]:
    """By group, the strongest return of each object that has any, dBsm."""
    found: dict[str, list[float]] = {group: [] for group in GROUPS}
    for scan in scans:
        for seen in scan.objects:
            group = next((name for name, kinds in GROUPS.items() if seen.category.startswith(kinds)), None)
            aside, behind, half = scan.offsets(seen)
            mine = (np.abs(aside) < half + 1) & (behind > FRONT[0]) & (scan.range < seen.distance[1] + 0.4)
            if group and mine.any():
                found[group].append(float(scan.rcs[mine].max()))
    return found
