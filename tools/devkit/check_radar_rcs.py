"""Radar cross-sections by radar and age: levels, and which class of object reflects more than which."""

import math
from collections import defaultdict
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
STANDS_OUT = 2.5
"""dB by which a return of a vehicle's near side is over the median of its scan, at least."""
OBJECTS = 10
"""Objects of a group that a median has to rest on."""
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
    strongest, over = _strongest(scans)
    middle, error = {}, {}
    for group, (level, width) in LEVELS.items():
        values = np.array(strongest[group] or [level])
        middle[group] = float(np.median(values))
        error[group] = _error(values, middle[group])
        what, limit = f"radar RCS: of {group}, off {level:g} dBsm", width + 3 * error[group]
        yield Finding(what, abs(middle[group] - level), "<=", limit, len(strongest[group]), "dB", case, OBJECTS)
    for high, low, least in STEPS:
        limit = least - 3 * math.hypot(error[high], error[low])
        count = min(len(strongest[high]), len(strongest[low]))
        yield Finding(
            f"radar RCS: {high} over {low}", middle[high] - middle[low], ">=", limit, count, "dB", case, OBJECTS
        )

    middle["over"] = float(np.median(over or [0.0]))
    limit = STANDS_OUT - 3 * _error(np.array(over or [0.0]), middle["over"])
    what = "radar RCS: vehicles over the median of their scan"
    yield Finding(what, middle["over"], ">=", limit, len(over), "dB", case, 2 * OBJECTS)


def _error(values: np.ndarray, middle: float) -> float:
    """Standard error of the median of values (N,), from their median deviation."""
    return 1.25 * 1.48 * float(np.median(np.abs(values - middle))) / math.sqrt(len(values))


def _strongest(scans: list[Scan]) -> tuple[dict[str, list[float]], list[float]]:
    """By group, the strongest return of each object that has any, dBsm; and by how many dB the median return of the near side
    of each vehicle is over the median of its scan. Both are the median of all scans, so that an object counts once."""
    strongest, over = {group: defaultdict(list) for group in GROUPS}, defaultdict(list)
    for scan in scans:
        usual = np.median(scan.rcs) if scan.objects else 0.0
        for seen in scan.objects:
            group = next((name for name, kinds in GROUPS.items() if seen.category.startswith(kinds)), None)
            aside, behind, half = scan.offsets(seen)
            mine = (np.abs(aside) < half + 1) & (behind > FRONT[0]) & (scan.range < seen.distance[1] + 0.4)
            front = mine & (behind < FRONT[1])
            if group and mine.any():
                strongest[group][seen.instance].append(scan.rcs[mine].max())
            if group not in (None, "people") and front.any():
                over[seen.instance].append(np.median(scan.rcs[front]) - usual)
    return {group: _medians(found) for group, found in strongest.items()}, _medians(over)


def _medians(found: dict[str, list[float]]) -> list[float]:
    return [float(np.median(values)) for values in found.values()]
